#include <fmt/format.h>

#include <filesystem>

#include "apps/knothe/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/report/assimilation_report.hpp"
#include "knothe/report/inference_report.hpp"

namespace knothe::commands {

int report(const ReportArguments& arguments) {
  namespace fs = std::filesystem;
  const fs::path folder(arguments.results);
  if (fs::exists(folder / "comparison.json") && !fs::exists(folder / "inference.json") &&
      !fs::exists(folder / "steps.jsonl"))
    throw UsageError(
        fmt::format("{}: holds a comparison; each method's results are in a folder of its own there, e.g. {}",
                    arguments.results, (folder / "transport").string()));
  if (report::holds_inference(arguments.results)) {
    if (arguments.output.ends_with(".svg"))
      throw UsageError("the report of an inference is a page: give -o a name that ends in .html");
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
