#include "knothe/posterior/draws/recycled_importance.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/posterior/budget_spent.hpp"
#include "knothe/posterior/checked_density.hpp"
#include "knothe/posterior/draws/control_variates.hpp"
#include "knothe/posterior/draws/importance_proposal.hpp"
#include "knothe/posterior/draws/mixture_fit.hpp"
#include "knothe/posterior/draws/outward_walks.hpp"
#include "knothe/posterior/draws/support_ends.hpp"
#include "knothe/posterior/mode_search.hpp"

namespace knothe::posterior {
namespace {

constexpr double k_infinity = std::numeric_limits<double>::infinity();
constexpr double k_tails = 8, k_flat_share = 0.15;
/// The flattened target is that of this share of β.
constexpr double k_flat = 0.5;
/// Ascents are made after so many rounds, from so many draws; draws around a mode are wider than its Laplace
/// approximation by this.
constexpr std::size_t k_rounds_before_ascents = 8;
constexpr Eigen::Index k_ascents = 4;
constexpr double k_widened = 1.2;
/// The first look beyond the draws is when errors are so many times what is tolerated. Another one is when
/// there are so many times as many draws; at once, where a single draw could have moved a moment by so many
/// times what is tolerated: there the draws are far from where the mass ends. None is made before they are
/// good, where it could have moved little.
constexpr double k_early = 3, k_more_draws = 1.5, k_far_from_end = 10, k_little = 1.5;
/// Where the first draws are worth enough only below this β, the mass is far away or small, and draws around
/// the modes that are known get there sooner.
constexpr double k_far_away = 0.3;
/// Where no first draw has any density, there are so many batches of them.
constexpr int k_first_batches = 4;
/// Walks from draws of the flattened target: in few dimensions fits to such draws miss no mode.
Eigen::Index flat_walks(Eigen::Index d) {
  return std::clamp<Eigen::Index>(d / 2, 1, 4);
}
/// Points that a fit looks at, and those that dependence of coordinates is judged by.
constexpr Eigen::Index k_fit_points = 2048, k_group_points = 1024;

MixtureProduct of_all(const Mixture& mixture) {
  std::vector<Eigen::Index> all(mixture.dimension());
  std::iota(all.begin(), all.end(), Eigen::Index{0});
  return MixtureProduct({{all, mixture}});
}

std::vector<MixtureComponent> around(const std::vector<Mode>& modes) {
  constexpr double k_min_weight = 0.01;
  std::vector<MixtureComponent> components;
  for (const Mode& m : modes)
    components.push_back({std::max(k_min_weight, std::exp(m.log_mass - modes.front().log_mass)), m.point,
                          k_widened * m.lower});
  return components;
}

/// All draws so far, as draws from the mixture of all proposals so far.
class Draws {
 public:
  explicit Draws(Eigen::Index d) : points_(0, d), reference_(Mixture::standard_normal(d)) {}

  void add(CheckedDensity& target, MixtureProduct proposal, Eigen::Index count, RandomNumbers& random) {
    proposal.sample(count, random, fresh_);
    evaluate_fresh(target);
    const Eigen::Index n = fresh_.rows();
    const double log_n = std::log(n);
    proposal.log_density(points_, part_);
    for (Eigen::Index i = 0; i < size(); ++i) log_drawn_[i] = log_sum(log_drawn_[i], log_n + part_[i]);
    proposals_.push_back({std::move(proposal), log_n});
    append(fresh_, points_);
    append(fresh_values_, log_target_);
    reference_.log_density(fresh_, part_);
    append(part_, log_reference_);
    Eigen::VectorXd sum = Eigen::VectorXd::Constant(n, -k_infinity);
    for (const Proposal& p : proposals_) {
      p.density.log_density(fresh_, part_);
      for (Eigen::Index i = 0; i < n; ++i) sum[i] = log_sum(sum[i], p.log_draws + part_[i]);
    }
    append(sum, log_drawn_);
  }

