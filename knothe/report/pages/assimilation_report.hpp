#pragma once
/// @file The report of an assimilation: one page that shows what was found, how sure it is, and how it was
/// done.
#include <string>
#include <vector>

#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/record/results.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::report {

/// The page. `model` may be null: the figures of the model are then left out, and `model_problem` says why.
[[nodiscard]] std::string assimilation_report(const record::Results& results,
                                              const model::SeparatedModel* model,
                                              const std::string& model_problem = {});

/// Reads RESULTS/ and the model file (`model_path`; if empty, the one that summary.json names) and writes the
/// page. A model that cannot be read is a sentence on the page; broken results are a DataError, a full disk
/// an IoError.
void write_assimilation_report(const std::string& results_folder, const std::string& model_path,
                               const std::string& output);

/// What a verdict's level says of a result.
[[nodiscard]] Usability usability(assimilation::VerdictLevel level);

/// The same of the last step; results that were not judged are taken as they are.
[[nodiscard]] Usability worth_of(const record::Results& results);

/// What was found, in numbers and units: the parameters, and the forecasts, those whose horizon is over last.
[[nodiscard]] std::vector<Table> headline(const record::Results& results);

/// Indices (into results.steps) of the `count` steps where the standard deviation of parameter `d` falls
/// most, by ratio.
[[nodiscard]] std::vector<std::size_t> learning_steps(const record::Results& results, std::size_t d,
                                                      std::size_t count = 5);

/// "1, 2, 3 and 4 more".
[[nodiscard]] std::string list_of(const std::vector<std::size_t>& numbers);

/// Time of an update over the steps: "0.3 ms (median), 1 ms (99 %)".
[[nodiscard]] std::string update_times(const record::Results& results, double record::Step::*time);

/// Rows "quantity, paper, here, why they differ" for the paper's beam; empty for any other problem.
[[nodiscard]] std::vector<TableRow> comparison_with_paper(const record::Results& results);

}  // namespace knothe::report
