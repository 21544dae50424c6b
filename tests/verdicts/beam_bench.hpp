#pragma once
/// @file The notched beam of tests/cases, coarse: full-order runs of it and of beams that are a little
/// different, and reduced models of these.
#include <Eigen/Core>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "knothe/assimilation/engine/engine.hpp"
#include "knothe/model/reduced/separated_model.hpp"
#include "knothe/offline/full_order/beam_simulator.hpp"

namespace knothe::verdicts {

inline constexpr double k_noise = 1e-6;     ///< m, of a displacement
inline constexpr double k_force_noise = 5;  ///< N
inline constexpr std::size_t k_steps = 50;

/// How a beam differs from the one that is modelled.
struct Structure {
  std::string name;
  offline::BeamProblem problem;
};

[[nodiscard]] offline::BeamProblem modelled_beam();

/// Exact values at the sensors: 60 displacements and, last, the reaction force; 61 × steps.
using History = Eigen::MatrixXd;

/// A reduced model, its sensors, and its known errors at eight points off its grid.
struct Reduced {
  std::shared_ptr<const model::ObservedModel> displacements, with_force;
  model::ObservedErrors errors;  ///< of the displacements
};

class BeamBench {
 public:
  BeamBench();

  /// Full-order solution of a structure, at (Y0, Ad) in multiples of the references.
  [[nodiscard]] const History& history(const Structure& structure, const Eigen::Vector2d& p);
  /// Of a structure: `nodes` per parameter, `modes` (tree form), or canonical with so many.
  [[nodiscard]] const Reduced& reduced(const Structure& structure, int nodes, std::size_t modes,
                                       model::Form form = model::Form::tree);
  [[nodiscard]] const model::Sensors& sensors() const { return sensors_; }  ///< displacements

 private:
  [[nodiscard]] offline::FullOrderModel& solver(const Structure& structure);
  [[nodiscard]] History at_sensors(const offline::FullOrderModel& model,
                                   const offline::FullOrderResult& result) const;

  std::vector<model::Axis> axes_;
  model::Sensors sensors_;
  std::map<std::string, offline::FullOrderModel> solvers_;
  std::map<std::string, History> histories_;
  std::map<std::string, model::Snapshots> snapshots_;
  std::map<std::string, Reduced> reduced_;
};

}  // namespace knothe::verdicts
