#include "knothe/imaging/correlation/correlation_stage.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/imaging/correlation/element_residuals.hpp"
#include "knothe/imaging/crack/strain.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::imaging {

namespace {

constexpr int k_rejection_rounds = 8;
constexpr int k_plain_steps = 4;  // without regularisation, from what was found with it
constexpr double k_share_of_worst =
    0.8;                          // of the residual of the worst neighbour, to be taken out in the same round
constexpr double k_large = 0.05;  // of a mean displacement gradient: about 3°
constexpr double k_spot = 0.1;    // of an element's pixels, at most: a grain of dust, a reflection …
constexpr double k_beside_spot = 2;  // … where the rest has no more than so many times the usual residual
constexpr int k_readmissions = 3;    // each may bring one more row of elements back
constexpr double k_max_restless = 0.05;  // of the nodes: more is a picture that does not converge …
constexpr double k_restless_rows = 2;  // … if they are also more than so many rows from side to side: a crack

}  // namespace

CorrelationStage::CorrelationStage(ReferenceField reference, ImageMesh mesh,
                                   const CorrelationOptions& options)
    : reference_(std::move(reference)),
      mesh_(std::move(mesh)),
      pixels_(mesh_, reference_.width, reference_.height),
      options_(options) {
  make_constants();
  make_pattern();
  sums_.resize(mesh_.elements.size());
  rights_.assign(mesh_.elements.size(), Eigen::Matrix<double, 8, 1>::Zero());
  element_brightness_.assign(mesh_.elements.size(), {1.0F, 0.0F});
  element_step_.assign(mesh_.elements.size(), {0.0, 0.0});
}

/// Rows 2a and 2a + 1 stand side by side in columns 2b and 2b + 1, which have the same pattern.
void CorrelationStage::make_pattern() {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(64 * mesh_.elements.size());
  for (const auto& nodes : mesh_.elements)
    for (int a = 0; a < 2 * ImageMesh::nodes_of(nodes); ++a)
      for (int b = 0; b < 2 * ImageMesh::nodes_of(nodes); ++b)
        entries.emplace_back(2 * nodes[a / 2] + a % 2, 2 * nodes[b / 2] + b % 2, 0.0);
  pattern_.resize(2 * mesh_.node_count(), 2 * mesh_.node_count());
  pattern_.setFromTriplets(entries.begin(), entries.end());
  const int *begin = pattern_.outerIndexPtr(), *row = pattern_.innerIndexPtr();
  places_.resize(mesh_.elements.size());
  for (Index e = 0; e < std::ssize(places_); ++e) {
    const auto& nodes = mesh_.elements[e];
    const std::size_t count = ImageMesh::nodes_of(nodes);
    for (std::size_t a = 0; a < count; ++a)
      for (std::size_t b = 0; b < count; ++b) {
        const int column = 2 * nodes[b];
        places_[e][4 * a + b] =
            std::lower_bound(row + begin[column], row + begin[column + 1], 2 * nodes[a]) - row;
      }
  }
}

Eigen::SparseMatrix<double> CorrelationStage::assemble(const std::vector<char>& valid, bool for_solving,
                                                       double mass) const {
  Eigen::SparseMatrix<double> result = pattern_;
  double* const values = result.valuePtr();
  const int* const begin = result.outerIndexPtr();
  for (Index e = 0; e < std::ssize(mesh_.elements); ++e) {
    if (valid[e] == 0) continue;
    const auto& nodes = mesh_.elements[e];
    const Constants& c = constants_[e];
    Eigen::Matrix<double, 8, 8> matrix = c.matrix;
    if (for_solving && per_element())
      matrix -= c.brightness * c.brightness_matrix.inverse() * c.brightness.transpose();
    for (int b = 0; b < ImageMesh::nodes_of(nodes); ++b) {
      const int column = 2 * nodes[b], length = begin[column + 1] - begin[column];
      for (int a = 0; a < ImageMesh::nodes_of(nodes); ++a) {
        double* const at = values + places_[e][4 * a + b];
        at[0] += matrix(2 * a, 2 * b) + mass * c.mass(a, b), at[1] += matrix(2 * a + 1, 2 * b);
        at[length] += matrix(2 * a, 2 * b + 1);
        at[length + 1] += matrix(2 * a + 1, 2 * b + 1) + mass * c.mass(a, b);
      }
    }
  }
  return result;
}

Eigen::SparseMatrix<double> CorrelationStage::matrix(const std::vector<char>& valid, double mass) const {
  Eigen::SparseMatrix<double> result = assemble(valid, false, mass);
  if (std::find(valid.begin(), valid.end(), 0) != valid.end()) result.prune(0.0, 0.0);
  return result;
}

