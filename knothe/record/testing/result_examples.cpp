#include "knothe/record/testing/result_examples.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <vector>

namespace knothe::record::test {
namespace {

using nlohmann::json;

std::string attribute_fault(const std::string& tag) {
  std::size_t at = tag.find_first_of(" \n/");
  while (at != std::string::npos && at < tag.size()) {
    at = tag.find_first_not_of(" \n", at);
    if (at == std::string::npos || tag[at] == '/') return {};
    const std::size_t equals = tag.find('=', at);
    if (equals == std::string::npos || tag[equals + 1] != '"')
      return "attribute without quotes in <" + tag + ">";
    const std::size_t end = tag.find('"', equals + 2);
    if (end == std::string::npos) return "attribute without end in <" + tag + ">";
    if (tag.substr(equals, end - equals).find('<') != std::string::npos)
      return "< in an attribute of <" + tag + ">";
    at = end + 1;
  }
  return {};
}

std::string entity_fault(const std::string& text) {
  for (std::size_t at = text.find('&'); at != std::string::npos; at = text.find('&', at + 1)) {
    bool known = false;
    for (const char* entity : {"&amp;", "&lt;", "&gt;", "&quot;", "&#39;"})
      known = known || text.compare(at, std::string(entity).size(), entity) == 0;
    if (!known) return "unknown entity at " + text.substr(at, 12);
  }
  return {};
}

/// A normal density on [0.5, 1.5] at 101 points.
json density_on_box(double mean, double std) {
  json points = json::array(), values = json::array();
  double total = 0.0;
  for (int i = 0; i <= 100; ++i) {
    const double x = 0.5 + 0.01 * i;
    points.push_back(x);
    total += 0.01 * std::exp(-0.5 * std::pow((x - mean) / std, 2));
  }
  for (int i = 0; i <= 100; ++i)
    values.push_back(std::exp(-0.5 * std::pow((0.5 + 0.01 * i - mean) / std, 2)) / total);
  return {{"points", points}, {"density", values}};
}

json crack_forecast(double mean, double std) {
  json points = json::array(), values = json::array();
  for (int i = 0; i <= 160; ++i) {
    const double l = 0.079 * i / 160;
    points.push_back(l);
    values.push_back(std::exp(-0.5 * std::pow((l - mean) / std, 2)) / (std * std::sqrt(2 * M_PI)));
  }
  return {{"mean", mean},
          {"std", std},
          {"maximum_a_posteriori", mean + 0.1 * std},
          {"probability_above_threshold", 0.5 * std::erfc((0.04 - mean) / (std * std::sqrt(2.0)))},
          {"levels", {0.025, 0.25, 0.5, 0.75, 0.975}},
          {"values", {mean - 1.96 * std, mean - 0.67 * std, mean, mean + 0.67 * std, mean + 1.96 * std}},
          {"bridge_residual_rms", 2.5e-6},
          {"density", {{"points", points}, {"values", values}}}};
}

double progress(int step, double from, double to) {
  return std::clamp((step - from) / (to - from), 0.0, 1.0);
}

json step_line(int i, std::mt19937_64& engine) {
  std::normal_distribution<double> normal;
  const double s0 = 0.26 * std::pow(0.045 / 0.26, progress(i, 16, 32)) * std::pow(0.8, progress(i, 32, 100));
  const double s1 = 0.26 * std::pow(0.02 / 0.26, progress(i, 17, 40)) * std::pow(0.6, progress(i, 40, 100));
  const double m0 = 0.95 + 0.08 * progress(i, 16, 32) + 0.2 * s0 * std::sin(0.3 * i);
  const double m1 = 1.07 - 0.07 * progress(i, 17, 40) + 0.2 * s1 * std::cos(0.2 * i);
  const double l = 0.04 - 0.003 * progress(i, 18, 40), sl = 0.012 * std::pow(0.09, progress(i, 18, 45));
  const auto levels = [](double m, double s) {
    return json{m - 1.96 * s, m - 0.67 * s, m, m + 0.67 * s, m + 1.96 * s};
  };
  const bool running = i >= 19 && i <= 26;
  return {{"step", i},
          {"time", 0.01 * i},
          {"mean", {m0, m1}},
          {"covariance", {{s0 * s0, -0.5 * s0 * s1}, {-0.5 * s0 * s1, s1 * s1}}},
          {"maximum_a_posteriori", {m0, m1}},
          {"quantiles",
           {{"levels", {0.025, 0.25, 0.5, 0.75, 0.975}}, {"values", {levels(m0, s0), levels(m1, s1)}}}},
          {"map_order", running  ? 5
                        : i < 16 ? 1
                                 : 3},
          {"variance_diagnostic", running  ? 0.02 + 0.01 * (i % 4)
                                  : i < 16 ? 0.0
                                           : 4e-4},
          {"tolerance_reached", !running},
          {"ess", running ? 0.91 : 0.999},
          {"trusted", i != 22},
          {"remark", i == 22 ? "the order no longer helps" : ""},
          {"log_evidence", 800.0 * i},
          {"log_evidence_increment", 800.0 + 5.0 * normal(engine)},
          {"bias_correction", i < 60 ? "off" : "on"},
          {"monitor",
           {{"probability", 0.5},
            {"cumulative_sum", i < 50 ? 0.1 * i : 0.2 * i},
            {"threshold", 9.5},
            {"alarm", i >= 60},
            {"smoothed_increment", 800.0},
            {"discrepancy", i < 60 ? 0.0 : 0.3}}},
          {"notice", i == 60 ? "the model does not explain the data" : ""},
          {"models",
           {{"m3.h5", {{"probability", 0.25}, {"log_evidence", 790.0 * i}, {"log_bayes_factor", 1.1}}},
            {"m10.h5", {{"probability", 0.75}, {"log_evidence", 800.0 * i}, {"log_bayes_factor", 0.0}}}}},
          {"used", 60},
          {"rejected", 0},
          {"missing", i == 40 ? 2 : 0},
          {"elapsed_us",
           {{"update", (running ? 1900.0 : 210.0) + 30.0 * (i % 5)}, {"forecast", 120.0}, {"total", 400.0}}},
          {"marginals", {{"Y0", density_on_box(m0, s0)}, {"Ad", density_on_box(m1, s1)}}},
          {"forecast", {{"crack", crack_forecast(l, sl)}}},
          {"decision",
           {{"action", i < 80 ? "load" : "hold"},
            {"time", 0.01 * (i + 2)},
            {"information", 0.4},
            {"plan", {0.01 * (i + 2), 0.9}},
            {"failure_probability", 1e-4 * i},
            {"allowed_probability", 0.05},
            {"furthest", 0.95},
            {"message", "each measurement costs <0.05> nats"}}}};
}

json summary() {
  json u = json::array(), f = json::array();
  for (int i = 0; i <= 100; ++i) {
    const double x = i / 100.0;
    u.push_back(4e-4 * x);
    f.push_back(i <= 19 ? 9e3 * x / 0.19 : 9e3 * (0.12 + 0.88 * std::exp(-(x - 0.19) / 0.09)));
  }
  return {{"created_by", "knothe 0.1.0"},
          {"project", "model = \"beam.h5\"\n# <a comment> & \"quotes\"\n"},
          {"model", "beam.h5"},
          {"data", "data.h5"},
          {"seed", 1},
          {"parameters",
           {{{"name", "Y0"},
             {"prior", {{"prior", "normal"}, {"mean", 0.9}, {"std", 0.447}}},
             {"lower", 0.5},
             {"upper", 1.5},
             {"reference", 216.0},
             {"truth", 1.0}},
            {{"name", "Ad"},
             {"prior", {{"prior", "normal"}, {"mean", 1.1}, {"std", 0.447}}},
             {"lower", 0.5},
             {"upper", 1.5},
             {"reference", 2.25e-3},
             {"truth", 1.0}}}},
          {"prior_marginals", {{"Y0", density_on_box(0.9, 0.447)}, {"Ad", density_on_box(1.1, 0.447)}}},
          {"load_displacement", {{"displacement", u}, {"force", f}}},
          {"residuals",
           {{"step", {98, 99}},
            {"step_rms", {1e-6, 2e-6}},
            {"averaged", 2},
            {"component", "xxy"},
            {"x", {0.0, 0.1, 0.1}},
            {"y", {0.0, 0.02, 0.02}},
            {"mean", {1e-6, -2e-6, 5e-7}}}},
          {"forecasts", {{"crack", {{"quantity", "crack_length"}, {"horizon", 0.3}, {"threshold", 0.04}}}}},
          {"steps", 100},
          {"untrusted", {22}},
          {"elapsed_s", 0.4},
          {"machine", {{"cores", 2}, {"processor", "test"}}}};
}

}  // namespace

std::string xml_fault(const std::string& text) {
  std::vector<std::string> open;
  std::size_t at = 0, previous = 0;
  while ((at = text.find('<', previous)) != std::string::npos) {
    if (auto fault = entity_fault(text.substr(previous, at - previous));
        !fault.empty() && (open.empty() || open.back() != "style"))
      return fault;
    const std::size_t end = text.find('>', at);
    if (end == std::string::npos) return "a tag without end";
    const std::string tag = text.substr(at + 1, end - at - 1);
    previous = end + 1;
    if (tag[0] == '?' || tag[0] == '!') continue;
    if (tag[0] == '/') {
      if (open.empty() || open.back() != tag.substr(1)) return "</" + tag.substr(1) + "> closes nothing";
      open.pop_back();
      continue;
    }
    if (auto fault = attribute_fault(tag); !fault.empty()) return fault;
    if (auto fault = entity_fault(tag); !fault.empty()) return fault;
    if (tag.back() != '/') open.push_back(tag.substr(0, tag.find_first_of(" \n")));
  }
  return open.empty() ? "" : "<" + open.back() + "> is never closed";
}

std::string html_fault(const std::string& page) {
  std::string rest = page;
  for (const std::string element : {"script", "style"})
    for (std::size_t at = rest.find("<" + element); at != std::string::npos; at = rest.find("<" + element)) {
      const std::size_t end = rest.find("</" + element + ">", at);
      if (end == std::string::npos) return "<" + element + "> is never closed";
      rest.erase(at, end + element.size() + 3 - at);
    }
  return xml_fault(rest);
}

std::size_t count_of(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size()))
    ++count;
  return count;
}

