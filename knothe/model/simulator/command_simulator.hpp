#pragma once
/// @file Any program as a full-order model: files filled with the parameters, a command, a result file.
#include <string>
#include <vector>

#include "knothe/model/simulator/result_file.hpp"
#include "knothe/model/simulator/simulator.hpp"

namespace knothe::model {

/// In words and templates `{{NAME}}` stands for the physical value of that parameter, with every digit;
/// `{{NAME:FORMAT}}` for the value in a format of C++ or Python ("{{E:.8e}}").
struct CommandOptions {
  std::vector<std::string> run;        ///< program and arguments, run in the working folder
  std::vector<std::string> templates;  ///< files that are filled and put there, under their own names
  std::vector<std::string> files;      ///< files that are linked there as they are
  ResultOptions result;
  double time_limit_s = 0;  ///< of one attempt; 0: none
  int retries = 0;          ///< further attempts after a failure
};

/// Each solution is a run of the command in a working folder of its own, below `folder`, which is removed
/// after it; that of a failed run stays and is named in the message.
class CommandSimulator final : public Simulator {
 public:
  /// Parameters are dimensionless multiples of the references of `axes`. `folder`: empty for the system's
  /// temporary one. ProjectError: a file that is not there, a placeholder that is no parameter, a parameter
  /// without a placeholder.
  CommandSimulator(CommandOptions options, std::vector<Axis> axes, std::string folder = "");

  /// The command, the content of templates and files, what is read of the result, and the physical
  /// parameters. A new version of the program behind the command is not noticed.
  [[nodiscard]] std::string key(std::span<const double> parameters) const override;
  [[nodiscard]] Snapshots solve(std::span<const double> parameters) override;
  /// Runs go on after a failure: all that failed are told.
  [[nodiscard]] std::vector<RunFailure> solve_to_files(
      std::span<const Run> runs, int processes, const std::function<void(std::size_t)>& finished) override;

 private:
  [[nodiscard]] Snapshots attempt(std::span<const double> parameters) const;
  [[nodiscard]] std::string filled(const std::string& text, const std::string& where,
                                   std::span<const double> parameters) const;

  CommandOptions options_;
  std::vector<Axis> axes_;
  std::vector<std::string> names_;
  std::vector<std::string> templates_;  ///< their texts
  std::string folder_;
  std::string identity_;
};

}  // namespace knothe::model