/// Nodes that nothing holds get a row of their own.
void CorrelationStage::factorise_or_shift(Eigen::SparseMatrix<double>& matrix, Solver& solver) {
  for (int i = 0; i < matrix.rows(); ++i)
    if (matrix.coeff(i, i) == 0) matrix.coeffRef(i, i) = 1;
  solver.factorize(matrix);
  if (solver.info() == Eigen::Success) return;
  const double shift = 1e-9 * matrix.diagonal().maxCoeff();  // a node held by too little texture
  for (int i = 0; i < matrix.rows(); ++i) matrix.coeffRef(i, i) += shift;
  solver.factorize(matrix);
  if (solver.info() != Eigen::Success)
    throw NumericalError(
        "image correlation: the matrix of the mesh is singular; choose larger elements, or regularisation");
}

/// Gauss–Newton without R from where it stopped with R: from M u₀ ≈ (M + R) u on, in the true residual.
void CorrelationStage::remove_regularisation(const SplineImage& deformed, CorrelationResult& result) {
  if (!(penalty_ > 0) || !result.converged) return;
  if (plain_for_ != result.element_valid) {
    Eigen::SparseMatrix<double> matrix = assemble(result.element_valid, true, 0);
    if (plain_for_.empty()) plain_.analyzePattern(matrix);
    factorise_or_shift(matrix, plain_);
    plain_for_ = result.element_valid;
  }
  CorrelationResult free = result;
  for (int k = 0; k < k_plain_steps; ++k) {
    look_at_all_anew();
    sum_residuals(deformed, free);
    (void)assemble_right(free);
    step_ = plain_.solve(right_);
    free.displacement += carried(step_);
    if (step_.cwiseAbs().maxCoeff() < options_.tolerance) break;
  }
  result.unregularised = free.displacement.allFinite() ? std::move(free.displacement) : result.displacement;
}

void CorrelationStage::factorise(const std::vector<char>& valid) {
  if (factorised_for_ == valid) return;
  Eigen::SparseMatrix<double> matrix = assemble(valid, true, 0);
  penalty_matrix_ = penalty(valid);
  if (penalty_ > 0) matrix += penalty_matrix_;
  if (penalty_ > 0 || factorised_for_.empty()) solver_.analyzePattern(matrix);
  factorise_or_shift(matrix, solver_);
  factorised_for_ = valid;
  if (options_.brightness != Brightness::global) return;
  coupling_.setZero(2 * mesh_.node_count(), 2);
  Eigen::Matrix2d brightness = Eigen::Matrix2d::Zero();
  for (Index e = 0; e < std::ssize(mesh_.elements); ++e) {
    if (valid[e] == 0) continue;
    brightness += constants_[e].brightness_matrix;
    for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a)
      coupling_.middleRows(2 * mesh_.elements[e][a], 2) += constants_[e].brightness.middleRows(2 * a, 2);
  }
  solved_coupling_ = solver_.solve(coupling_);
  brightness_schur_ = brightness - coupling_.transpose() * solved_coupling_;
}

ElementMotion CorrelationStage::motion(std::size_t e, const CorrelationResult& result) const {
  const auto& nodes = mesh_.elements[e];
  const auto& coefficients = pixels_.elements()[e].coefficients;
  ElementMotion m;
  for (Index a = 0; a < ImageMesh::nodes_of(nodes); ++a)
    for (std::size_t k = 0; k < 4; ++k) {
      m.u[k] += coefficients[a][k] * result.displacement[2 * nodes[a]];
      m.v[k] += coefficients[a][k] * result.displacement[2 * nodes[a] + 1];
    }
  m.gain = per_element() ? element_brightness_[e][0] : static_cast<float>(result.gain);
  m.offset = per_element() ? element_brightness_[e][1] : static_cast<float>(result.offset);
  return m;
}

std::vector<double> CorrelationStage::element_rms() const {
  std::vector<double> rms(sums_.size(), 0);
  for (Index e = 0; e < std::ssize(sums_); ++e)
    if (sums_[e].count > 0) rms[e] = std::sqrt(sums_[e].r_squared / sums_[e].count);
  return rms;
}

double CorrelationStage::usual_residual(const CorrelationResult& result,
                                        const std::vector<double>& rms) const {
  std::vector<double> valid;
  for (Index e = 0; e < std::ssize(rms); ++e)
    if (result.element_valid[e] != 0 && sums_[e].count > 0) valid.push_back(rms[e]);
  return numerics::upper_median(valid);
}