std::string write_results(const files::TestFolder& folder, int steps) {
  std::mt19937_64 engine(1);
  std::ofstream lines(folder.file("steps.jsonl"));
  for (int i = 0; i < steps; ++i) lines << step_line(i + 1, engine).dump() << "\n";
  lines << R"({"done":true,"steps":100,"untrusted":[22],"elapsed_s":0.4})"
        << "\n";
  std::ofstream(folder.file("summary.json")) << summary().dump(1);
  return std::filesystem::path(folder.file("steps.jsonl")).parent_path().string();
}

model::ModelContents small_beam(model::Form form) {
  constexpr std::size_t nx = 42, ny = 5, steps = 11, modes = 4, nodes = 5;
  model::ModelContents c;
  c.form = form;
  c.created_by = "test";
  c.mesh.emplace();
  std::vector<std::array<double, 2>> at;
  for (int layer = 0; layer < 2; ++layer)
    for (std::size_t j = 0; j <= ny; ++j)
      for (std::size_t i = 0; i <= nx; ++i) {
        const double x = -0.42 + 0.84 * static_cast<double>(i) / nx, y = 0.1 * static_cast<double>(j) / ny;
        c.mesh->points.insert(c.mesh->points.end(), {x, y, 0.05 * layer});
        at.push_back({x, y});
      }
  const auto node = [&](std::size_t i, std::size_t j, std::size_t layer) {
    return static_cast<std::int64_t>((layer * (ny + 1) + j) * (nx + 1) + i);
  };
  for (std::size_t j = 0; j < ny; ++j)
    for (std::size_t i = 0; i < nx; ++i) {
      if (j == 0 && i == nx / 2) continue;  // the notch
      for (std::size_t layer : {0u, 1u})
        for (auto n :
             {node(i, j, layer), node(i + 1, j, layer), node(i + 1, j + 1, layer), node(i, j + 1, layer)})
          c.mesh->cells.push_back(n);
    }
  for (std::size_t n = 0; n < at.size(); ++n)
    for (int component = 0; component < 3; ++component) {
      for (std::size_t k = 0; k < 3; ++k) c.dofs.points.push_back(c.mesh->points[3 * n + k]);
      c.dofs.components.push_back(component);
    }
  for (const char* name : {"Y0", "Ad"}) {
    model::Axis axis;
    axis.name = name;
    for (std::size_t i = 0; i < nodes; ++i) axis.nodes.push_back(0.5 + static_cast<double>(i) / (nodes - 1));
    c.axes.push_back(axis);
  }
  for (std::size_t t = 0; t < steps; ++t) c.time.push_back(0.1 * static_cast<double>(t));
  c.space_modes = c.parameter_modes = modes;
  const auto field = [&](std::size_t k) {
    std::vector<double> u;
    for (const auto& p : at) {
      const double bend = std::tanh(p[0] * (5.0 + 20.0 * static_cast<double>(k)));
      u.insert(u.end(),
               {(0.05 - p[1]) * bend / (1.0 + static_cast<double>(k)), -(0.42 - std::abs(p[0])) * 0.3, 0.0});
    }
    return u;
  };
  for (std::size_t k = 0; k < modes; ++k) {
    const auto u = field(k);
    c.space.insert(c.space.end(), u.begin(), u.end());
  }
  c.lift.assign(steps * c.dofs.components.size(), 0.0);
  const auto in_time = [&](std::size_t k, double t) {
    return 1e-3 * t * std::exp(-static_cast<double>(k)) * std::cos(3.0 * t * static_cast<double>(k));
  };
  const auto in_parameter = [&](std::size_t k, double p) {
    return std::cos(static_cast<double>(k) * (p - 0.5));
  };
  if (form == model::Form::canonical) {
    for (std::size_t k = 0; k < modes; ++k)
      for (double t : c.time) c.temporal.push_back(in_time(k, t));
    for (std::size_t axis = 0; axis < 2; ++axis) {
      c.parameters.emplace_back();
      for (std::size_t k = 0; k < modes; ++k)
        for (double p : c.axes[axis].nodes) c.parameters.back().push_back(in_parameter(k, p));
    }
  } else {
    for (double t : c.time)
      for (std::size_t l = 0; l < modes; ++l)
        for (std::size_t k = 0; k < modes; ++k) c.temporal.push_back(l == k ? in_time(k, t) : 0.0);
    for (std::size_t k = 0; k < modes; ++k)
      for (double p : c.axes[0].nodes)
        for (double q : c.axes[1].nodes) c.joint.push_back(in_parameter(k, p) * in_parameter(k, q));
  }
  for (int i = 0; i < 80; ++i) c.crack.length.push_back(1e-3 * i);
  const auto a = field(0), b = field(3);
  c.crack.modes = a;
  c.crack.modes.insert(c.crack.modes.end(), b.begin(), b.end());
  for (int i = 0; i < 80; ++i) c.crack.coefficients.insert(c.crack.coefficients.end(), {1.0, 0.05 * i});
  return c;
}

}  // namespace knothe::record::test
