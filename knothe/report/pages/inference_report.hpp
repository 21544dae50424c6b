#pragma once
/// @file The report of `knothe infer`: what was found, whether to trust it, and how it was found.
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "knothe/report/pages/page.hpp"

namespace knothe::report {

/// Whether the folder holds the results of an inference, newer than those of an assimilation if it has both.
[[nodiscard]] bool holds_inference(const std::string& results_folder);

/// Whether an answer may be used, and why: first what the data and the priors say, then the computation.
struct InferenceJudgement {
  Usability usability;
  std::vector<std::string> sentences;
};
/// Of the content of inference.json. An answer is used with caveats where the data fit badly, a prior cuts it
/// off or the map's tolerance was missed; not at all where the data do not fit, by the limits of a step's
/// verdict, or the computation is not trusted.
[[nodiscard]] InferenceJudgement judgement(const nlohmann::json& content);

/// The page, from the content of inference.json. `where` names the file in messages. Errors: DataError for a
/// member that is missing or of the wrong kind.
[[nodiscard]] std::string inference_report(const nlohmann::json& content, const std::string& where);

/// Reads RESULTS/inference.json and writes the page. Errors: DataError, IoError.
void write_inference_report(const std::string& results_folder, const std::string& output);

}  // namespace knothe::report
