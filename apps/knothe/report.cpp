#include <fmt/format.h>

#include "apps/knothe/commands.hpp"
#include "knothe/report/assimilation_report.hpp"

namespace knothe::commands {

int report(const ReportArguments& arguments) {
  if (arguments.output.ends_with(".svg")) {
    report::write_overview_svg(arguments.results, arguments.output);
  } else {
    report::write_assimilation_report(arguments.results, "", arguments.output);
  }
  fmt::print("{}\n", arguments.output);
  return 0;
}

}  // namespace knothe::commands
