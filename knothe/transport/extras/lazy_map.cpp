#include "knothe/transport/extras/lazy_map.hpp"

#include <fmt/format.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/numerics/integrate/sobol.hpp"
#include "knothe/numerics/linear/symmetric_eigen.hpp"
#include "knothe/numerics/statistics/random.hpp"
#include "knothe/transport/diagnose/map_evidence.hpp"
#include "knothe/transport/diagnose/trust.hpp"
#include "knothe/transport/map/pull_back.hpp"
#include "knothe/transport/solve/map_solver_workspace.hpp"

namespace knothe::transport {

namespace {

constexpr std::uint64_t k_layer_seed = 0x6c617a79, k_diagnostic_seed = 0x48;  // never those of verification

/// n points like N(0, I), quasi-random in as many leading coordinates as the table of Sobol numbers has.
Eigen::MatrixXd reference_points(Eigen::Index n, Eigen::Index d, std::uint64_t seed) {
  const Eigen::Index quasi = std::min(d, numerics::k_sobol_max_dimension);
  Eigen::MatrixXd x(n, d);
  x.leftCols(quasi) = numerics::sobol_normal_points(n, quasi, seed);
  if (quasi < d) x.rightCols(d - quasi) = numerics::monte_carlo_normal_points(n, d - quasi, seed + 1);
  if (n > 2 * d) numerics::match_standard_moments(x);
  return x;
}

/// The pulled-back target on a bundle of r-dimensional planes, plane i through the point base_i: log π̃(base_i
/// + U y_i) − log ρ(base_i). For exactly one y per plane. Second derivatives along U by differences of first
/// ones.
class PlaneDensity final : public sampling::LogDensity {
 public:
  PlaneDensity(PullBackDensity& target, Eigen::MatrixXd base, const Eigen::MatrixXd& basis)
      : target_(&target), base_(std::move(base)), basis_(basis) {
    log_base_ = (0.5 * base_.rowwise().squaredNorm()).array() +
                0.5 * static_cast<double>(basis.rows() - basis.cols()) * std::log(2 * std::numbers::pi);
  }
  [[nodiscard]] Eigen::Index dimension() const override { return basis_.cols(); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& y, int derivatives,
                sampling::LogDensityBatch& out) override {
    points_.noalias() = y * basis_.transpose();
    points_ += base_;
    evaluate_at_points(std::min(derivatives, 1));
    out.value = batch_.value + log_base_;
    if (derivatives < 1) return;
    out.gradient.noalias() = batch_.gradient * basis_;
    if (derivatives < 2) return;
    constexpr double k_step = 1e-5;
    Eigen::MatrixXd difference(y.rows(), basis_.cols());
    for (Eigen::Index b = 0; b < basis_.cols(); ++b) {
      points_.rowwise() += k_step * basis_.col(b).transpose();
      evaluate_at_points(1);
      points_.rowwise() -= k_step * basis_.col(b).transpose();
      difference.noalias() = (batch_.gradient * basis_ - out.gradient) / k_step;
      for (Eigen::Index a = 0; a < basis_.cols(); ++a) {
        auto entry = out.hessian.col(sampling::packed_index(a, b));
        entry =
            a < b ? Eigen::VectorXd(0.5 * (entry + difference.col(a))) : Eigen::VectorXd(difference.col(a));
      }
    }
  }
  [[nodiscard]] std::int64_t evaluations() const { return evaluations_; }

 private:
  void evaluate_at_points(int derivatives) {
    batch_.resize(points_.rows(), points_.cols(), derivatives);
    target_->evaluate(points_, derivatives, batch_);
    evaluations_ += points_.rows();
  }

  PullBackDensity* target_;
  Eigen::MatrixXd base_, basis_, points_;
  Eigen::VectorXd log_base_;
  sampling::LogDensityBatch batch_;
  std::int64_t evaluations_ = 0;
};

/// A target whose every evaluation is checked.
class Checked final : public sampling::LogDensity {
 public:
  explicit Checked(sampling::LogDensity& target) : checked_(target) {}
  [[nodiscard]] Eigen::Index dimension() const override { return checked_.dimension(); }
  [[nodiscard]] int available_derivatives() const override { return checked_.available_derivatives(); }
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int derivatives,
                sampling::LogDensityBatch& out) override {
    checked_.evaluate(z, derivatives, out);
  }
  [[nodiscard]] std::int64_t evaluations() const { return checked_.evaluations(); }

