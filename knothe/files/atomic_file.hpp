#pragma once
/// @file Files appear whole or not at all.
#include <functional>
#include <initializer_list>
#include <string>

namespace knothe::files {

/// Calls `write(temporary)` with a temporary name in the folder of `path`, syncs what it wrote to disk and
/// renames it to `path`. If anything fails the temporary is removed, `path` is as before, and the exception
/// passes on. Folders in `path` are made. Errors: IoError.
void write_atomically(const std::string& path,
                      const std::function<void(const std::string& temporary)>& write);

/// The same for a text.
void write_text_atomically(const std::string& path, const std::string& text);

/// Refuses an output that is one of the inputs, by whatever name: UsageError. Inputs that are "" or not there
/// do not count.
void refuse_overwriting(const std::string& output, std::initializer_list<std::string> inputs);

/// Makes the folder for results where it is not there, and tells before the work, not after it, that nothing
/// can be written there. Errors: IoError.
void require_writable_folder(const std::string& folder);

/// The whole file. Missing or unreadable: an Error of kind `status_if_missing`'s exit status is the caller's
/// business, so this throws IoError with the system's words.
[[nodiscard]] std::string read_text(const std::string& path);

}  // namespace knothe::files
