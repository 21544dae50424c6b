#include "knothe/report/results/posterior_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/netcdf.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"
#include "knothe/reduction/observe/observed_model.hpp"

namespace knothe::report {
namespace {

using Names = std::vector<std::string>;
constexpr std::size_t k_draws = 500;
constexpr std::size_t k_predictive_draws = 50;

std::vector<double> counted(std::size_t n) {
  std::vector<double> numbers(n);
  for (std::size_t i = 0; i < n; ++i) numbers[i] = static_cast<double>(i);
  return numbers;
}

class Writer {
 public:
  Writer(files::NetcdfWriter& out, const PosteriorFile& file, const reduction::SeparatedModel& model,
         const assimilation::Measurements& measurements)
      : out_(out), file_(file), model_(model), measurements_(measurements), n_steps_(file.results.size()) {
    for (const auto* result : file.results) steps_.push_back(static_cast<double>(result->step));
  }

  void write_draws() {
    const std::string group = "posterior";
    add_chain(group, k_draws);
    add_steps(group);
    const std::size_t d = file_.parameters.size();
    std::vector<std::vector<double>> values(d, std::vector<double>(k_draws * n_steps_));
    for (std::size_t s = 0; s < n_steps_; ++s) {
      const auto draws = numerics::equal_draws(file_.results[s]->weights, k_draws);
      for (std::size_t j = 0; j < k_draws; ++j) {
        for (std::size_t k = 0; k < d; ++k) {
          values[k][j * n_steps_ + s] = file_.results[s]->points(draws[j], static_cast<Eigen::Index>(k));
        }
      }
    }
    for (std::size_t k = 0; k < d; ++k) {
      const auto& axis = model_.contents().axes[k];
      out_.add_variable(group, axis.name, Names{"chain", "draw", "step"}, values[k],
                        {axis.units, axis.long_name});
    }
  }

  void write_predictive() {
    const std::string group = "posterior_predictive";
    add_chain(group, k_predictive_draws);
    add_steps(group);
    const auto n_obs = measurements_.sensors.displacement_count();
    out_.add_dimension(group, "observation", n_obs);
    const std::shared_ptr<const reduction::ObservedModel> observed =
        file_.observed ? file_.observed
                       : std::make_shared<const reduction::ObservedModel>(
                             reduction::observe(model_, measurements_.sensors));
    std::vector<double> values(k_predictive_draws * n_steps_ * n_obs);
    for (std::size_t s = 0; s < n_steps_; ++s) {
      const auto draws = numerics::equal_draws(file_.results[s]->weights, k_predictive_draws);
      for (std::size_t j = 0; j < k_predictive_draws; ++j) {
        const Eigen::VectorXd p = file_.results[s]->points.row(draws[j]);
        const Eigen::VectorXd y = observed->predict(p, file_.time_indices[s]);
        std::copy(y.begin(), y.begin() + static_cast<std::ptrdiff_t>(n_obs),
                  values.begin() + static_cast<std::ptrdiff_t>((j * n_steps_ + s) * n_obs));
      }
    }
    out_.add_variable(group, "displacement", Names{"chain", "draw", "step", "observation"}, values,
                      {"m", "displacement at the observed dofs, without noise"});
  }

  void write_data() {
    const auto n_obs = measurements_.sensors.displacement_count();
    add_steps("observed_data");
    out_.add_dimension("observed_data", "observation", n_obs);
    out_.add_variable("observed_data", "displacement", Names{"step", "observation"},
                      {measurements_.values.data(), n_steps_ * n_obs}, {"m", "measured displacement"});
    for (const auto& [name, series] : measurements_.series) {
      out_.add_variable("observed_data", name, Names{"step"}, {series.values.data(), n_steps_},
                        {"1", "measured beside the displacements"});
    }
    const std::string group = "constant_data";
    out_.add_dimension(group, "observation", n_obs);
    out_.add_dimension(group, "axis", 3);
    out_.add_variable(group, "points", Names{"observation", "axis"}, measurements_.sensors.points,
                      {"m", "measurement points"});
    const std::vector<double> components(measurements_.sensors.components.begin(),
                                         measurements_.sensors.components.end());
    out_.add_variable(group, "component", Names{"observation"}, components, {"1", "0 x, 1 y, 2 z"});
    const Eigen::VectorXd std = measurements_.noise.standard_deviations();
    out_.add_variable(group, "noise_std", Names{"observation"}, {std.data(), n_obs},
                      {"m", "standard deviation"});
  }

  void write_statistics() {
    add_steps("sample_stats");
    add_statistic("time", "1", "model time", [](const auto& r) { return r.time; });
    add_statistic("map_order", "1", "order of the map", [](const auto& r) { return double(r.map_order); });
    add_statistic("variance_diagnostic", "1", "verified variance diagnostic",
                  [](const auto& r) { return r.variance_diagnostic; });
    add_statistic("ess", "1", "effective sample size, fraction",
                  [](const auto& r) { return r.effective_sample_size; });
    add_statistic("trusted", "1", "1 if trusted", [](const auto& r) { return r.trusted ? 1.0 : 0.0; });
    add_statistic("verdict", "1", "0 ok, 1 caution, 2 reject",
                  [](const auto& r) { return static_cast<double>(r.verdict.level); });
    add_statistic("fit_probability", "1", "of a misfit as large as that of all data so far",
                  [](const auto& r) { return r.verdict.fit_probability; });
    add_statistic("log_evidence", "1", "log p(d_0 ... d_i)", [](const auto& r) { return r.log_evidence; });
    add_statistic("log_evidence_increment", "1", "log p(d_i | d_0 ... d_i-1)",
                  [](const auto& r) { return r.log_evidence_increment; });
  }