 private:
  sampling::CheckedDensity checked_;
};

void require(const LazyMapOptions& o, const sampling::LogDensity& target) {
  if (!(o.tolerance > 0))
    throw UsageError(fmt::format("lazy map: tolerance {} is not positive", o.tolerance));
  if (o.max_layers < 0 || o.max_rank < 1)
    throw UsageError(fmt::format("lazy map: {} layers of rank {} at most; layers ≥ 0 and rank ≥ 1 are needed",
                                 o.max_layers, o.max_rank));
  if (o.max_order < 1 || o.max_order > k_max_order)
    throw UsageError(fmt::format("lazy map: order {}; 1 to {} are possible", o.max_order, k_max_order));
  if (o.diagnostic_points < 16 || o.training_points < 16 || o.verification_points < 16)
    throw UsageError(
        "lazy map: at least 16 points are needed for diagnostic, training and verification each");
  if (target.dimension() < 1) throw UsageError("lazy map: the density has no variables");
  if (target.available_derivatives() < 1)
    throw UsageError(
        "lazy map: the density gives no gradient, from which the informed directions are found; give one, "
        "or use a triangular map in all variables");
}

/// Largest exponent ≤ 1 such that weights exp(exponent · log w) have at least this effective share.
double even_exponent(const Eigen::VectorXd& log_weight, double share) {
  const auto ess = [&](double exponent) {
    double result = 0;
    (void)normalised_weights(exponent * log_weight, &result);
    return result;
  };
  if (ess(1) >= share) return 1;
  double low = 0, high = 1;
  for (int k = 0; k < 30; ++k) {
    const double middle = 0.5 * (low + high);
    (ess(middle) >= share ? low : high) = middle;
  }
  return low;
}

/// H of the composition so far: eigenvalues decreasing, with their vectors.
struct Diagnostic {
  Eigen::VectorXd eigenvalues;
  Eigen::MatrixXd vectors;
  double weight_exponent = 0;

  Diagnostic(PullBackDensity& pulled, Eigen::Index n, std::uint64_t seed) {
    const Eigen::Index d = pulled.dimension();
    const Eigen::MatrixXd x = reference_points(n, d, seed);
    sampling::LogDensityBatch batch;
    batch.resize(n, d, 1);
    pulled.evaluate(x, 1, batch);
    Eigen::VectorXd log_weight = batch.value - standard_normal_log_density(x);
    const double floor = log_weight.maxCoeff() - 1000;
    log_weight = log_weight.cwiseMax(floor);
    // Under the target itself the bound holds; where the weights are too uneven, under a distribution
    // between.
    weight_exponent = even_exponent(log_weight, 0.3);
    const Eigen::VectorXd w = normalised_weights(weight_exponent * log_weight);
    const Eigen::MatrixXd g = batch.gradient + x;
    const Eigen::MatrixXd h = g.transpose() * w.asDiagonal() * g;
    const numerics::SymmetricEigen eigen(h);
    eigenvalues = eigen.eigenvalues().reverse().cwiseMax(0.0);
    vectors = eigen.eigenvectors().rowwise().reverse();
  }
  [[nodiscard]] double half_trace() const { return 0.5 * eigenvalues.sum(); }
  [[nodiscard]] double bound(Eigen::Index r) const {
    return 0.5 * eigenvalues.tail(eigenvalues.size() - r).sum();
  }
  /// The smallest r that leaves little, by the tolerance or by the whole.
  [[nodiscard]] Eigen::Index rank(double tolerance, Eigen::Index max_rank) const {
    const double enough = std::max(0.25 * tolerance, 2e-3 * half_trace());
    const Eigen::Index most = std::min(max_rank, eigenvalues.size());
    for (Eigen::Index r = 1; r < most; ++r)
      if (bound(r) <= enough) return r;
    return most;
  }
};

/// Everything a solve keeps between its steps.
class LazySolve {
 public:
  LazySolve(sampling::LogDensity& target, const LazyMapOptions& options)
      : options_(options), user_target_(&target), target_(target) {}

  LazyMapResult run() {
    find_modes();
    verify();
    result_.laplace_diagnostic = result_.verified_diagnostic;
    bool stalled = false;
    while (result_.verified_diagnostic > options_.tolerance &&
           static_cast<int>(result_.layers.size()) < options_.max_layers && !stalled)
      stalled = !add_layer();
    PullBackDensity pulled(result_.map, target_);
    result_.half_trace =
        Diagnostic(pulled, options_.diagnostic_points, k_diagnostic_seed + result_.layers.size())
            .half_trace();
    result_.tolerance_reached = result_.verified_diagnostic <= options_.tolerance;
    if (!result_.tolerance_reached) explain(stalled);
    look_at_other_modes();
    result_.density_evaluations = search_evaluations_ + target_.evaluations();
    return std::move(result_);
  }

