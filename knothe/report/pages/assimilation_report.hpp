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

/// What was found in plain words, one card each.
[[nodiscard]] std::vector<Card> headline(const record::Results& results);

/// Rows "quantity, paper, here, why they differ" for the paper's beam; empty for any other problem.
[[nodiscard]] std::vector<TableRow> comparison_with_paper(const record::Results& results);

/// Successive posteriors of the last parameter and successive forecasts side by side, as a file of its own.
[[nodiscard]] std::string overview_svg(const record::Results& results);
void write_overview_svg(const std::string& results_folder, const std::string& output);

}  // namespace knothe::report
