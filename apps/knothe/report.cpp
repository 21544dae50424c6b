#include <fmt/format.h>

#include "apps/knothe/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/report/pages/assimilation_report.hpp"
#include "knothe/report/pages/comparison_report.hpp"
#include "knothe/report/pages/inference_report.hpp"
#include "knothe/report/pages/study_report.hpp"

namespace knothe::commands {

int report(const ReportArguments& arguments) {
  if (!arguments.output.ends_with(".html"))
    throw UsageError(fmt::format(
        "-o {}: a report is a page (.html); each of its figures can be saved from there", arguments.output));
  if (report::holds_study(arguments.results))
    report::write_study_report(arguments.results, arguments.output);
  else if (report::holds_comparison(arguments.results))
    report::write_comparison_report(arguments.results, arguments.output);
  else if (report::holds_inference(arguments.results))
    report::write_inference_report(arguments.results, arguments.output);
  else
    report::write_assimilation_report(arguments.results, "", arguments.output);
  fmt::print("{}\n", arguments.output);
  return 0;
}

}  // namespace knothe::commands