 private:
  void find_modes() {
    const Eigen::Index d = target_.dimension();
    result_.map = ComposedMap(d);
    if (!options_.laplace) return;
    sampling::CheckedDensity checked(*user_target_);  // itself: a search excuses what happens far away
    sampling::ModeSearch().run(checked, options_.search_modes, modes_);
    search_evaluations_ = checked.evaluations();
    const auto best = std::max_element(modes_.begin(), modes_.end(),
                                       [](const auto& a, const auto& b) { return a.value < b.value; });
    result_.mode = best->point;
    result_.mode_log_density = best->value;
    result_.map.append(AffineMap{modes_.front().point, modes_.front().lower});
  }

  void verify() {
    result_.verification = weigh_verification();
    diagnose(result_.verification.log_weight, result_.verified_diagnostic, result_.verified_objective);
  }

  WeightedPoints weigh_verification() {
    WeightedPoints points;
    points.reference =
        reference_points(options_.verification_points, target_.dimension(), options_.seed + 0x76);
    MapTrace trace;
    trace.evaluate(result_.map, points.reference, false);
    if (!trace.value().allFinite())
      throw NumericalError("lazy map: the image of a verification point is not finite; scale the parameters");
    sampling::LogDensityBatch batch;
    batch.resize(points.reference.rows(), points.reference.cols(), 0);
    target_.evaluate(trace.value(), 0, batch);
    points.log_weight = batch.value + trace.log_determinant() - standard_normal_log_density(points.reference);
    points.points = trace.value();
    return points;
  }

  /// One layer; false (and nothing changed) if it does not help.
  bool add_layer() {
    PullBackDensity pulled(result_.map, target_);
    const std::uint64_t index = result_.layers.size();
    const Diagnostic diagnostic(pulled, options_.diagnostic_points, k_diagnostic_seed + index);
    LazyLayer layer;
    layer.eigenvalues = diagnostic.eigenvalues;
    layer.weight_exponent = diagnostic.weight_exponent;
    const Eigen::Index r = diagnostic.rank(options_.tolerance, options_.max_rank);
    layer.rank = static_cast<int>(r);
    layer.bound = diagnostic.bound(r);
    const TriangularMap tau = train(pulled, diagnostic, layer);
    const WeightedPoints before = result_.verification;
    const double diagnostic_before = result_.verified_diagnostic,
                 objective_before = result_.verified_objective;
    result_.map.append(SubspaceMap(diagnostic.vectors.leftCols(r), tau));
    verify();
    layer.verified_diagnostic = result_.verified_diagnostic;
    if (result_.verified_diagnostic > 0.95 * diagnostic_before) {
      result_.map.pop_back();
      result_.verification = before;
      result_.verified_diagnostic = diagnostic_before;
      result_.verified_objective = objective_before;
      return false;
    }
    result_.layers.push_back(std::move(layer));
    return true;
  }

  /// τ of increasing order on points of R^d: their coordinates along U are the nodes of τ, the rest stays.
  TriangularMap train(PullBackDensity& pulled, const Diagnostic& diagnostic, LazyLayer& layer) {
    const Eigen::Index d = pulled.dimension(), r = layer.rank;
    const auto coefficients = TriangularMap(r, options_.max_order).coefficients().size();
    Eigen::Index n = 16;
    while (n < std::max(options_.training_points, 8 * coefficients)) n *= 2;
    // The first, best coordinates of the quasi-random points go along U.
    const Eigen::MatrixXd x = reference_points(n, d, k_layer_seed + result_.layers.size());
    const Eigen::MatrixXd basis = diagnostic.vectors.leftCols(r);
    PlaneDensity planes(pulled, x.rightCols(d - r) * diagnostic.vectors.rightCols(d - r).transpose(), basis);
    sampling::CheckedDensity checked(planes);
    const numerics::PointRule rule{x.leftCols(r), Eigen::VectorXd::Constant(n, 1.0 / static_cast<double>(n))};

    const OuterMap no_outer_map = OuterMap::of(AffineMap::identity(r));
    TriangularMap best(r, 1, options_.radii), current;
    double best_diagnostic = std::numeric_limits<double>::infinity();
    for (int order = 1, worse = 0; order <= options_.max_order && worse < 2; ++order) {
      TriangularMap next(r, order, options_.radii);
      if (order > 1) next.embed(current);
      current = std::move(next);
      const TrainingTables tables(rule, current);
      Eigen::VectorXd a, in_map;
      tables.layout.gather(current.coefficients(), a);
      objective_.begin(tables, no_outer_map, checked, -result_.verified_objective);
      numerics::TrustRegionOptions newton;
      newton.max_iterations = 40;
      newton.decrease_tolerance = 1e-3 * options_.tolerance;
      const auto summary = newton_.minimise(objective_, newton, a);
      if (summary.termination == numerics::Termination::start_infeasible) break;
      result_.iterations += summary.iterations;
      tables.layout.scatter(a, in_map);
      current.set_coefficients(in_map);
      const double now = objective_.variance_diagnostic(a);
      worse = now > 0.85 * best_diagnostic ? worse + 1 : 0;
      if (now < best_diagnostic) {
        best_diagnostic = now;
        best = current;
        layer.order = order;
        layer.training_diagnostic = now;
        result_.training_objective = summary.value;
      }
      if (now <= 0.5 * options_.tolerance) break;
    }
    return best;
  }