/// The residual of an element is that of a few pixels whose grey levels have changed, while its motion
/// explains the others.
bool CorrelationStage::is_a_spot(const SplineImage& deformed, const CorrelationResult& result, std::size_t e,
                                 double usual) const {
  std::vector<float> squares =
      element_residuals(pixels_, pixels_.elements()[e], reference_.view(), deformed, motion(e, result));
  for (float& r : squares) r *= r;
  const Index spot = std::ceil(k_spot * squares.size()), rest = std::ssize(squares) - spot;
  if (rest < 1) return false;
  std::nth_element(squares.begin(), squares.begin() + rest, squares.end());
  return std::accumulate(squares.begin(), squares.begin() + rest, 0.0) <
         rest * k_beside_spot * k_beside_spot * usual * usual;
}

int CorrelationStage::reject(const SplineImage& deformed, CorrelationResult& result, bool restless) const {
  const std::vector<double> rms = element_rms();
  const double usual = usual_residual(result, rms), limit = options_.rejection_factor * usual;
  std::vector<double> around(mesh_.x.size(), 0);
  for (Index e = 0; e < std::ssize(sums_); ++e) {
    if (result.element_valid[e] == 0) continue;
    for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a) {
      double& largest = around[mesh_.elements[e][a]];
      largest = std::max(largest, rms[e]);
    }
  }
  const auto before = std::count(result.element_valid.begin(), result.element_valid.end(), 1);
  for (Index e = 0; e < std::ssize(sums_); ++e) {
    if (result.element_valid[e] == 0) continue;
    // An element on a crack pulls at the nodes of its neighbours: only the worst go at once, the others get
    // another chance.
    double worst_neighbour = 0;
    for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a)
      worst_neighbour = std::max(worst_neighbour, around[mesh_.elements[e][a]]);
    const bool unseen = sums_[e].count < k_min_pixel_share * pixels_.elements()[e].pixel_count;
    const bool bad = options_.reject_elements && rms[e] > limit &&
                     rms[e] > k_share_of_worst * worst_neighbour && !is_a_spot(deformed, result, e, usual);
    if (unseen || bad) result.element_valid[e] = 0;
  }
  if (restless && options_.reject_elements) reject_restless(result, rms);
  return before - std::count(result.element_valid.begin(), result.element_valid.end(), 1);
}

/// Nodes that never come to rest, between the two sides of a crack as a rule: of the elements around each the
/// one with the largest residual goes.
void CorrelationStage::reject_restless(CorrelationResult& result, const std::vector<double>& rms) const {
  std::vector<int> worst(mesh_.x.size(), -1);
  int count = 0;
  for (int n = 0; n < mesh_.node_count(); ++n)
    if (step_.segment<2>(2 * n).cwiseAbs().maxCoeff() > options_.tolerance) worst[n] = -2, ++count;
  const double nodes = mesh_.node_count();
  if (count > std::max(k_max_restless * nodes, k_restless_rows * std::sqrt(nodes))) return;
  for (Index e = 0; e < std::ssize(sums_); ++e) {
    if (result.element_valid[e] == 0) continue;
    for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a) {
      int& at = worst[mesh_.elements[e][a]];
      if (at == -2 || (at >= 0 && rms[e] > rms[at])) at = e;
    }
  }
  for (const int e : worst)
    if (e >= 0) result.element_valid[e] = 0;
}

/// Nodes without a valid element take what their neighbours' displacements and gradients say.
void CorrelationStage::extrapolate(CorrelationResult& result) const {
  const auto measured = measured_nodes(mesh_, result.element_valid);
  const Eigen::MatrixXd gradient = nodal_gradients(mesh_, result.displacement, result.element_valid);
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(result.displacement.size()),
                  count = Eigen::VectorXd::Zero(mesh_.node_count());
  for (const auto& nodes : mesh_.elements)
    for (int a = 0; a < ImageMesh::nodes_of(nodes); ++a)
      for (int b = 0; b < ImageMesh::nodes_of(nodes); ++b) {
        const int to = nodes[a], from = nodes[b];
        const std::size_t p = to, q = from;
        if (measured[p] != 0 || measured[q] == 0) continue;
        const double dx = mesh_.x[p] - mesh_.x[q], dy = mesh_.y[p] - mesh_.y[q];
        for (int k = 0; k < 2; ++k)
          sum[2 * to + k] +=
              result.displacement[2 * from + k] + gradient(from, 2 * k) * dx + gradient(from, 2 * k + 1) * dy;
        count[to] += 1;
      }
  for (int n = 0; n < mesh_.node_count(); ++n)
    if (count[n] > 0) result.displacement.segment<2>(2 * n) = sum.segment<2>(2 * n) / count[n];
}

