#include "knothe/record/population_record.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>

#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/files/netcdf.hpp"
#include "knothe/record/inference_results.hpp"
#include "knothe/record/json_values.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/record/physical_parameters.hpp"

namespace knothe::record {
namespace {

using Eigen::Index;
using Json = nlohmann::ordered_json;
using Names = std::vector<std::string>;
using assimilation::Coordinate;
using assimilation::PopulationResult;
using assimilation::SharedParameter;
using assimilation::SpecimenInPopulation;

Json quantiles_of(const Eigen::MatrixXd& values) {
  return {{"levels", numerics::k_quantile_levels}, {"values", rows_of(values)}};
}

/// Rows of the population's parameters.
Json part_of(const posterior::Posterior& p, Index begin, Index count) {
  return {{"mean", to_json(p.mean.segment(begin, count))},
          {"std", to_json(p.standard_deviations().segment(begin, count))},
          {"quantiles", quantiles_of(p.quantiles.middleRows(begin, count))}};
}

Json record_of(const SpecimenInPopulation& specimen) {
  return {{"name", specimen.name},
          {"own", {{"mean", to_json(specimen.mean)}, {"std", to_json(specimen.std)}}},
          {"mean", to_json(specimen.updated_mean)},
          {"std", to_json(specimen.updated_std)},
          {"quantiles", quantiles_of(specimen.updated_quantiles)},
          {"probability", specimen.probability},
          {"belongs", specimen.belongs}};
}

/// "mean of Y0", "spread of Y0", "correlation of Ad and Y0".
Names population_names(const PopulationResult& r) {
  Names names;
  for (const char* kind : {"mean", "spread"})
    for (const SharedParameter& parameter : r.parameters)
      names.push_back(fmt::format("{} of {}", kind, parameter.name));
  for (std::size_t i = 0; i < r.parameters.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      names.push_back(fmt::format("correlation of {} and {}", r.parameters[i].name, r.parameters[j].name));
  return names;
}

std::string in_coordinate(const SharedParameter& parameter) {
  return parameter.coordinate == Coordinate::logarithm ? "log " + parameter.name : parameter.name;
}

std::string range_of(const Eigen::MatrixXd& quantiles, Index k) {
  return fmt::format("{} … {}", readable(quantiles(k, 0)), readable(quantiles(k, quantiles.cols() - 1)));
}

std::string estimate_of(const posterior::Posterior& p, Index k) {
  return with_uncertainty(p.mean[k], p.standard_deviations()[k]);
}

std::string specimen_text(const SpecimenInPopulation& specimen,
                          const std::vector<SharedParameter>& parameters) {
  Names values;
  for (std::size_t k = 0; k < parameters.size(); ++k)
    values.push_back(fmt::format("{} {} → {}", in_coordinate(parameters[k]),
                                 with_uncertainty(specimen.mean[k], specimen.std[k]),
                                 with_uncertainty(specimen.updated_mean[k], specimen.updated_std[k])));
  return fmt::format("  {}: {}; p = {}{}\n", specimen.name, fmt::join(values, ", "),
                     readable(specimen.probability, 2),
                     specimen.belongs ? "" : ": does not belong to the population of the others");
}

/// Row by row.
std::vector<double> c_order(const Eigen::MatrixXd& m) {
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = m;
  return {rows.data(), rows.data() + rows.size()};
}

void write_points(const std::string& group, const Names& names, const Eigen::MatrixXd& points,
                  const Eigen::VectorXd& weights, files::NetcdfWriter& out) {
  out.add_dimension(group, "point", points.rows());
  out.add_dimension(group, "parameter", names, {"", "parameter"});
  out.add_variable(group, "points", Names{"point", "parameter"}, c_order(points), {"1", "points"});
  out.add_variable(group, "weights", Names{"point"}, std::span(weights.data(), weights.size()),
                   {"1", "weights, sum 1"});
  out.add_attribute(group, "parameters", fmt::format("{}", fmt::join(names, ",")));
}

}  // namespace

Json population_record(const PopulationResult& r) {
  const Index d = std::ssize(r.parameters);
  Json record;
  for (const SharedParameter& parameter : r.parameters) {
    record["parameters"].push_back(parameter.name);
    record["coordinates"].push_back(to_text(parameter.coordinate));
    const auto& mean = r.priors.mean.at(parameter.name);
    record["priors"]["mean"].push_back({mean.mean, mean.std});
    record["priors"]["spread"].push_back(r.priors.spread.at(parameter.name));
  }
  record["mean"] = part_of(r.population, 0, d);
  record["spread"] = part_of(r.population, d, d);
  if (d > 1) record["correlation"] = part_of(r.population, 2 * d, d * (d - 1) / 2);
  record["new_specimen"] = {{"mean", to_json(r.predictive_mean)},
                            {"covariance", rows_of(r.predictive_covariance)},
                            {"quantiles", quantiles_of(r.predictive_quantiles)}};
  for (const SpecimenInPopulation& specimen : r.specimens) record["specimens"].push_back(record_of(specimen));
  record["log_bayes_factor"] = r.log_bayes_factor;
  record["method"] = to_text(r.population.method);
  record["trusted"] = r.population.trusted;
  record["verdict"] = r.verdict;
  if (!r.warnings.empty()) record["warnings"] = r.warnings;
  return record;
}

std::string population_text(const PopulationResult& r) {
  const Index d = std::ssize(r.parameters);
  const Names names = population_names(r);
  std::string text = fmt::format("Population of {} specimens\n", r.specimens.size());
  for (Index k = 0; k < d; ++k)
    text += fmt::format("  {}: mean {}, spread {}; a new specimen's {}: {} (95 %)\n",
                        in_coordinate(r.parameters[k]), estimate_of(r.population, k),
                        estimate_of(r.population, d + k), r.parameters[k].name,
                        range_of(r.predictive_quantiles, k));
  for (Index k = 2 * d; k < r.population.mean.size(); ++k)
    text += fmt::format("  {}: {}\n", names[k], estimate_of(r.population, k));
  text += "Each specimen alone → with the others; p: probability of one as far from them\n";
  for (const SpecimenInPopulation& specimen : r.specimens) text += specimen_text(specimen, r.parameters);
  text += fmt::format("One population against unrelated specimens: log Bayes factor {}\n",
                      readable(r.log_bayes_factor));
  for (const std::string& warning : r.warnings) text += fmt::format("Warning: {}\n", warning);
  return text + r.verdict;
}

void write_population(const std::string& folder, const PopulationResult& r) {
  Names names;
  std::vector<model::Axis> axes;
  for (const SharedParameter& parameter : r.parameters) {
    names.push_back(parameter.name);
    axes.emplace_back().name = parameter.name;
  }
  const Index n = r.predictive.rows();
  files::write_atomically(samples_path(folder), [&](const std::string& temporary) {
    constexpr Index k_chains = 4;
    files::NetcdfWriter out(temporary);
    add_draws("posterior", axes, r.predictive, k_chains, out);
    write_points("weighted_posterior", names, r.predictive, Eigen::VectorXd::Constant(n, 1.0 / n), out);
    write_points("population", population_names(r), r.population.points, r.population.weights, out);
    add_creator({"posterior"}, out);
    out.add_attribute("", "title", "Parameters of a new specimen of a population");
    out.add_attribute("", "created_by", k_created_by);
    out.close();
  });
  Json content = population_record(r);
  content["created_by"] = k_created_by;
  files::write_text_atomically((std::filesystem::path(folder) / "population.json").string(),
                               files::json_line(content) + "\n");
}

}  // namespace knothe::record
