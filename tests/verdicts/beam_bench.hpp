#pragma once
/// @file The notched beam of tests/cases, coarse: full-order runs of it and of beams that are a little
/// different, and reduced models of these.
#include <Eigen/Core>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "knothe/engine/engine.hpp"
#include "knothe/mechanics/full_order/beam_simulator.hpp"
#include "knothe/reduction/model/separated_model.hpp"

namespace knothe::verdicts {

inline constexpr double k_noise = 1e-6;     ///< m, of a displacement
inline constexpr double k_force_noise = 5;  ///< N
inline constexpr std::size_t k_steps = 50;

/// How a beam differs from the one that is modelled.
struct Structure {
  std::string name;
  mechanics::BeamProblem problem;
};

[[nodiscard]] mechanics::BeamProblem modelled_beam();

/// Exact values at the sensors: 60 displacements and, last, the reaction force; 61 × steps.
using History = Eigen::MatrixXd;

/// A reduced model, its sensors, and its known errors at eight points off its grid.
struct Reduced {
  std::shared_ptr<const reduction::ObservedModel> displacements, with_force;
  reduction::ObservedErrors errors;  ///< of the displacements
};

class BeamBench {
 public:
  BeamBench();

  /// Full-order solution of a structure, at (Y0, Ad) in multiples of the references.
  [[nodiscard]] const History& history(const Structure& structure, const Eigen::Vector2d& p);
  /// Of a structure: `nodes` per parameter, `modes` (tree form), or canonical with so many.
  [[nodiscard]] const Reduced& reduced(const Structure& structure, int nodes, std::size_t modes,
                                       reduction::Form form = reduction::Form::tree);
  [[nodiscard]] const reduction::Sensors& sensors() const { return sensors_; }  ///< displacements

 private:
  [[nodiscard]] mechanics::FullOrderModel& solver(const Structure& structure);
  [[nodiscard]] History at_sensors(const mechanics::FullOrderModel& model,
                                   const mechanics::FullOrderResult& result) const;

  std::vector<reduction::Axis> axes_;
  reduction::Sensors sensors_;
  std::map<std::string, mechanics::FullOrderModel> solvers_;
  std::map<std::string, History> histories_;
  std::map<std::string, reduction::Snapshots> snapshots_;
  std::map<std::string, Reduced> reduced_;
};

}  // namespace knothe::verdicts
