#include "knothe/project/inference_options.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <cmath>

namespace knothe::project {
namespace {

std::vector<std::size_t> read_indices(Values& values, const std::string& path) {
  std::vector<std::size_t> indices;
  for (const double v : values.numbers(path)) {
    if (!(v >= 0 && v == std::floor(v) && v < 1e15)) {
      values.complain(path, fmt::format("\"{}\" must be whole numbers from 0, not {}", path, v));
      return {};
    }
    indices.push_back(static_cast<std::size_t>(v));
  }
  return indices;
}

/// A covariance of n values: square, symmetric, positive definite.
void check_covariance(Values& values, const std::vector<std::vector<double>>& rows, std::size_t n) {
  const std::string path = "observations.covariance";
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].size() != rows.size()) {
      values.complain(path, fmt::format("\"{}\" is not square: it has {} rows, and row {} has {} entries",
                                        path, rows.size(), i, rows[i].size()));
      return;
    }
  }
  if (rows.size() != n) {
    values.complain(
        path, fmt::format("\"{}\" is {} × {}, but there are {} values", path, rows.size(), rows.size(), n));
    return;
  }
  const auto m = static_cast<Eigen::Index>(n);
  Eigen::MatrixXd c(m, m);
  for (Eigen::Index i = 0; i < m; ++i)
    for (Eigen::Index j = 0; j < m; ++j)
      c(i, j) = rows[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
  for (Eigen::Index i = 0; i < m; ++i) {
    if (!(c(i, i) > 0)) {
      values.complain(
          path, fmt::format("\"{}\": entry [{}][{}] is {}; a variance is positive", path, i, i, c(i, i)));
      return;
    }
    for (Eigen::Index j = 0; j < i; ++j) {
      if (std::abs(c(i, j) - c(j, i)) <= 1e-10 * std::sqrt(c(i, i) * std::max(c(j, j), 0.0))) continue;
      values.complain(path, fmt::format("\"{}\" is not symmetric: [{}][{}] is {}, [{}][{}] is {}", path, i, j,
                                        c(i, j), j, i, c(j, i)));
      return;
    }
  }
  const Eigen::VectorXd scale = c.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scale.asDiagonal() * c * scale.asDiagonal(),
                                                             Eigen::EigenvaluesOnly);
  if (const double least = eigen.eigenvalues().minCoeff(); !(least > 1e-14 * static_cast<double>(m)))
    values.complain(path,
                    fmt::format("\"{}\" is {}: the smallest eigenvalue of its correlations is {:.3g}; a "
                                "covariance must be positive definite",
                                path, least < -1e-12 ? "indefinite" : "singular", least));
}

}  // namespace

UmbridgeOptions read_umbridge(Values& values) {
  values.at_least("model.connections", 1);
  if (values.integer("model.connections", 1) > 64)
    values.complain("model.connections", "\"model.connections\" must be at most 64");
  UmbridgeOptions o;
  o.url = values.text("model.umbridge", "");
  o.name = values.text("model.name", "");
  o.config = values.text("model.config", o.config);
  o.timeout = values.number("model.timeout", o.timeout);
  o.connections = static_cast<int>(values.integer("model.connections", 1));
  o.density = values.text("model.kind", "forward") == "density";
  o.derivatives = values.text("model.derivatives", o.derivatives);
  o.difference_step = values.number("model.difference_step", o.difference_step);
  if (o.difference_step >= 0.1)
    values.complain("model.difference_step", "\"model.difference_step\" must be below 0.1");
  if (!o.url.empty() && values.has("model.separated"))
    values.complain("model.umbridge", "[model] has both \"umbridge\" and \"separated\": choose one");
  if (o.density && values.has_table("observations"))
    values.complain("observations",
                    "[observations] does not go with model.kind = \"density\": the server's number is the "
                    "complete log posterior density");
  if (o.density && o.url.empty())
    values.complain("model.kind", "model.kind = \"density\" needs \"umbridge\", the server's address");
  return o;
}

ObservationOptions read_observations(Values& values) {
  ObservationOptions o;
  o.values = values.numbers("observations.values");
  o.std = values.numbers("observations.std");
  o.covariance = values.matrix("observations.covariance");
  o.dofs = read_indices(values, "observations.dofs");
  o.steps = read_indices(values, "observations.steps");
  o.output = values.text("observations.output", "");
  const bool has_std = values.has("observations.std"), has_covariance = values.has("observations.covariance");
  if (values.has("observations.values") && o.values.empty())
    values.complain("observations.values", "\"observations.values\" is empty: nothing was observed");
  if (values.has("observations.values") && has_std == has_covariance)
    values.complain("observations",
                    fmt::format("[observations] needs the noise as {}\"std\" or \"covariance\"",
                                has_std ? "one of " : ""));
  if (has_std && o.std.size() != o.values.size())
    values.complain("observations.std", fmt::format("\"observations.std\" has {} entries for {} values",
                                                    o.std.size(), o.values.size()));
  for (std::size_t i = 0; i < o.std.size(); ++i) {
    if (o.std[i] > 0) continue;
    values.complain("observations.std",
                    fmt::format("\"observations.std\": entry {} is {}; a standard deviation "
                                "is positive",
                                i, o.std[i]));
    break;
  }
  if (has_covariance && !o.covariance.empty()) check_covariance(values, o.covariance, o.values.size());
  if (!o.output.empty() && !o.dofs.empty())
    values.complain("observations.output", "[observations] has both \"output\" and \"dofs\": choose one");
  return o;
}

}  // namespace knothe::project
