#include "knothe/project/inference_options.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <cmath>

#include "knothe/project/option_section.hpp"

namespace knothe::project {
namespace {

const Section<UmbridgeOptions>& umbridge_section() {
  using U = UmbridgeOptions;
  static constexpr auto k_derivatives = std::to_array<Named<int>>({{2, "all"}, {1, "first"}, {0, "none"}});
  static const Section<U> k_section("model", "", [](Section<U>& s) {
    s.add("umbridge", &U::url, "Address of a UM-Bridge 1.0 server, `\"http://HOST:PORT\"` (`knothe infer`).");
    s.add("name", &U::name, "Name of the server's model; not needed if it has only one.");
    s.add("config", &U::config, "Passed through to the server with every request.", free_table);
    s.add("timeout", &U::timeout, "Longest time that a request may take, s.", positive);
    s.add("connections", &U::connections, "Number of parallel requests, 1 to 64.", at_least(1), at_most(64));
    s.choice("kind", &U::density, "forward", "density",
             "Predictions of the observations, or one number: the complete log posterior density.");
    s.choice("derivatives", &U::derivatives, k_derivatives,
             "Which of the derivatives that the server offers are requested.");
    s.add("difference_step", &U::difference_step,
          "Step of central differences, in units of the prior's scale, if the server has no derivatives.",
          positive, check([](double v) { return v < 0.1; }, "\"{}\" must be below 0.1"));
  });
  return k_section;
}

const Section<ObservationOptions>& observation_section() {
  using O = ObservationOptions;
  static const Section<O> k_section(
      "observations", "What was observed of the model's outputs (`knothe infer`).", [](Section<O>& s) {
        s.add("values", &O::values, "Observed values, in the order of the model's outputs.", required);
        s.add("std", &O::std, "Standard deviation of the noise of each value.");
        s.add("covariance", &O::covariance, "Covariance of the noise instead: symmetric, positive definite.");
        s.add("dofs", &O::dofs, "Separated model: indices of the dofs observed, all of them at each step.",
              of_shape("integers ≥ 0"));
        s.add("steps", &O::steps,
              "Separated model: indices of the time steps observed; the values are ordered step by step.",
              of_shape("integers ≥ 0"));
        s.add("output", &O::output, "Separated model: observe this output of the model instead of dofs.");
      });
  return k_section;
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
  const Eigen::Index m = n;
  Eigen::MatrixXd c(m, m);
  for (Eigen::Index i = 0; i < m; ++i)
    for (Eigen::Index j = 0; j < m; ++j) c(i, j) = rows[i][j];
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
  if (const double least = eigen.eigenvalues().minCoeff(); !(least > 1e-14 * m))
    values.complain(path, fmt::format("\"{}\" is {}: the smallest eigenvalue of its correlations is {:.3g}; "
                                      "a covariance must be positive definite",
                                      path, least < -1e-12 ? "indefinite" : "singular", least));
}

}  // namespace

std::vector<Option> inference_option_table() {
  return joined(umbridge_section(), observation_section());
}

UmbridgeOptions read_umbridge(Values& values) {
  UmbridgeOptions o = umbridge_section().read(values);
  if (!o.url.empty() && values.has("model.separated"))
    values.complain("model.umbridge", "[model] has both \"umbridge\" and \"separated\": choose one");
  if (o.density && values.has_table("observations"))
    values.complain("observations",
                    "[observations] cannot be combined with model.kind = \"density\": the server's number is "
                    "the complete log posterior density");
  if (o.density && o.url.empty())
    values.complain("model.kind", "model.kind = \"density\" needs \"umbridge\", the server's address");
  return o;
}

ObservationOptions read_observations(Values& values) {
  ObservationOptions o = observation_section().read(values);
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
    values.complain(
        "observations.std",
        fmt::format("\"observations.std\": entry {} is {}; a standard deviation is positive", i, o.std[i]));
    break;
  }
  if (has_covariance && !o.covariance.empty()) check_covariance(values, o.covariance, o.values.size());
  if (!o.output.empty() && !o.dofs.empty())
    values.complain("observations.output", "[observations] has both \"output\" and \"dofs\": choose one");
  return o;
}

}  // namespace knothe::project
