#pragma once
/// @file Which files a project's fields are in, and when each was. Private to this room.
#include <map>
#include <span>
#include <string>
#include <vector>

#include "knothe/files/fields/exported_field.hpp"
#include "knothe/project/field_options.hpp"

namespace knothe::project {

/// The folder that the fields are in.
[[nodiscard]] std::string fields_folder(const FieldOptions& options);

/// The files of a folder, or of "FOLDER/PATTERN" with `*` and `?`, in the order of the numbers in their
/// names. DataError where there are none.
[[nodiscard]] std::vector<std::string> list_fields(const std::string& files);

/// Puts times, and the series that are asked for, into fields: from `times`, the table `steps`, the names or
/// the files themselves; the only field is of the model's only time. DataError, with what to give, where one
/// has none or two have the same.
void tell_times(const FieldOptions& options, std::span<const double> model_times,
                std::vector<files::ExportedField>& fields);

}  // namespace knothe::project
