#pragma once
/// @file Does the model still explain the data? (Rubio et al. 2019, §4.3, as a test with a stated rate of
/// false alarms.)
#include <Eigen/Core>

#include "knothe/assimilation/monitor/cusum.hpp"
#include "knothe/likelihood/step/posterior_functions.hpp"
#include "knothe/likelihood/step/step_form.hpp"

namespace knothe::assimilation {

/// What was expected of a datum, and what came.
struct PredictiveCheck {
  /// P(misfit of a datum drawn from the posterior predictive distribution ≥ that of this datum), beyond what
  /// the parameters can explain. ½ where the datum has no more values than there are parameters.
  double upper_probability = 0.5;
  /// d: P(the datum's component along the direction in which the prediction moves with parameter a ≤ this
  /// one). Near 1, again and again, the data ask for larger values of it than the data before did. ½ for a
  /// parameter that the datum says nothing about.
  Eigen::VectorXd lower_probability;
  double log_density = 0;  ///< log p(d_i | data before), by the mean over the points of `w`
};

/// The posterior-predictive probability transforms (Rosenblatt 1952; Dawid 1984) of a datum, each uniform on
/// (0, 1) and all of them independent, within a datum and from datum to datum, while the model is right.
///
/// The datum is predicted by the points p_k of the posterior before it, as d = y(p_k) + e, e ~ N(0, R). First
/// come its components along the d directions, orthonormal in the metric of R⁻¹, in which the prediction
/// moves with the parameters: normal given p_k, so their distribution functions are means over k, each
/// weighted by what the components before say of p_k. What is left is the misfit outside of these directions,
/// noncentral χ² given p_k. Exact for a posterior of any shape, and all from the quadratic form of the datum:
/// the cost does not depend on n. `central`: w₀ of the form.
[[nodiscard]] PredictiveCheck predictive_check(const likelihood::StepForm& form,
                                               const likelihood::PosteriorFunctions& w,
                                               const Eigen::VectorXd& central);

struct MonitorOptions {
  /// A model that is right rings the alarm once in so many data on average: a day of a picture every 5 s.
  double average_run_length = 17280;
  /// Of the cumulative sums: half the drift, in standard deviations of a datum's score, that it is best for.
  double reference = 0.5;
  /// Scores are cut to ± this: one bad picture alone never rings the alarm.
  double largest_score = 4;
  /// Correction ends when the model without it predicts the data better by this logarithm of a Bayes factor:
  /// "decisive" on the scale of Jeffreys.
  double switch_off = 4.605170185988092;
  int smoothing = 10;  ///< data in the moving average of the evidence's increments, for plots
};

/// What the monitor says after a datum.
struct MonitorReport {
  double upper_probability = 0.5;  ///< of `PredictiveCheck`
  /// The largest of the cumulative sums: of the misfit's scores −Φ⁻¹(upper_probability), and, for each
  /// parameter, of the scores ±Φ⁻¹(lower_probability).
  double cumulative_sum = 0;
  double threshold = 0;           ///< above it, the alarm
  bool alarm = false;             ///< the model used does not explain the data
  double smoothed_increment = 0;  ///< moving average of the increments of the log-evidence
  /// Posterior mean of the size κ of the model's discrepancy, in units of the prior's spread of the
  /// prediction (`JointDiscrepancy`); 0 where nothing is corrected.
  double discrepancy = 0;
};

/// Φ⁻¹(probability), cut to ± `largest`.
[[nodiscard]] double predictive_score(double probability, double largest);

}  // namespace knothe::assimilation
