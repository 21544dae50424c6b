#pragma once
/// @file Least squares of the model to data under an assumption on what is wrong with them.
#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "knothe/assimilation/verdict/residual_tests.hpp"

namespace knothe::assimilation {

/// What is assumed of data d: d_i(t) = f_i y_{o(i)}(p, t + δ) + noise.
struct WhatIf {
  std::vector<Eigen::Index> order;  ///< o, n; empty: the sensors' own
  Eigen::VectorXd scaled;  ///< n: 1 where the free factor f applies, 0 where f_i = 1; empty: no factor
  bool shifted = false;    ///< δ is free, in steps of the model's time
  bool robust = false;     ///< Cauchy weights: values far off hardly count
};

struct WhatIfAnswer {
  Eigen::VectorXd p;             ///< d
  double factor = 1, shift = 0;  ///< f and δ
  double misfit = 0;             ///< Σ squares of the scores (robust: Cauchy's)
  Eigen::MatrixXd scores;        ///< n × m; 0 where missing
};

/// Fits of one set of data.
class WhatIfFits {
 public:
  /// `starts`: k × d points of the parameters to begin at. The data must outlive this.
  WhatIfFits(const model::ObservedModel& model, const ResidualTests& tests,
             std::span<const likelihood::DatumPointer> data, Eigen::MatrixXd starts);

  [[nodiscard]] WhatIfAnswer fit(const WhatIf& assumption) const;
  /// y at p, n × m.
  [[nodiscard]] Eigen::MatrixXd predicted(const Eigen::VectorXd& p) const;
  [[nodiscard]] const Eigen::MatrixXd& values() const { return values_; }  ///< n × m; NaN where missing
  [[nodiscard]] const Eigen::MatrixXd& starts() const { return starts_; }
  [[nodiscard]] Eigen::Index present() const { return present_; }

 private:
  struct Point;
  [[nodiscard]] Eigen::MatrixXd at_shifted(const Eigen::VectorXd& w, double shift, bool with_lift,
                                           Eigen::MatrixXd* slope) const;
  void evaluate(const WhatIf& assumption, Point& point, bool derivatives) const;
  void set_best_factor(const WhatIf& assumption, Point& point) const;

  const model::ObservedModel& model_;
  const ResidualTests& tests_;
  std::vector<std::size_t> time_indices_;
  Eigen::MatrixXd values_, starts_;
  Eigen::Index present_ = 0;
};

}  // namespace knothe::assimilation
