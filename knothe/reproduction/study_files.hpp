#pragma once
/// @file The study as one page and one JSON file.
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "knothe/reproduction/study.hpp"

namespace knothe::reproduction {

/// "Fig. 13. The crack length …"; the title alone where it is no figure of the paper.
[[nodiscard]] std::string heading(const FigureRecord& figure);

/// The rows of a figure, one record each: figure, quantity, unit, paper, here, why, and paper_value and
/// here_value where they are numbers.
[[nodiscard]] std::vector<nlohmann::ordered_json> row_records(const FigureRecord& figure);

/// Everything in one object: program, machine, seeds, what was chosen, figures with rows, tables and series.
[[nodiscard]] nlohmann::ordered_json study_record(const Study& study, const StudyOptions& options);

/// The page: needs nothing but itself.
[[nodiscard]] std::string study_page(const Study& study, const StudyOptions& options);

/// Makes the rest of the beam's models superfluous: the full-order runs of models that are built. Called when
/// all is done.
void remove_runs(const std::string& models_folder);

}  // namespace knothe::reproduction
