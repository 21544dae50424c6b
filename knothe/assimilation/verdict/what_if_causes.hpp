#pragma once
/// @file The mistakes that change all data of a sensor or of a time: each is assumed, fitted and compared.
#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "knothe/assimilation/verdict/verdict.hpp"
#include "knothe/assimilation/verdict/what_if_fit.hpp"

namespace knothe::assimilation {

/// An assumption that was tried.
struct Tried {
  MisfitCause cause = MisfitCause::unknown;
  double misfit = 0;
  std::string message;
  bool explains = false;  ///< nothing is left over but noise
  bool is_exact = false;  ///< of a factor: a sign or a unit
};

class WhatIfCauses {
 public:
  using Data = std::span<const likelihood::DatumPointer>;

  /// `few`: some of the data evenly chosen, fits of which are cheap; `all`: what they were chosen from.
  WhatIfCauses(const ResidualTests& tests, Data few, const WhatIfFits& fits_of_few, Data all,
               const WhatIfFits& fits_of_all, double limit);

  /// The fit of the model alone to the few.
  [[nodiscard]] const WhatIfAnswer& plain() const { return plain_; }
  /// Whether that leaves as little as noise does.
  [[nodiscard]] bool fits_plainly() const { return is_small(plain_.misfit); }

  /// The first that explains the data, or else the one that takes nearly all of the misfit away. In this
  /// order: a factor (of all displacements, of a component or a series, of all but one), a shift in time,
  /// swapped components, the order of the sensors (where wanted), smoothing, frames that are missing, a
  /// factor in a region, a time base that is bent, a constant of each sensor.
  [[nodiscard]] std::optional<Tried> find(bool sensors_may_be_permuted);
  /// One sensor's own factor.
  [[nodiscard]] std::optional<Tried> factor_of_sensor(Eigen::Index sensor) const;
  [[nodiscard]] bool is_small(double misfit) const;

 private:
  [[nodiscard]] Tried judged(MisfitCause cause, const WhatIfAnswer& answer, Eigen::Index freedom,
                             std::string message) const;
  [[nodiscard]] bool takes_nearly_all(double misfit) const;
  [[nodiscard]] bool explains_all(double misfit, Eigen::Index sharing = 1) const;
  [[nodiscard]] std::optional<Tried> factor_of(const Eigen::VectorXd& rows, const std::string& what,
                                               const std::string& axis, bool is_displacement) const;
  void try_factors();
  void try_shift();
  void try_swapped_components();
  void try_sensor_order();
  void try_smoothing();
  void try_lost_frames();
  void try_regions();
  void try_time_base();
  void try_offsets();
  void add(std::optional<Tried> tried) {
    if (tried) tried_.push_back(std::move(*tried));
  }

  const ResidualTests& tests_;
  Data few_, all_;
  const WhatIfFits& fits_;
  const WhatIfFits& fits_of_all_;
  double limit_;
  WhatIfAnswer plain_;
  std::vector<Tried> tried_;
};

}  // namespace knothe::assimilation
