#pragma once
/// @file What `knothe assimilate` prints while it happens: JSON lines, or a live line and a table for people.
#include <cstdio>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "knothe/assimilation/engine/input_errors.hpp"
#include "knothe/assimilation/engine/step_result.hpp"
#include "knothe/model/reduced/loading.hpp"
#include "knothe/project/picture_measurements.hpp"
#include "knothe/project/refinement.hpp"

namespace knothe::record {

/// `verdict_text`, its first line in the colour of its level where `stream` is a terminal that has colours.
[[nodiscard]] std::string shown_verdict(const assimilation::Verdict& verdict, std::FILE* stream);

class AssimilationOutput {
 public:
  /// `axes`: of the model's parameters; `steps`: how many there will be.
  AssimilationOutput(bool json, std::vector<model::Axis> axes, std::size_t steps);
  ~AssimilationOutput();
  AssimilationOutput(const AssimilationOutput&) = delete;
  AssimilationOutput& operator=(const AssimilationOutput&) = delete;

  /// A step; `picture`: what it was measured in, one of `pictures`.
  void show(const assimilation::StepResult& result, const std::optional<project::PictureDatum>& picture,
            const project::PictureMeasurements* pictures);
  /// The model was refined at the step that is shown next.
  void report_refinement(const project::Refinement& refinement);
  /// What errors of the inputs would do to the last posterior.
  void report_input_errors(std::vector<assimilation::InputShift> shifts) { shifts_ = std::move(shifts); }
  /// All steps are done; `loading` names the horizons of the forecasts.
  void finish(double elapsed_s, const std::string& results_folder, const model::Loading& loading);
  [[nodiscard]] assimilation::Verdict verdict() const { return run_.verdict(); }  ///< of the steps so far
  [[nodiscard]] std::size_t shown() const { return shown_; }

 private:
  void print_record(const assimilation::StepResult& result,
                    const std::optional<project::PictureDatum>& picture,
                    const project::PictureMeasurements* pictures) const;
  void print_text(const assimilation::StepResult& result, double total_us) const;
  void tell(const std::string& line) const;
  void tell_verdict(const assimilation::UpdateResult& update);
  void tell_largest_shift() const;
  void tell_sensors(const assimilation::StepResult& result);

  bool json_, live_;
  std::vector<model::Axis> axes_;
  std::size_t steps_, shown_ = 0;
  std::vector<std::size_t> untrusted_;
  assimilation::RunVerdict run_;
  assimilation::VerdictLevel told_level_ = assimilation::VerdictLevel::ok;
  std::set<Eigen::Index> told_;  ///< sensors that stopped
  std::vector<assimilation::ComparedModel> models_;
  std::vector<assimilation::NamedForecast> forecasts_;  ///< of the last step
  std::optional<assimilation::Decision> decision_;      ///< likewise
  std::vector<assimilation::InputShift> shifts_;
};

}  // namespace knothe::record