  [[nodiscard]] Eigen::Index size() const { return points_.rows(); }
  [[nodiscard]] const Eigen::MatrixXd& points() const { return points_; }
  [[nodiscard]] const Eigen::VectorXd& log_target() const { return log_target_; }
  /// Of the mixture of all proposals.
  [[nodiscard]] Eigen::VectorXd log_proposal() const {
    return (log_drawn_.array() - std::log(size())).matrix();
  }
  /// Of draws made at these points, log π̄ given: log of their normalised weights.
  [[nodiscard]] Eigen::VectorXd log_weights_at(const Eigen::MatrixXd& points,
                                               const Eigen::VectorXd& log_target) const {
    Eigen::VectorXd sum = Eigen::VectorXd::Constant(points.rows(), -k_infinity), part;
    for (const Proposal& p : proposals_) {
      p.density.log_density(points, part);
      for (Eigen::Index i = 0; i < sum.size(); ++i) sum[i] = log_sum(sum[i], p.log_draws + part[i]);
    }
    return log_target - sum - Eigen::VectorXd::Constant(sum.size(), weigh(1).log_sum);
  }
  [[nodiscard]] bool are_all_outside() const {
    return size() == 0 || !(log_target_.maxCoeff() > CheckedDensity::k_min_log_density);
  }

  /// Normalised weights for ρ^{1−β} π̄^β, the log of their sum before and their effective number.
  struct Weights {
    Eigen::VectorXd values;
    double log_sum = 0, effective_size = 0;
  };
  [[nodiscard]] Weights weigh(double beta) const {
    Weights w;
    w.values = (beta * log_target_ + (1 - beta) * log_reference_ - log_drawn_).cwiseMax(-1e300);
    const double largest = w.values.maxCoeff();
    w.values = (w.values.array() - largest).exp().matrix();
    const double sum = w.values.sum();
    w.log_sum = largest + std::log(sum);
    w.values /= sum;
    w.effective_size = 1 / w.values.squaredNorm();
    return w;
  }

  /// The largest β whose weights are worth `enough` draws.
  [[nodiscard]] double next_temperature(double enough) const {
    if (weigh(1).effective_size >= enough) return 1;
    double low = 0, high = 1;
    for (int i = 0; i < 60; ++i) {
      const double middle = low > 0 ? std::sqrt(low * high) : 0.5 * (low + high);
      (weigh(middle).effective_size >= enough ? low : high) = middle;
    }
    return low > 0 ? low : high;
  }

  /// At most `count` points for `factor` [n] times ρ^{1−β} π̄^β, with weights none of which is worth more than
  /// √n (Ionides 2008).
  [[nodiscard]] WeightedPoints at(double beta, const Eigen::VectorXd& factor, Eigen::Index count,
                                  std::uint64_t seed) const {
    WeightedPoints some{points_, weigh(beta).values.cwiseProduct(factor)};
    some.weights /= some.weights.sum();
    some.weights = some.weights.cwiseMin(1 / std::sqrt(size()));
    some.weights /= some.weights.sum();
    thin(some.points, some.weights, count, seed);
    some.weights /= some.weights.sum();
    return some;
  }

 private:
  struct Proposal {
    MixtureProduct density;
    double log_draws;
  };

  /// The first draws, from N(0, I), are independent: where the target may not be asked for all of them, those
  /// that it answers are kept.
  void evaluate_fresh(CheckedDensity& target) {
    constexpr Eigen::Index k_block = 64;
    const Eigen::Index n = fresh_.rows();
    fresh_values_.resize(n);
    const auto evaluate = [&](Eigen::Index begin, Eigen::Index size) {
      target.evaluate(fresh_.middleRows(begin, size), 0, batch_);
      fresh_values_.segment(begin, size) = batch_.value;
    };
    try {
      return evaluate(0, n);
    } catch (const BudgetSpent&) {
      if (!proposals_.empty()) throw;
    }
    Eigen::Index begin = 0;
    try {
      for (; begin < n; begin += k_block) evaluate(begin, std::min(k_block, n - begin));
    } catch (const BudgetSpent&) {
      if (begin == 0) throw;
      fresh_.conservativeResize(begin, Eigen::NoChange);
      fresh_values_.conservativeResize(begin);
    }
  }

  template <class Matrix>
  static void append(const Matrix& more, Matrix& all) {
    all.conservativeResize(all.rows() + more.rows(), more.cols());
    all.bottomRows(more.rows()) = more;
  }