/// Elements that were taken out, perhaps because they began too far off: where the continuation of the motion
/// around explains them they come back, each once.
int CorrelationStage::readmit(const SplineImage& deformed, CorrelationResult& result,
                              std::vector<char>& tried) {
  if (result.element_valid == usable_) return 0;
  extrapolate(result);
  for (Index e = 0; e < std::ssize(moved_); ++e)
    if (result.element_valid[e] == 0) moved_[e] = std::numeric_limits<double>::infinity();
  sum_residuals(deformed, result);
  const std::vector<double> rms = element_rms();
  const double limit = options_.rejection_factor * usual_residual(result, rms);
  int count = 0;
  for (Index e = 0; e < std::ssize(sums_); ++e) {
    if (result.element_valid[e] != 0 || usable_[e] == 0 || tried[e] != 0 || rms[e] > limit ||
        sums_[e].count < k_min_pixel_share * pixels_.elements()[e].pixel_count)
      continue;
    result.element_valid[e] = tried[e] = 1, ++count;
  }
  return count;
}

void CorrelationStage::start_brightness(const CorrelationResult& result) {
  std::fill(element_brightness_.begin(), element_brightness_.end(),
            std::array<float, 2>{static_cast<float>(result.gain), static_cast<float>(result.offset)});
  look_at_all_anew();
  brightness_step_.setZero();
}

double CorrelationStage::misfit(const SplineImage& deformed, const CorrelationResult& result) {
  start_brightness(result);
  sum_residuals(deformed, result);
  double squares = 0, count = 0;
  for (Index e = 0; e < std::ssize(sums_); ++e)
    if (result.element_valid.empty() || result.element_valid[e] != 0)
      squares += sums_[e].r_squared, count += sums_[e].count;
  return count > 0 ? squares / count : std::numeric_limits<double>::infinity();
}

std::vector<char> CorrelationStage::seen() const {
  std::vector<char> seen = usable_;
  for (Index e = 0; e < std::ssize(seen); ++e)
    if (sums_[e].count < k_min_pixel_share * pixels_.elements()[e].pixel_count) seen[e] = 0;
  return seen;
}

bool CorrelationStage::correlate(const SplineImage& deformed, CorrelationResult& result, double far) {
  if (result.element_valid.empty()) {
    result.element_valid = usable_;
  } else {
    for (Index e = 0; e < std::ssize(usable_); ++e) result.element_valid[e] &= usable_[e];
  }
  result.iterations = 0;
  result.message.clear();
  start_brightness(result);
  if (far > 0 && !(misfit(deformed, result) < std::pow(far * contrast(), 2))) return false;
  large_ = mean_motion(mesh_, result.displacement);
  if ((large_->gradient - Eigen::Matrix2d::Identity()).cwiseAbs().maxCoeff() < k_large) large_.reset();
  std::vector<char> tried(usable_.size(), 0);
  int allowed = options_.max_iterations, readmissions = 0;  // iterations without an element taken out
  for (int round = 0;; ++round) {
    const int before = result.iterations;
    iterate(deformed, result, allowed);
    if (result.displacement.isZero(0)) break;  // diverged
    allowed -= result.iterations - before;
    const bool rejected =
        round < k_rejection_rounds && reject(deformed, result, round > 0 && !result.converged) > 0;
    if (std::count(result.element_valid.begin(), result.element_valid.end(), 1) == 0) {
      result.message = "no element is left: the deformed picture does not show the surface of the reference";
      result.converged = false;
      break;
    }
    if (rejected) {
      allowed = std::max(allowed, k_iterations_per_round);
      continue;
    }
    if (!result.converged && allowed > 0) continue;
    if (!result.converged || !options_.reject_elements || readmissions++ == k_readmissions ||
        readmit(deformed, result, tried) == 0)
      break;
    round = 0;
    allowed = std::max(allowed, k_iterations_per_round);
  }
  result.elements_rejected = std::count(result.element_valid.begin(), result.element_valid.end(), 0);
  result.element_residual.assign(sums_.size(), 0);
  double squares = 0, pixels = 0;
  for (Index e = 0; e < std::ssize(sums_); ++e) {
    if (sums_[e].count > 0) result.element_residual[e] = std::sqrt(sums_[e].r_squared / sums_[e].count);
    if (result.element_valid[e] != 0) squares += sums_[e].r_squared, pixels += sums_[e].count;
  }
  result.pixels_used = pixels;
  result.residual_rms = pixels > 0 ? std::sqrt(squares / pixels) : 0;
  return true;
}

}  // namespace knothe::imaging
