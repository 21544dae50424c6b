#include <fmt/format.h>

#include <cstdio>

#include "apps/knothe/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/project/option_table.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::commands {

int check(const CheckArguments& arguments) {
  if (arguments.options) {
    std::fputs(project::option_reference().c_str(), stdout);
    return 0;
  }
  if (arguments.project.empty()) throw UsageError("check needs a project file, or --options");
  (void)project::read_project(arguments.project);
  fmt::print("{}: valid\n", arguments.project);
  return 0;
}

}  // namespace knothe::commands