  void write_weighted_points() {
    const std::string group = "weighted_posterior";
    add_steps(group);
    Eigen::Index most = 0;
    for (const auto* result : file_.results) most = std::max(most, result->weights.size());
    const auto n = static_cast<std::size_t>(most), d = file_.parameters.size();
    out_.add_dimension(group, "point", n);
    out_.add_dimension(group, "parameter", d);
    // Steps with fewer points are filled up with their first point at weight zero.
    std::vector<double> points(n_steps_ * n * d), weights(n_steps_ * n, 0.0);
    for (std::size_t s = 0; s < n_steps_; ++s) {
      const auto& posterior = *file_.results[s];
      for (std::size_t i = 0; i < n; ++i) {
        const bool there = static_cast<Eigen::Index>(i) < posterior.weights.size();
        const Eigen::Index row = there ? static_cast<Eigen::Index>(i) : 0;
        if (there) weights[s * n + i] = posterior.weights[row];
        for (std::size_t k = 0; k < d; ++k) {
          points[(s * n + i) * d + k] = posterior.points(row, static_cast<Eigen::Index>(k));
        }
      }
    }
    out_.add_variable(group, "points", Names{"step", "point", "parameter"}, points, {"1", "parameters"});
    out_.add_variable(group, "weights", Names{"step", "point"}, weights, {"1", "importance weights, sum 1"});
    out_.add_attribute(group, "parameters", fmt::format("{}", fmt::join(file_.parameters, ",")));
  }

 private:
  void add_chain(const std::string& group, std::size_t draws) {
    out_.add_dimension(group, "chain", counted(1), {"1", "chain"});
    out_.add_dimension(group, "draw", counted(draws), {"1", "draw"});
  }
  void add_steps(const std::string& group) {
    out_.add_dimension(group, "step", steps_, {"1", "assimilated step"});
  }

  template <class Get>
  void add_statistic(const std::string& name, const std::string& units, const std::string& meaning,
                     const Get& get) {
    std::vector<double> values;
    for (const auto* result : file_.results) values.push_back(get(*result));
    out_.add_variable("sample_stats", name, Names{"step"}, values, {units, meaning});
  }

  files::NetcdfWriter& out_;
  const PosteriorFile& file_;
  const reduction::SeparatedModel& model_;
  const assimilation::Measurements& measurements_;
  std::size_t n_steps_;
  std::vector<double> steps_;
};

}  // namespace

void write_posterior_file(const std::string& path, const PosteriorFile& file,
                          const reduction::SeparatedModel& model,
                          const assimilation::Measurements& measurements) {
  files::write_atomically(path, [&](const std::string& temporary) {
    files::NetcdfWriter out(temporary);
    Writer writer(out, file, model, measurements);
    writer.write_draws();
    writer.write_predictive();
    writer.write_data();
    writer.write_statistics();
    writer.write_weighted_points();
    out.add_attribute("", "created_by", k_created_by);
    out.add_attribute("", "project", file.project);
    out.add_attribute("", "seed", std::to_string(file.seed));
    out.close();
  });
}

assimilation::UpdateResult read_last_posterior(const std::string& path,
                                               const std::vector<std::string>& parameters) {
  const files::Hdf5Reader file(path);
  const std::string names = file.text_attribute("/weighted_posterior", "parameters");
  if (names != fmt::format("{}", fmt::join(parameters, ","))) {
    throw DataError(fmt::format("{}: holds the posterior of {}, not of {}: run `knothe assimilate` again",
                                path, names, fmt::join(parameters, ",")));
  }
  const files::Shape shape = file.shape("/weighted_posterior/points");
  if (shape.size() != 3 || shape[0] == 0 || shape[2] != parameters.size()) {
    throw DataError(path + ": weighted_posterior/points must have the shape [step, point, parameter]");
  }
  const std::size_t last = shape[0] - 1;
  const std::vector<double> points =
      file.read_slab("/weighted_posterior/points", {last, 0, 0}, {1, shape[1], shape[2]});
  const std::vector<double> weights = file.read_slab("/weighted_posterior/weights", {last, 0}, {1, shape[1]});
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  assimilation::UpdateResult stored;
  stored.step = static_cast<std::size_t>(file.read("/weighted_posterior/step")[last]);
  stored.time = file.read("/sample_stats/time")[last];
  const auto n = static_cast<Eigen::Index>(shape[1]), d = static_cast<Eigen::Index>(shape[2]);
  stored.points = Eigen::Map<const RowMajor>(points.data(), n, d);
  stored.weights = Eigen::Map<const Eigen::VectorXd>(weights.data(), n);
  return stored;
}

}  // namespace knothe::report
