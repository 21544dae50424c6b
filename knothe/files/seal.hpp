#pragma once
/// @file Whether a file's bytes are those that were written. The HDF5 library (1.10) trusts what it reads:
/// some damaged files end the process that opens them, or give other numbers. So a sealed file is checked
/// before the library sees it, and any other is first read in a process of its own.
#include <functional>
#include <string>

namespace knothe::files {

/// Puts a block of 512 bytes (HDF5's "user block": the library looks for its own beginning at 0, 512, 1024 …)
/// before what is in the file: how many bytes follow and their SHA-256. Errors: IoError.
void seal(const std::string& path);

enum class SealState {
  none,   ///< made by another program, or taken off (`tail -c +513`)
  whole,  ///< the bytes are those that were written
  broken
};

/// Errors: DataError for a file that cannot be read, or is shorter than its seal says ("truncated").
[[nodiscard]] SealState state_of_seal(const std::string& path);

/// Returns if `reading`, which reads the file and throws DataError for what is wrong with it, may be called
/// in this process. At once for a whole seal. Otherwise `reading` is called in a child process; a file that
/// ends it is refused, and so is one whose seal is broken, with what `reading` says of it if it says
/// something. Errors: DataError.
void require_sound(const std::string& path, const std::function<void()>& reading);

}  // namespace knothe::files
