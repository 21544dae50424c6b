#pragma once
/// @file A full-order model in a program of its own, which is run for each solution.
#include <stop_token>

#include "knothe/model/simulator/simulator.hpp"

namespace knothe::model {

struct SolverProcessOptions {
  /// The program and its first arguments; `--at NAME=V,… -o FILE` are added. It writes a file of snapshots of
  /// that one point (docs/reference/formats.md, "Snapshots").
  std::vector<std::string> words;
  std::vector<std::string> names;  ///< of the parameters, in order
  std::string identity;            ///< what its solutions depend on besides them, for the key
  std::size_t processes = 1;       ///< at the same time
  double time_limit_s = 0;         ///< of a solution; 0: none
  std::string keep;                ///< folder for solutions (kept_solutions.hpp); empty: they are not kept
  std::stop_token stop;            ///< ends the programs; Interrupted
};

/// `knothe-offline solve`, for programs that link no mechanics; or any program that understands the same
/// arguments. Files go to a folder of its own that is removed with it, or are kept: a solution that is there
/// is not made again.
class SolverProcess final : public Simulator {
 public:
  explicit SolverProcess(SolverProcessOptions options);
  ~SolverProcess() override;
  [[nodiscard]] std::string key(std::span<const double> parameters) const override;
  [[nodiscard]] Snapshots solve(std::span<const double> parameters) override;
  [[nodiscard]] std::vector<Snapshots> solve_all(std::span<const std::vector<double>> points,
                                                 const std::function<void(std::size_t)>& finished) override;

 private:
  [[nodiscard]] Snapshots solve(std::span<const double> parameters, const std::string& file) const;
  void run(std::span<const double> parameters, const std::string& file) const;
  [[nodiscard]] Snapshots read(std::span<const double> parameters, const std::string& file) const;

  SolverProcessOptions options_;
  std::string folder_;
};

}  // namespace knothe::model