  void explain(bool stalled) {
    result_.reason = fmt::format(
        "the variance diagnostic is {:.2g} with {} layers on points not used for training, above the "
        "tolerance {:.2g}; "
        "{}",
        result_.verified_diagnostic, result_.layers.size(), options_.tolerance,
        stalled ? "a further layer does not lower it: allow a higher rank or order, or more training points"
                : fmt::format("max_layers is {}", options_.max_layers));
  }

  /// As in MapSolver: a mode is missed if the normalised target there exceeds the map's own density.
  void look_at_other_modes() {
    if (modes_.size() < 2) return;
    const auto& log_weight = result_.verification.log_weight;
    const double top = log_weight.maxCoeff();
    const double log_evidence = top + std::log((log_weight.array() - top).exp().mean());
    for (std::size_t i = 1; i < modes_.size(); ++i) {
      if (modes_[i].log_mass < modes_[0].log_mass + std::log(options_.mode_mass)) continue;
      const double approximation = result_.map.log_density(modes_[i].point.transpose())[0];
      if (modes_[i].value - log_evidence > approximation + 1) {
        result_.second_mode_found = true;
        result_.second_mode = modes_[i].point;
        return;
      }
    }
  }

  LazyMapOptions options_;
  sampling::LogDensity* user_target_;
  Checked target_;
  std::int64_t search_evaluations_ = 0;
  LazyMapResult result_;
  std::vector<sampling::Mode> modes_;
  KullbackLeiblerObjective objective_;
  numerics::NewtonTrustRegion newton_;
};

}  // namespace

LazyMapResult solve_lazy_map(sampling::LogDensity& target, const LazyMapOptions& options) {
  require(options, target);
  return LazySolve(target, options).run();
}

ImportanceCorrection correct(const LazyMapResult& result) {
  ImportanceCorrection c;
  const auto& log_weight = result.verification.log_weight;
  const auto n = static_cast<double>(log_weight.size());
  c.weights = normalised_weights(log_weight, &c.ess);
  const double top = log_weight.maxCoeff();
  c.log_evidence = top + std::log((log_weight.array() - top).exp().mean());
  c.log_evidence_error = std::sqrt(std::max(0.0, 1 / c.ess - 1) / n);
  c.points = result.verification.points;
  const Moments moments = moments_of(c.points, c.weights);
  c.mean = moments.mean;
  c.covariance = moments.covariance;
  const auto levels = static_cast<Eigen::Index>(c.levels.size());
  c.quantiles.resize(c.points.cols(), levels);
  numerics::WeightedQuantiles quantiles;
  std::vector<double> row(c.levels.size());
  for (Eigen::Index a = 0; a < c.points.cols(); ++a) {
    quantiles.compute({c.points.col(a).data(), static_cast<std::size_t>(c.points.rows())},
                      {c.weights.data(), static_cast<std::size_t>(c.weights.size())}, c.levels, row);
    c.quantiles.row(a) = Eigen::Map<const Eigen::RowVectorXd>(row.data(), levels);
  }
  c.map_log_evidence = result.map_log_evidence();
  const Trust trust = judge_trust({result.verified_diagnostic, c.ess, result.second_mode_found, ""});
  c.trusted = trust.trusted;
  c.trust_reason = trust.reason;
  return c;
}

}  // namespace knothe::transport
