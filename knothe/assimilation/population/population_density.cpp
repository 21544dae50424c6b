#include "knothe/assimilation/population/population_density.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <utility>

namespace knothe::assimilation {
namespace {

using Eigen::Index;

/// C of a row of ζ.
SmallMatrix correlation_factor(const Eigen::Ref<const Eigen::VectorXd>& fisher, Index d) {
  SmallMatrix c = SmallMatrix::Zero(d, d);
  Index next = 0;
  for (Index i = 0; i < d; ++i) {
    double left = 1;  // 1 − the squares of the row so far
    for (Index j = 0; j < i; ++j) {
      c(i, j) = std::tanh(fisher[next++]) * std::sqrt(left);
      left -= c(i, j) * c(i, j);
    }
    c(i, i) = std::sqrt(left);
  }
  return c;
}

}  // namespace

PopulationNormal population_of(const Eigen::Ref<const Eigen::VectorXd>& parameters, Index d) {
  SmallMatrix correlation = SmallMatrix::Identity(d, d);
  Index next = 2 * d;
  for (Index i = 0; i < d; ++i)
    for (Index j = 0; j < i; ++j) correlation(i, j) = parameters[next++];
  return {parameters.head(d),
          parameters.segment(d, d).asDiagonal() * SmallMatrix(correlation.llt().matrixL())};
}

PopulationDensity::PopulationDensity(std::vector<const SpecimenLikelihood*> specimens,
                                     std::vector<posterior::Prior> priors)
    : specimens_(std::move(specimens)), transform_(std::move(priors)), d_(specimens_.front()->dimension()) {}

Eigen::MatrixXd PopulationDensity::transformed(const Eigen::Ref<const Eigen::MatrixXd>& z) const {
  Eigen::MatrixXd p(z.rows(), z.cols()), none;
  transform_.evaluate(z, 0, p, none, none);
  return p;
}

void PopulationDensity::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& z, int /*derivatives*/,
                                 posterior::LogDensityBatch& out) {
  const Eigen::MatrixXd p = transformed(z);
  for (Index i = 0; i < z.rows(); ++i) {
    const Eigen::VectorXd row = p.row(i).transpose();
    const PopulationNormal population{
        row.head(d_),
        row.segment(d_, d_).asDiagonal() * correlation_factor(row.tail(row.size() - 2 * d_), d_)};
    out.value[i] = -0.5 * (z.row(i).squaredNorm() + k_log_two_pi * z.cols());
    for (const SpecimenLikelihood* specimen : specimens_) out.value[i] += specimen->log_integral(population);
  }
}

Eigen::MatrixXd PopulationDensity::parameters(const Eigen::MatrixXd& z) const {
  Eigen::MatrixXd p = transformed(z);
  for (Index i = 0; i < p.rows() && d_ > 1; ++i) {
    const SmallMatrix c = correlation_factor(p.row(i).tail(p.cols() - 2 * d_).transpose(), d_);
    Index next = 2 * d_;
    for (Index row = 0; row < d_; ++row)
      for (Index column = 0; column < row; ++column) p(i, next++) = c.row(row).dot(c.row(column));
  }
  return p;
}

}  // namespace knothe::assimilation
