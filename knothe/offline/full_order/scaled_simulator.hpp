#pragma once
/// @file Runs of the built-in beam that follow from other runs exactly, by its similarity.
///
/// Strain and √(Y₀/E) scale together, and damage depends on A_d (Y − Y₀) = A_d Y₀ (Y/Y₀ − 1). Under a load
/// that grows in proportion, with s = √(Y₀/E),
///   u(t; E, Y₀, A_d) = s U(t / s; A_d Y₀),   F(t; E, Y₀, A_d) = E s F̂(t / s; A_d Y₀),
/// for every law and regularisation here: Y is quadratic in the strain, everything else linear. Springs under
/// the supports have a stiffness of their own; E is then not scaled.
#include <memory>
#include <vector>

#include "knothe/model/simulator/run_file.hpp"
#include "knothe/offline/full_order/beam_simulator.hpp"

namespace knothe::offline {

/// Solves once for all points with the same A_d Y₀, at `substeps` times as many load steps: of the points of
/// the box with this product, at the one where s is smallest, so that the others are between its load steps;
/// linear between those. A solution is a function of its parameters and of the box, whatever is solved beside
/// it.
class ScaledSimulator : public model::Simulator {
 public:
  ScaledSimulator(const BeamProblem& problem, std::vector<model::Axis> axes, int substeps);

  [[nodiscard]] std::string key(std::span<const double> parameters) const override;
  [[nodiscard]] model::Snapshots solve(std::span<const double> parameters) override;
  void check(std::span<const double> parameters) const override { reference_.check(parameters); }
  [[nodiscard]] std::optional<model::Snapshots> frame() const override { return frame_; }
  /// What was solved stays in files beside those of the runs until all of them are there.
  [[nodiscard]] std::vector<model::RunFailure> solve_to_files(
      std::span<const model::Run> runs, int processes,
      const std::function<void(std::size_t)>& finished) override;

  /// The point that is solved for another one.
  [[nodiscard]] std::vector<double> reference_of(std::span<const double> parameters) const;

 private:
  [[nodiscard]] model::FinishedRun scaled(const model::FinishedRun& reference, std::span<const double> solved,
                                          std::span<const double> parameters) const;

  BeamProblem problem_;
  std::vector<model::Axis> axes_;
  int substeps_;
  BeamSimulator reference_;  ///< at the finer steps
  model::Snapshots frame_;
  bool scales_modulus_;
};

/// Y₀ and A_d (or G_f) of a grid at nodes of one common ratio, between the same ends: A_d Y₀ then takes n + m
/// − 1 values on n × m nodes instead of n m. ProjectError where the ends and numbers of nodes do not allow
/// it.
void space_by_ratio(std::vector<model::Axis>& axes);

}  // namespace knothe::offline
