#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "apps/knothe/commands.hpp"
#include "knothe/base/console.hpp"
#include "knothe/base/error.hpp"
#include "knothe/project/file_check.hpp"
#include "knothe/project/option_table.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/record/fields.hpp"

namespace knothe::commands {

int check(const CheckArguments& arguments) {
  if (arguments.options) {
    std::fputs(project::option_reference().c_str(), stdout);
    return 0;
  }
  if (arguments.schema) {
    fmt::print("{}\n", record::line_schemas().dump(2));
    return 0;
  }
  if (arguments.project.empty()) throw UsageError("check needs a project file, --options or --schema");
  const project::Project project = project::read_project(arguments.project);
  const project::FileCheck check = project::check_files(project);
  for (const std::string& fact : check.facts) fmt::print("{}\n", for_people(fact, stdout, 2));
  for (const std::string& warning : check.warnings)
    fmt::print(stderr, "{}\n", for_people("warning: " + warning, stderr, 2));
  if (check.missing.empty()) {
    fmt::print("{}: valid\n", arguments.project);
  } else {
    fmt::print("{}: valid, syntax only: {} {} missing so far\n", arguments.project,
               fmt::join(check.missing, ", "), check.missing.size() == 1 ? "is" : "are");
  }
  return 0;
}

}  // namespace knothe::commands
