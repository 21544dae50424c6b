#include "knothe/report/assimilation_report.hpp"

#include <fmt/format.h>

#include "apps/knothe/commands.hpp"

namespace knothe::commands {

int report(const ReportArguments& arguments) {
  report::write_assimilation_report(arguments.results, "", arguments.output);
  fmt::print("{}\n", arguments.output);
  return 0;
}

}  // namespace knothe::commands
