#include "knothe/reduction/compress/progressive_galerkin.hpp"

#include <fmt/format.h>

#include <Eigen/SparseCholesky>
#include <Eigen/SparseLU>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "knothe/base/error.hpp"
#include "knothe/numerics/statistics/random.hpp"

namespace knothe::reduction {

namespace {

using SparseMatrix = Eigen::SparseMatrix<double>;

void validate(const SeparatedProblem& p) {
  if (p.operators.empty() || p.loads.empty())
    throw UsageError("separated problem: at least one operator term and one load term are needed");
  const std::size_t order = p.loads.front().size();
  if (order == 0) throw UsageError("separated problem: a load term without coordinates");
  for (std::size_t q = 0; q < p.loads.size(); ++q)
    for (std::size_t i = 0; i < p.loads[q].size(); ++i)
      if (p.loads[q].size() != order || p.loads[q][i].size() != p.loads.front()[i].size() ||
          p.loads[q][i].size() == 0 || !p.loads[q][i].allFinite())
        throw UsageError(fmt::format(
            "separated problem: load term {}, coordinate {}: not of the first term's shape, or not finite", q,
            i));
  for (std::size_t q = 0; q < p.operators.size(); ++q) {
    if (p.operators[q].size() != order)
      throw UsageError(
          fmt::format("separated problem: operator term {} has {} coordinates, the loads have {}", q,
                      p.operators[q].size(), order));
    for (std::size_t i = 0; i < order; ++i) {
      const SparseMatrix& a = p.operators[q][i];
      const Eigen::Index n = p.loads.front()[i].size();
      if (a.rows() != n || a.cols() != n || !std::isfinite(a.sum()))
        throw UsageError(fmt::format(
            "separated problem: operator term {}, coordinate {}: {} × {}, and finite entries, are needed", q,
            i, n, n));
    }
  }
}

/// Whether every matrix is its own transpose, to rounding.
bool is_symmetric(const SeparatedProblem& p) {
  for (const auto& term : p.operators)
    for (const SparseMatrix& a : term)
      if (SparseMatrix(a - SparseMatrix(a.transpose())).norm() > 1e-12 * a.norm()) return false;
  return true;
}

/// The solution, or nothing where the matrix is singular.
std::optional<Eigen::VectorXd> solve(const SparseMatrix& matrix, const Eigen::VectorXd& right,
                                     bool is_symmetric) {
  Eigen::VectorXd x;
  if (is_symmetric) {
    const Eigen::SimplicialLDLT<SparseMatrix> factor(matrix);
    if (factor.info() != Eigen::Success) return std::nullopt;
    x = factor.solve(right);
  } else {
    Eigen::SparseLU<SparseMatrix> factor;
    factor.compute(matrix);
    if (factor.info() != Eigen::Success) return std::nullopt;
    x = factor.solve(right);
  }
  if (!x.allFinite()) return std::nullopt;
  return x;
}

/// The image of all terms of `factors` under all terms of the operator, and the loads, as one tensor f − A u.
SeparatedTensor residual_of(const SeparatedProblem& p, const std::vector<Eigen::MatrixXd>& factors) {
  std::vector<Eigen::MatrixXd> out;
  const Eigen::Index m = factors.front().cols(), q = static_cast<Eigen::Index>(p.operators.size()),
                     f = static_cast<Eigen::Index>(p.loads.size());
  for (std::size_t i = 0; i < factors.size(); ++i) {
    Eigen::MatrixXd columns(factors[i].rows(), f + q * m);
    for (Eigen::Index k = 0; k < f; ++k) columns.col(k) = p.loads[static_cast<std::size_t>(k)][i];
    for (Eigen::Index k = 0; k < q; ++k) {
      columns.middleCols(f + k * m, m) = p.operators[static_cast<std::size_t>(k)][i] * factors[i];
      if (i == 0) columns.middleCols(f + k * m, m) *= -1;
    }
    out.push_back(std::move(columns));
  }
  return SeparatedTensor(std::move(out));
}

double norm_of_loads(const SeparatedProblem& p) {
  std::vector<Eigen::MatrixXd> none;
  for (const auto& f : p.loads.front()) none.emplace_back(f.size(), 0);
  return norm(residual_of(p, none));
}

class ProgressiveGalerkin {
 public:
  ProgressiveGalerkin(const SeparatedProblem& problem, const ProgressiveGalerkinOptions& options)
      : p_(problem), options_(options), is_symmetric_(is_symmetric(problem)) {
    for (const auto& f : p_.loads.front()) factors_.emplace_back(f.size(), 0);
  }

