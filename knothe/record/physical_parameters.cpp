#include "knothe/record/physical_parameters.hpp"

#include <fmt/format.h>

#include <cmath>
#include <ctime>
#include <nlohmann/json.hpp>

#include "knothe/base/version.hpp"

namespace knothe::record {

std::vector<std::string> parameter_names(std::span<const model::Axis> axes) {
  std::vector<std::string> names;
  for (const model::Axis& axis : axes) names.push_back(axis.name);
  return names;
}

nlohmann::ordered_json support_of(const posterior::Prior& prior) {
  auto support = nlohmann::ordered_json::array();
  for (const double end : {prior.lower(), prior.upper()})
    support.push_back(std::isfinite(end) ? nlohmann::ordered_json(end) : nlohmann::ordered_json());
  return support;
}

nlohmann::ordered_json physical_record(std::span<const model::Axis> axes, const Eigen::VectorXd& mean,
                                       const Eigen::MatrixXd& covariance) {
  auto record = nlohmann::ordered_json::object();
  for (std::size_t k = 0; k < axes.size(); ++k) {
    const Eigen::Index i = k;
    auto& entry = record[axes[k].name];
    entry = {{"mean", axes[k].reference * mean[i]},
             {"std", std::abs(axes[k].reference) * std::sqrt(covariance(i, i))}};
    if (const std::string units = reference_units(axes[k]); !units.empty()) entry["units"] = units;
  }
  return record;
}

files::Labels labels_of(const model::Axis& axis) {
  return {axis.units.empty() ? "1" : axis.units, axis.long_name.empty() ? axis.name : axis.long_name};
}

void add_draws(const std::string& group, std::span<const model::Axis> axes, const Eigen::MatrixXd& draws,
               Eigen::Index chains, files::NetcdfWriter& out) {
  const Eigen::Index per_chain = draws.rows() / chains;
  add_chains(group, chains, per_chain, 1, out);
  for (std::size_t k = 0; k < axes.size(); ++k) {
    const model::Axis& axis = axes[k];
    const Eigen::VectorXd column = draws.col(k).head(chains * per_chain);
    out.add_variable(group, axis.name, std::vector<std::string>{"chain", "draw"},
                     std::span(column.data(), column.size()), labels_of(axis));
    out.add_number(group, axis.name, "reference", axis.reference);
    if (const std::string units = reference_units(axis); !units.empty())
      out.add_text(group, axis.name, "reference_units", units);
  }
}

void add_chains(const std::string& group, Eigen::Index chains, Eigen::Index draws, Eigen::Index stride,
                files::NetcdfWriter& out) {
  const auto counted = [](Eigen::Index count, Eigen::Index by) {
    std::vector<std::int64_t> numbers;
    for (Eigen::Index i = 0; i < count; ++i) numbers.push_back(i * by);
    return numbers;
  };
  out.add_dimension(group, "chain", counted(chains, 1), {"", "chain"});
  out.add_dimension(group, "draw", counted(draws, stride), {"", "draw"});
}

void add_creator(std::initializer_list<const char*> groups, files::NetcdfWriter& out) {
  const std::string now = utc_text(std::chrono::system_clock::now());
  out.add_attribute("", "history", fmt::format("{} {}", now, k_created_by));
  for (const char* group : groups) {
    out.add_attribute(group, "inference_library", "knothe");
    out.add_attribute(group, "inference_library_version", k_version);
    out.add_attribute(group, "created_at", now);
  }
}

std::string utc_text(std::chrono::system_clock::time_point time) {
  using std::chrono::milliseconds;
  const auto since = std::chrono::duration_cast<milliseconds>(time.time_since_epoch()).count();
  const std::time_t seconds = (since / 1000);
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}Z", parts.tm_year + 1900, parts.tm_mon + 1,
                     parts.tm_mday, parts.tm_hour, parts.tm_min, parts.tm_sec, since % 1000);
}

}  // namespace knothe::record