  Eigen::MatrixXd points_, fresh_;
  Mixture reference_;
  Eigen::VectorXd log_target_, log_reference_, part_, fresh_values_;
  Eigen::VectorXd log_drawn_;  ///< log Σ n_r q_r, of all proposals
  std::vector<Proposal> proposals_;
  LogDensityBatch batch_;
};

Eigen::MatrixXd variables_of(const Draws& draws, const RecycledImportanceOptions& options) {
  return options.variables ? options.variables(draws.points()) : draws.points();
}

/// 1 + Σ c_k t_k², t_k: distance of each draw from the mean of variable k in standard deviations, c_k: its
/// share of the squared errors of all standard deviations. These errors are made far out, where a fit to the
/// target itself has few draws; to sample |f| π̄ is best for the mean of f.
Eigen::VectorXd emphasis(const Eigen::MatrixXd& variables, const Eigen::VectorXd& weights) {
  Eigen::ArrayXd sum = Eigen::ArrayXd::Zero(variables.rows());
  double of_all = 0;
  for (Eigen::Index k = 0; k < variables.cols(); ++k) {
    const Eigen::ArrayXd squares = (variables.col(k).array() - variables.col(k).dot(weights)).square();
    const double variance = squares.matrix().dot(weights);
    if (!(variance > 0)) continue;
    const double error = (weights.array() * (squares / variance - 1)).square().sum();
    sum += error / variance * squares;
    of_all += error;
  }
  return 1 + sum / std::max(of_all, std::numeric_limits<double>::min());
}

/// Of the support's ends those that much of the mass lies at, at most three in a group: there are as many
/// images of a draw as there are ways to mirror it.
SupportEnds pressed(const SupportEnds& ends, const WeightedPoints& target, const Groups& groups) {
  constexpr double k_near = 0.5, k_mass = 0.05;  // standard deviations, share
  constexpr int k_max_mirrored = 3;
  SupportEnds some = SupportEnds::none(target.points.cols());
  if (!ends.any()) return some;
  for (const auto& group : groups) {
    int count = 0;
    for (const Eigen::Index k : group) {
      const auto x = target.points.col(k).array();
      const double mean = x.matrix().dot(target.weights),
                   near = k_near * std::sqrt((x - mean).square().matrix().dot(target.weights));
      const auto mass = [&](const auto& at_end) {
        return at_end.template cast<double>().matrix().dot(target.weights);
      };
      if (count < k_max_mirrored && mass(x < ends.lower[k] + near) > k_mass)
        some.lower[k] = ends.lower[k], ++count;
      if (count < k_max_mirrored && mass(x > ends.upper[k] - near) > k_mass)
        some.upper[k] = ends.upper[k], ++count;
    }
  }
  return some;
}

/// Half of the points, mirrored at the nearer end: what is fitted to has no end there.
void mirror_half(const SupportEnds& ends, RandomNumbers& random, Eigen::MatrixXd& points) {
  for (Eigen::Index k = 0; k < points.cols(); ++k)
    for (Eigen::Index i = 0; ends.at(k) && i < points.rows(); ++i) {
      const double x = points(i, k);
      const bool is_low = x - ends.lower[k] < ends.upper[k] - x;
      if (random.uniform() < 0.5) points(i, k) = 2 * (is_low ? ends.lower : ends.upper)[k] - x;
    }
}

/// `enough`: what the weights of the flattened target have to be worth, else there is none: behind a prior
/// far away it may be where no draws are.
MixtureProduct fitted(const Draws& draws, double beta, double enough, const SupportEnds& all_ends,
                      const RecycledImportanceOptions& options) {
  const std::uint64_t seed = options.seed;
  const double flat_beta = draws.weigh(k_flat * beta).effective_size >= enough ? k_flat * beta : beta;
  const Eigen::VectorXd factor = emphasis(variables_of(draws, options), draws.weigh(beta).values);
  WeightedPoints target = draws.at(beta, factor, k_fit_points, seed),
                 flat = draws.at(flat_beta, Eigen::VectorXd::Ones(draws.size()), k_fit_points, seed);
  const Eigen::MatrixXd even = numerics::resample(target.points, target.weights, k_group_points, seed),
                        even_flat = numerics::resample(flat.points, flat.weights, k_group_points, seed);
  Groups groups = dependent_groups({even, even_flat},
                                   1 / std::max(target.weights.squaredNorm(), flat.weights.squaredNorm()));
  // Of many groups each needs less: the weights of a draw multiply.
  ImportanceProposal::Shares shares{k_flat_share};
  shares.flat /= std::sqrt(groups.size());
  shares.reference /= std::sqrt(groups.size());
  const SupportEnds ends = pressed(all_ends, target, groups);
  RandomNumbers random(seed);
  mirror_half(ends, random, target.points);
  mirror_half(ends, random, flat.points);
  ImportanceProposal proposal(k_tails, shares);
  proposal.fit(std::move(groups), target, flat);
  return proposal.mixtures(ends);
}

void state(const Draws& draws, const RecycledImportanceOptions& options, RecycledImportanceResult& r) {
  const Draws::Weights weights = draws.weigh(1);
  r.sample.points = draws.points();
  r.sample.weights = weights.values;
  r.sample.state_evidence(weights.log_sum);
  const Eigen::MatrixXd variables = variables_of(draws, options);
  r.state_errors(variables, options.looks_beyond ? tail_shape_of(variables, weights.values) : 0);
  r.converged = r.converged && r.temperatures.back() == 1;
}

/// At the end of the budget: errors that are too large are lowered by a fit to the draws, whose moments are
/// known.
void sharpen(const Draws& draws, const SupportEnds& all_ends, const RecycledImportanceOptions& options,
             RecycledImportanceResult& r) {
  constexpr Eigen::Index k_points = 8192;
  WeightedPoints target = draws.at(1, Eigen::VectorXd::Ones(draws.size()), k_points, options.seed);
  const Eigen::MatrixXd even =
      numerics::resample(target.points, target.weights, k_group_points, options.seed);
  const Groups groups = dependent_groups({even}, 1 / target.weights.squaredNorm());
  const SupportEnds ends = pressed(all_ends, target, groups);
  RandomNumbers random(options.seed);
  mirror_half(ends, random, target.points);
  std::vector<MixtureProduct::Factor> factors;
  for (const auto& group : groups)
    factors.push_back({group, Mixture(fit_mixture(columns_of(target.points, group), target.weights))});
  const Eigen::MatrixXd variables = variables_of(draws, options);
  const MixtureProduct close(std::move(factors), ends, 0);
  const auto calibrated =
      calibrate(control_variates(close, draws.points(), draws.log_proposal(), options.variables, random),
                r.sample.weights, variables);
  if (!calibrated) return;
  const double log_evidence = r.sample.log_evidence;
  r.sample.weights = calibrated->weights;
  r.sample.state_evidence(log_evidence);
  r.state_errors(calibrated->errors, r.tail_shape);
}

/// The modes that are known and those that ascents lead to; these fail, or are too many: then draws go on
/// without.
std::vector<Mode> climb(CheckedDensity& target, const Eigen::MatrixXd& starts, std::vector<Mode> modes,
                        const std::function<bool()>& is_enough) {
  try {
    ModeSearch().ascend_from(target, starts, modes, is_enough);
  } catch (const NumericalError&) {
  }
  return modes;
}

/// `flat`: β of a flattened target, whose draws may come to modes that no other draw comes to. Nothing, if
/// walks fail.
std::optional<MassBeyond> look_beyond(CheckedDensity& target, const Draws& draws, double flat,
                                      const RecycledImportanceOptions& options, int turn) try {
  const std::uint64_t seed = options.seed + turn;
  const Eigen::MatrixXd variables = variables_of(draws, options);
  const Eigen::VectorXd weights = draws.weigh(1).values;
  const CheckedDensity::Leniency lenient(target);
  return walk_outwards(
      target,
      {draws.points(), variables, weights,
       [&](const auto& points, const auto& values) { return draws.log_weights_at(points, values); },
       options.variables,
       draws.at(flat, Eigen::VectorXd::Ones(draws.size()), flat_walks(draws.points().cols()), seed).points},
      {.seed = seed});
} catch (const BudgetSpent&) {
  throw;
} catch (const NumericalError&) {
  return std::nullopt;
}

/// When walks look beyond the draws: when these are good, and now and then before. Draws at places found are
/// judged after a fit to them, but for the last few.
struct Looks {
  int count = 0;
  bool early = true, is_fitted = true;
  double next = 0;  ///< number of draws

