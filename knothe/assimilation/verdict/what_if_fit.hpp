#pragma once
/// @file Least-squares fits of data under an assumption of what is wrong with them.
#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "knothe/assimilation/verdict/residual_tests.hpp"

namespace knothe::assimilation {

/// What is assumed of n sensors' data d at m times: d_i(t_k) = f_i y_{o(i)}(p, t_k + δ_k) + c_i + noise.
struct WhatIf {
  std::vector<Eigen::Index> order;  ///< o, n; empty: the sensors' own
  Eigen::VectorXd scaled;  ///< n: 1 where the free factor f applies, 0 where f_i = 1; empty: no factor
  Eigen::MatrixXd delays;  ///< m × q: δ = delays · s with free s, in steps of the model's time; empty: none
  Eigen::MatrixXd smoothing;  ///< m × m: the data are the true ones times this; empty: themselves
  bool own_factors = false;   ///< each sensor has a free factor
  bool offsets = false;       ///< each sensor has a free constant
  bool robust = false;        ///< Cauchy weights: values far off hardly count
};

struct WhatIfAnswer {
  Eigen::VectorXd p;         ///< d
  double factor = 1;         ///< f
  Eigen::VectorXd shifts;    ///< s, q
  double misfit = 0;         ///< Σ squares of the scores (robust: Cauchy's)
  Eigen::MatrixXd scores;    ///< n × m; 0 where missing
  Eigen::VectorXd factors;   ///< n, where each sensor has its own
  Eigen::VectorXd response;  ///< n: Σ_t (y_i / σ_i)², what the factors were found from
};

/// Fits of one set of data.
class WhatIfFits {
 public:
  /// `starts`: k × d points of the parameters to begin at. The data must outlive this.
  WhatIfFits(const model::ObservedModel& model, const ResidualTests& tests,
             std::span<const likelihood::DatumPointer> data, Eigen::MatrixXd starts);

  /// From the best of the starts, or from `p` and `shifts`.
  [[nodiscard]] WhatIfAnswer fit(const WhatIf& assumption) const;
  [[nodiscard]] WhatIfAnswer fit_from(const WhatIf& assumption, const Eigen::VectorXd& p,
                                      const Eigen::VectorXd& shifts) const;
  /// The scores there, n × m, nothing fitted but what is linear.
  [[nodiscard]] Eigen::MatrixXd scores_at(const WhatIf& assumption, const Eigen::VectorXd& p,
                                          const Eigen::VectorXd& shifts) const;
  /// y at p, n × m.
  [[nodiscard]] Eigen::MatrixXd predicted(const Eigen::VectorXd& p) const;
  /// The same of other values (n × m; NaN: missing).
  [[nodiscard]] WhatIfFits with(const Eigen::MatrixXd& values) const;
  [[nodiscard]] const Eigen::MatrixXd& values() const { return values_; }  ///< n × m; NaN where missing
  [[nodiscard]] const Eigen::MatrixXd& starts() const { return starts_; }
  [[nodiscard]] Eigen::Index present() const { return present_; }

 private:
  struct Point;
  [[nodiscard]] Eigen::MatrixXd at_shifted(const Eigen::VectorXd& w, const Eigen::VectorXd& shift,
                                           bool with_lift, Eigen::MatrixXd* slope) const;
  void evaluate(const WhatIf& assumption, Point& point, bool derivatives) const;
  void eliminate(const WhatIf& assumption, const Eigen::MatrixXd& y, Point& point) const;
  void set_best_factor(const WhatIf& assumption, Point& point) const;
  void descend(const WhatIf& assumption, Point& point) const;
  void set_values(Eigen::MatrixXd values);

  const model::ObservedModel* model_;
  const ResidualTests* tests_;
  std::vector<std::size_t> time_indices_;
  Eigen::MatrixXd values_, starts_;
  Eigen::MatrixXd there_;   ///< n × m: 1/σ where there is a value, else 0
  Eigen::MatrixXd scaled_;  ///< n × m: values over σ, else 0
  Eigen::Index present_ = 0;
};

}  // namespace knothe::assimilation
