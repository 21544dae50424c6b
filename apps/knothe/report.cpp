#include <fmt/format.h>

#include "apps/knothe/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/report/pages/assimilation_report.hpp"
#include "knothe/report/pages/comparison_report.hpp"
#include "knothe/report/pages/inference_report.hpp"

namespace knothe::commands {

int report(const ReportArguments& arguments) {
  if (!arguments.output.ends_with(".html") && !arguments.output.ends_with(".svg"))
    throw UsageError(
        fmt::format("-o {}: a report is a page (.html) or its overview alone (.svg)", arguments.output));
  const bool compared = report::holds_comparison(arguments.results);
  if (compared || report::holds_inference(arguments.results)) {
    if (arguments.output.ends_with(".svg"))
      throw UsageError("the report of an inference is a page: give -o a name that ends in .html");
    if (compared)
      report::write_comparison_report(arguments.results, arguments.output);
    else
      report::write_inference_report(arguments.results, arguments.output);
  } else if (arguments.output.ends_with(".svg")) {
    report::write_overview_svg(arguments.results, arguments.output);
  } else {
    report::write_assimilation_report(arguments.results, "", arguments.output);
  }
  fmt::print("{}\n", arguments.output);
  return 0;
}

}  // namespace knothe::commands
