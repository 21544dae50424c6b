#pragma once
/// @file What errors of the inputs do to a posterior: those that the parameters make up for, so that no test
/// of the data detects them (docs/explanation/verdict.md, "Tolerances of the inputs").
#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/update/problem.hpp"
#include "knothe/likelihood/data/data_set.hpp"

namespace knothe::assimilation {

/// An input that is too large by a share of itself. With f = 1 + `relative`, the readings of row i are
/// multiplied by f^readings_i, the model's time by f^clock, its parameter a by f^parameters_a.
struct InputError {
  std::string name;
  double relative = 0.01;
  Eigen::VectorXd readings{};    ///< n; −1 where the model's values are too large, not the readings
  double clock = 0;              ///< an imposed displacement or load is proportional to the time
  Eigen::VectorXd parameters{};  ///< d: what is known, such as a modulus, acts like a change of these
};

/// By how much a posterior mean is then too large.
struct InputShift {
  std::string name;
  double relative = 0;            ///< the error's, or less where the data show more
  bool is_limited = false;        ///< it is less
  Eigen::VectorXd shift, in_std;  ///< d: in parameters, and in standard deviations of the posterior
};

/// The posterior after the last step of the data is made again for each error, without its monitor and by
/// the cheapest method (`auto`), from data that are altered by it; `mean` is where the model is evaluated
/// for that. An error that costs the evidence more than e²⁰ is one that the tests of the data detect: it is
/// made smaller until it does not. Cost: some posteriors of all data for each. `data`: by steps, not empty;
/// nothing where they have no posterior by that method.
[[nodiscard]] std::vector<InputShift> shifts_by(std::span<const InputError> errors, const Problem& problem,
                                                std::span<const likelihood::DatumPointer> data,
                                                const Eigen::VectorXd& mean);

}  // namespace knothe::assimilation