  [[nodiscard]] bool is_due(const RecycledImportanceResult& r, bool is_good, Eigen::Index draws) const {
    return is_fitted &&
           (is_good || (early && draws >= next && r.temperatures.back() == 1 && r.is_within(k_early)));
  }
  void add(const MassBeyond& beyond, bool is_good, Eigen::Index draws) {
    ++count;
    const double moved = std::max(beyond.mean_shift / ImportanceResult::k_mean_tolerance,
                                  beyond.deviation_shift / ImportanceResult::k_deviation_tolerance);
    const bool is_far = moved > k_far_from_end;
    early = early && !is_good && beyond.found() && moved > k_little;
    is_fitted = !beyond.found() || (is_good && !is_far);
    next = is_far ? 0 : k_more_draws * draws;
  }
  void go_on() { is_fitted = true; }
};

}  // namespace

RecycledImportanceResult recycled_importance(LogDensity& user_target,
                                             const RecycledImportanceOptions& options) {
  CheckedDensity target(user_target);
  const Eigen::Index d = target.dimension();
  const double enough = std::max(150.0, 20.0 * d);
  RandomNumbers random(options.seed);
  Draws draws(d);
  const auto spent = [&] { return options.spent ? options.spent() : target.evaluations(); };
  const std::int64_t for_walks = options.looks_beyond ? cost_of_walks(d, flat_walks(d)) : 0;
  const auto in_a_round = [&] {
    return std::min<Eigen::Index>(options.draws, options.max_evaluations - spent() - for_walks);
  };
  const auto affordable = [&] { return in_a_round() >= std::max<Eigen::Index>(1, options.draws / 4); };
  const auto report = [&] {
    const double share = spent() / static_cast<double>(options.max_evaluations);
    if (options.progress && !options.progress(std::min(1.0, share)))
      throw Interrupted(fmt::format("smc: interrupted after {} draws", draws.size()));
  };
  const auto add_around = [&](std::vector<MixtureComponent> places, Eigen::Index count) {
    draws.add(target, of_all(Mixture(std::move(places), k_tails)), std::min(count, in_a_round()), random);
  };
  const Eigen::Index some = (options.draws + 1) / 2;
  report();
  for (int batch = 0; batch < k_first_batches && draws.are_all_outside() && (batch == 0 || affordable());
       ++batch)
    draws.add(target, of_all(Mixture::standard_normal(d)), options.draws, random);
  if (draws.are_all_outside() && !options.modes.empty() && affordable())
    add_around(around(options.modes), some);
  if (draws.are_all_outside())
    throw NumericalError(
        fmt::format("smc: the density is zero at all {} first draws from N(0, I)", draws.size()));
  RecycledImportanceResult result;
  bool ascended = false;
  std::optional<SupportEnds> ends;
  Looks looks;
  try {
    if (const double beta = draws.next_temperature(enough);
        beta < k_far_away && !options.modes.empty() && affordable()) {
      result.temperatures.push_back(beta);
      add_around(around(options.modes), options.draws);
    }
    while (true) {
      const double beta = draws.next_temperature(enough);
      result.temperatures.push_back(beta);
      state(draws, options, result);
      const bool is_good = result.is_done(options.share_of_tolerance);
      if (!result.converged && beta == 1 && ends && !affordable()) sharpen(draws, *ends, options, result);
      if (!affordable() || (options.looks_beyond ? looks.is_due(result, is_good, draws.size()) : is_good)) {
        if (!options.looks_beyond || !(result.converged || affordable())) break;
        result.mass_beyond = looks.count > 0;  // until it is seen that nothing is left
        if (spent() + for_walks > options.max_evaluations) break;
        const std::optional<MassBeyond> beyond =
            look_beyond(target, draws, result.temperatures.front(), options, looks.count);
        if (!beyond) break;
        result.mass_beyond = beyond->found();
        looks.add(*beyond, is_good, draws.size());
        if ((is_good && !beyond->found()) || !affordable()) break;
        report();
        if (beyond->found()) {
          add_around(beyond->places, some);
          continue;
        }
      }
      report();
      const bool can_fit = draws.weigh(beta).effective_size >= 2 * (d + 2);
      if (beta < 1 && !ascended && (!can_fit || result.temperatures.size() >= k_rounds_before_ascents)) {
        ascended = true;
        const std::int64_t enough_spent = spent() + (options.max_evaluations - spent()) / 4;
        const std::vector<Mode> modes =
            climb(target, draws.at(beta, Eigen::VectorXd::Ones(draws.size()), k_ascents, options.seed).points,
                  options.modes, [&] { return spent() > enough_spent; });
        if (!affordable()) break;
        if (!modes.empty()) add_around(around(modes), some);
      } else {
        if (!ends && can_fit) ends = find_support_ends(target, draws.points(), draws.log_target());
        draws.add(
            target,
            can_fit ? fitted(draws, beta, enough / 3, *ends, options) : of_all(Mixture::standard_normal(d)),
            in_a_round(), random);
      }
      looks.go_on();
    }
  } catch (const BudgetSpent&) {  // what there is so far is the answer
    if (result.sample.points.rows() == 0) state(draws, options, result);
    result.converged = false;
  }
  result.sample.density_evaluations = target.evaluations();
  return result;
}

}  // namespace knothe::posterior