  /// One more term; the number of sweeps it took. 0 if there is nothing left to add.
  int enrich();
  /// The functions of all coordinates but space, one coordinate after the other, all terms together.
  void update();
  [[nodiscard]] const std::vector<Eigen::MatrixXd>& factors() const { return factors_; }
  /// uᵀA u and fᵀu.
  [[nodiscard]] std::pair<double, double> work() const;

 private:
  [[nodiscard]] std::size_t order() const { return factors_.size(); }
  [[nodiscard]] Eigen::Index modes() const { return factors_.front().cols(); }
  /// Π over all coordinates but `left_out` of (left_jᵀ A_q^j right_j), columns against columns.
  [[nodiscard]] Eigen::MatrixXd operator_products(std::size_t q, std::size_t left_out,
                                                  const std::vector<Eigen::MatrixXd>& left,
                                                  const std::vector<Eigen::MatrixXd>& right) const;
  /// The same with the load: one entry per column of `left`.
  [[nodiscard]] Eigen::VectorXd load_products(std::size_t q, std::size_t left_out,
                                              const std::vector<Eigen::MatrixXd>& left) const;
  void solve_coordinate(std::size_t i, std::vector<Eigen::MatrixXd>& term) const;
  bool update_coordinate(std::size_t i);

  const SeparatedProblem& p_;
  const ProgressiveGalerkinOptions& options_;
  bool is_symmetric_;
  std::vector<Eigen::MatrixXd> factors_;
};

Eigen::MatrixXd ProgressiveGalerkin::operator_products(std::size_t q, std::size_t left_out,
                                                       const std::vector<Eigen::MatrixXd>& left,
                                                       const std::vector<Eigen::MatrixXd>& right) const {
  Eigen::MatrixXd product = Eigen::MatrixXd::Ones(left.front().cols(), right.front().cols());
  for (std::size_t j = 0; j < order(); ++j)
    if (j != left_out) product.array() *= (left[j].transpose() * (p_.operators[q][j] * right[j])).array();
  return product;
}

Eigen::VectorXd ProgressiveGalerkin::load_products(std::size_t q, std::size_t left_out,
                                                   const std::vector<Eigen::MatrixXd>& left) const {
  Eigen::VectorXd product = Eigen::VectorXd::Ones(left.front().cols());
  for (std::size_t j = 0; j < order(); ++j)
    if (j != left_out) product.array() *= (left[j].transpose() * p_.loads[q][j]).array();
  return product;
}

/// (Σ_q c_q A_q^i) a_i = Σ_q b_q f_q^i − Σ_q A_q^i U_i d_q: the term's other functions fixed.
void ProgressiveGalerkin::solve_coordinate(std::size_t i, std::vector<Eigen::MatrixXd>& term) const {
  SparseMatrix matrix(term[i].rows(), term[i].rows());
  Eigen::VectorXd right = Eigen::VectorXd::Zero(term[i].rows());
  for (std::size_t q = 0; q < p_.operators.size(); ++q) {
    matrix += operator_products(q, i, term, term)(0, 0) * p_.operators[q][i];
    if (modes() > 0)
      right -=
          p_.operators[q][i] * (factors_[i] * operator_products(q, i, term, factors_).transpose()).col(0);
  }
  for (std::size_t q = 0; q < p_.loads.size(); ++q) right += load_products(q, i, term)[0] * p_.loads[q][i];
  matrix.makeCompressed();
  const auto solved = solve(matrix, right, is_symmetric_);
  if (!solved)
    throw NumericalError(fmt::format(
        "progressive Galerkin: the operator of coordinate {} is singular; are there boundary conditions?",
        i));
  term[i].col(0) = *solved;
}

int ProgressiveGalerkin::enrich() {
  std::vector<Eigen::MatrixXd> term;
  for (std::size_t i = 0; i < order(); ++i) {
    // Positive, hence orthogonal to nothing in particular, and different for every term.
    term.push_back(Eigen::MatrixXd::Ones(factors_[i].rows(), 1));
    if (modes() > 0)
      term.back() +=
          0.5 * numerics::monte_carlo_normal_points(
                    factors_[i].rows(), 1, options_.seed + static_cast<std::uint64_t>(modes() * 64) + i);
    term.back().normalize();
  }
  int sweep = 0;
  double size_before = 0;
  std::vector<Eigen::MatrixXd> before;
  for (; sweep < options_.max_sweeps; ++sweep) {
    before = term;
    for (std::size_t i = 0; i < order(); ++i) {
      solve_coordinate(i, term);
      const double size = term[i].norm();
      if (!(size > std::numeric_limits<double>::min())) return 0;
      if (i + 1 < order()) term[i] /= size;
    }
    // ‖new − old‖² from norms and the product of the cosines.
    const double size = term.back().norm();
    double overlap = 1;
    for (std::size_t i = 0; i < order(); ++i) overlap *= term[i].col(0).dot(before[i].col(0));
    const double change =
        std::sqrt(std::max(0.0, size * size + size_before * size_before - 2 * overlap)) / size;
    size_before = size;
    if (sweep > 0 && change < options_.sweep_tolerance) break;
  }
  // The amplitude goes to space.
  const double size = term.back().norm();
  term.back() /= size;
  term.front() *= size;
  for (std::size_t i = 0; i < order(); ++i) {
    factors_[i].conservativeResize(Eigen::NoChange, modes() + (i == 0 ? 1 : 0));
    factors_[i].col(factors_[i].cols() - 1) = term[i];
  }
  return std::min(sweep + 1, options_.max_sweeps);
}

bool ProgressiveGalerkin::update_coordinate(std::size_t i) {
  const Eigen::Index m = modes(), n = factors_[i].rows();
  std::vector<Eigen::Triplet<double>> entries;
  for (std::size_t q = 0; q < p_.operators.size(); ++q) {
    const Eigen::MatrixXd products = operator_products(q, i, factors_, factors_);
    const SparseMatrix& a = p_.operators[q][i];
    for (int column = 0; column < a.outerSize(); ++column)
      for (SparseMatrix::InnerIterator it(a, column); it; ++it)
        for (Eigen::Index k = 0; k < m; ++k)
          for (Eigen::Index l = 0; l < m; ++l)
            entries.emplace_back(static_cast<int>(it.row() * m + k), static_cast<int>(it.col() * m + l),
                                 it.value() * products(k, l));
  }
  SparseMatrix matrix(n * m, n * m);
  matrix.setFromTriplets(entries.begin(), entries.end());
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(m, n);  // column by column: modes within points
  for (std::size_t q = 0; q < p_.loads.size(); ++q)
    right += load_products(q, i, factors_) * p_.loads[q][i].transpose();
  const auto solved = solve(matrix, right.reshaped(), is_symmetric_);
  if (!solved) return false;
  factors_[i] = solved->reshaped(m, n).transpose();
  return true;
}

void ProgressiveGalerkin::update() {
  for (std::size_t i = 1; i < order(); ++i) {
    const auto before = factors_;
    const auto balance = [this] {
      const auto [internal, external] = work();
      return 0.5 * internal - external;
    };
    const double energy = balance();
    // Nearly parallel terms make the system singular to rounding; then what was there is better.
    if (!update_coordinate(i) || (is_symmetric_ && !(balance() <= energy + 1e-12 * std::abs(energy))))
      factors_ = before;
    for (Eigen::Index k = 0; k < modes(); ++k) {
      const double size = factors_[i].col(k).norm();
      if (!(size > 0)) continue;
      factors_[i].col(k) /= size;
      factors_[0].col(k) *= size;
    }
  }
}

std::pair<double, double> ProgressiveGalerkin::work() const {
  double internal = 0, external = 0;
  for (std::size_t q = 0; q < p_.operators.size(); ++q)
    internal += operator_products(q, order(), factors_, factors_).sum();
  for (std::size_t q = 0; q < p_.loads.size(); ++q) external += load_products(q, order(), factors_).sum();
  return {internal, external};
}

}  // namespace

ProgressiveGalerkinResult solve_progressive_galerkin(const SeparatedProblem& problem,
                                                     const ProgressiveGalerkinOptions& options) {
  validate(problem);
  ProgressiveGalerkin solver(problem, options);
  const double scale = norm_of_loads(problem);
  ProgressiveGalerkinResult result{SeparatedTensor(solver.factors()), {}, scale == 0, ""};
  while (!result.converged && static_cast<int>(result.history.size()) < options.max_modes) {
    EnrichmentRecord record;
    record.sweeps = solver.enrich();
    if (record.sweeps == 0) {
      result.reason = "no term is left that changes the solution";
      break;
    }
    solver.update();
    const auto [internal, external] = solver.work();
    record.energy = 0.5 * internal - external;
    record.imbalance = external == 0 ? 0 : std::abs(internal - external) / std::abs(external);
    record.residual = norm(residual_of(problem, solver.factors())) / scale;
    result.history.push_back(record);
    result.converged = record.residual <= options.tolerance;
    if (options.progress && !options.progress(static_cast<int>(result.history.size()), record.residual))
      throw Interrupted(
          fmt::format("progressive Galerkin: interrupted after {} modes", result.history.size()));
  }
  if (!result.converged && result.reason.empty())
    result.reason = fmt::format("the residual is {:.1e} after {} modes, above the tolerance of {:.1e}",
                                result.history.empty() ? 1.0 : result.history.back().residual,
                                result.history.size(), options.tolerance);
  result.solution = SeparatedTensor(solver.factors());
  return result;
}

ModelContents canonical_model(const SeparatedTensor& solution, std::vector<double> time,
                              std::vector<Axis> axes, Dofs dofs) {
  const std::vector<Eigen::Index> shape = solution.shape();
  bool fits = shape.size() == axes.size() + 2 && shape[1] == static_cast<Eigen::Index>(time.size());
  for (std::size_t i = 0; fits && i < axes.size(); ++i)
    fits = shape[i + 2] == static_cast<Eigen::Index>(axes[i].nodes.size());
  if (!fits)
    throw UsageError(
        fmt::format("canonical model: a tensor of order {} for {} axes; its shape must be that of "
                    "space, time and the axes",
                    shape.size(), axes.size()));
  const auto rows = [&](std::size_t i) {  // mode by mode
    const Eigen::MatrixXd& f = solution.factors()[i];
    return std::vector<double>(f.data(), f.data() + f.size());
  };
  ModelContents model;
  model.form = Form::canonical;
  model.space_modes = model.parameter_modes = static_cast<std::size_t>(solution.terms());
  model.space = rows(0);
  model.temporal = rows(1);
  for (std::size_t i = 0; i < axes.size(); ++i) model.parameters.push_back(rows(i + 2));
  model.lift.assign(time.size() * static_cast<std::size_t>(shape[0]), 0.0);
  model.time = std::move(time);
  model.axes = std::move(axes);
  model.dofs = std::move(dofs);
  model.project = "progressive Galerkin";
  return model;
}

}  // namespace knothe::reduction
