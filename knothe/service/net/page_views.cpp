#include "knothe/service/net/page_views.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <filesystem>

#include "knothe/assimilation/forecast/forecast_inputs.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/picture_bytes.hpp"
#include "knothe/model/reduced/field_file.hpp"
#include "knothe/model/reduced/loading.hpp"
#include "knothe/model/reduced/model_matrices.hpp"
#include "knothe/numerics/statistics/normal_distribution.hpp"
#include "knothe/service/journal/test_journals.hpp"

namespace knothe::service {
namespace {

Json triples(const std::vector<double>& flat) {
  Json rows = Json::array();
  for (std::size_t i = 0; i + 2 < flat.size(); i += 3) rows.push_back({flat[i], flat[i + 1], flat[i + 2]});
  return rows;
}

/// The physical value of a parameter's 1, and its units where they are known.
Json reference_of(std::span<const model::Axis> axes, const std::string& name) {
  for (const model::Axis& axis : axes) {
    if (axis.name != name) continue;
    Json reference = {{"value", axis.reference}};
    if (const std::string units = model::reference_units(axis); !units.empty()) reference["units"] = units;
    return reference;
  }
  return nullptr;
}

/// "VTK_HEXAHEDRON" → "hexahedron".
std::string cell_name(std::string type) {
  if (type.starts_with("VTK_")) type.erase(0, 4);
  for (char& c : type) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return type;
}

/// Where the pictures lie in the model: model places of the outer corners of the first pixel, the last of the
/// first row, and the first of the last row.
Json picture_corners(const project::PictureMeasurements& pictures) {
  const files::Picture& reference = pictures.series().correlation().reference();
  const double right = reference.width - 0.5, bottom = reference.height - 0.5;
  Json corners = Json::array();
  for (const auto& [x, y] : {std::pair{-0.5, -0.5}, std::pair{right, -0.5}, std::pair{-0.5, bottom}})
    corners.push_back(pictures.frame().model_point(x, y));
  return corners;
}

/// Means of squares of pixels, at most `width` wide, black to white in 8 bits.
files::Picture reduced(const files::Picture& picture, int width) {
  const int by = (picture.width + width - 1) / width;
  files::Picture small;
  small.width = picture.width / by, small.height = picture.height / by;
  small.pixels.assign(small.index(0, small.height), 0.0F);
  const float scale = 255 / (picture.maximum * (by * by));
  for (int y = 0; y < small.height * by; ++y)
    for (int x = 0; x < small.width * by; ++x) small.at(x / by, y / by) += scale * picture.at(x, y);
  return small;
}

/// Values at the nodes from a shift of the model's functions w: U C_t δw.
std::vector<double> field_of_functions(const model::ModelContents& contents, std::size_t step,
                                       const Eigen::VectorXd& functions) {
  const Eigen::VectorXd at_dofs = model::space_of(contents) * (model::core_of(contents, step) * functions);
  return {at_dofs.begin(), at_dofs.end()};
}

}  // namespace

std::size_t parse_index(const std::string& text, const std::string& what) {
  std::size_t value = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value);
  if (parsed.ec != std::errc() || parsed.ptr != text.data() + text.size())
    throw RequestError(400, "Malformed", fmt::format("\"{}\" must be an integer ≥ 0", what));
  return value;
}

std::shared_ptr<const Line> line_of(const Site& site, const std::string& step) {
  auto line = step.empty() ? site.lines().latest() : site.lines().line(parse_index(step, "step"));
  if (!line)
    throw RequestError(
        404, "NoState",
        step.empty() ? "there are no data yet" : fmt::format("there is no posterior of step {}", step));
  return line;
}

Json description(const Site& site, const std::vector<std::string>& sites) {
  const project::Project& project = site.project();
  const auto& contents = site.setup().model.contents();
  Json parameters = Json::array();
  const auto& priors = site.priors();
  for (std::size_t k = 0; k < priors.size(); ++k) {
    std::vector<double> values;
    for (const double level : numerics::k_quantile_levels)
      values.push_back(priors[k].from_standard_normal(numerics::normal_quantile(level)).value);
    Json parameter = {{"name", project.parameters[k].name}, {"prior", priors[k].describe()}};
    if (std::isfinite(priors[k].lower())) parameter["lower"] = priors[k].lower();
    if (std::isfinite(priors[k].upper())) parameter["upper"] = priors[k].upper();
    parameter["units"] = "1";
    if (const Json reference = reference_of(contents.axes, project.parameters[k].name); !reference.is_null())
      parameter["reference"] = reference;
    parameter["quantiles"] = {{"levels", numerics::k_quantile_levels}, {"values", values}};
    parameters.push_back(parameter);
  }
  const Eigen::VectorXd& centre = site.centre();
  const auto imposed = model::loading_of(site.setup().model, project.clock, {centre.begin(), centre.end()});
  Json forecasts = Json::array();
  for (const auto& specification : project.forecasts) {
    Json entry = {{"name", specification.name},
                  {"quantity", to_text(specification.quantity)},
                  {"horizon", specification.horizon}};
    const bool crack = specification.quantity == assimilation::ForecastSpecification::Quantity::crack_length;
    if (specification.threshold || crack)
      entry["threshold"] = specification.threshold.value_or(specification.prior_mean);
    entry["units"] = assimilation::forecast_units(contents, specification);
    if (!specification.output.empty()) entry["output"] = specification.output;
    if (const auto at = imposed.at(specification.horizon))
      entry["loading"] = {{"value", *at}, {"units", imposed.units}};
    forecasts.push_back(entry);
  }
  const bool on_nodes = contents.mesh && !contents.dofs.empty();
  Json fields = on_nodes ? Json{"displacement", "sensitivity", "residual"} : Json{"residual"};
  if (project.method.update.bias_correction != likelihood::BiasCorrectionMode::off) fields.push_back("bias");
  const std::string run = site.identity().model.substr(0, 16) + site.identity().configuration.substr(0, 16) +
                          site.identity().sensors.substr(0, 16) + site.journal().id();
  Json answer = {{"run", run},
                 {"journal", site.journal().id()},
                 {"version", k_version},
                 {"site", site.name()},
                 {"test", site.test()},
                 {"sites", sites},
                 {"project", std::filesystem::path(project.path).filename().string()},
                 {"model", std::filesystem::path(project.model).filename().string()},
                 {"steps", contents.time.size()},
                 {"times", contents.time},
                 {"time", {{"label", "model time"}, {"units", contents.time_units}}},
                 {"displacements", site.setup().measurements.sensors.displacement_count()},
                 {"scalars", site.setup().measurements.sensors.scalars},
                 {"signal", first_signal(site)}};
  if (const auto period = site.health().period_s()) answer["period_s"] = *period;
  answer["budget_us"] = 1e6 * site.health().budget_s();
  if (const auto stale = site.health().stale_after_s()) answer["stale_after_s"] = *stale;
  answer["parameters"] = parameters;
  answer["forecasts"] = forecasts;
  answer["fields"] = fields;
  if (site.setup().pictures && !project.serve.picture_folder().empty())
    answer["picture"] = {{"corners", picture_corners(*site.setup().pictures)}};
  answer["method"] = {{"kind", to_text(project.method.kind)},
                      {"form", to_text(project.method.update.form)},
                      {"tolerance", project.method.update.map.tolerance}};
  answer["model_sha256"] = site.identity().model;
  answer["configuration_sha256"] = site.identity().configuration;
  return answer;
}

Json mesh(const Site& site) {
  const auto& model_mesh = site.setup().model.contents().mesh;
  if (!model_mesh) throw RequestError(404, "NoMesh", "the model has no mesh");
  Json connectivity = Json::array();
  const std::size_t k = model_mesh->nodes_per_cell;
  for (std::size_t c = 0; c < model_mesh->cell_count(); ++c)
    connectivity.push_back(std::vector<std::int64_t>(model_mesh->cells.begin() + c * k,
                                                     model_mesh->cells.begin() + (c + 1) * k));
  Json sensors = Json::array();
  const model::Sensors& places = site.setup().measurements.sensors;
  const Eigen::VectorXd& std = site.noise_std();
  for (std::size_t i = 0; i < places.displacement_count(); ++i)
    sensors.push_back({{"x", places.point(i)[0]},
                       {"y", places.point(i)[1]},
                       {"z", places.point(i)[2]},
                       {"component", places.components[i]},
                       {"std", std[i]}});
  Json scalars = Json::array();
  for (std::size_t i = 0; i < places.scalars.size(); ++i)
    scalars.push_back({{"name", places.scalars[i]}, {"std", std[places.displacement_count() + i]}});
  return {{"points", triples(model_mesh->points)},
          {"cells", Json::array({{{"type", cell_name(model_mesh->type)}, {"connectivity", connectivity}}})},
          {"sensors", sensors},
          {"scalars", scalars}};
}

Json field(const Site& site, const std::string& name, const std::string& step, const std::string& parameter) {
  const auto line = line_of(site, step);
  Json answer = {{"name", name}, {"step", line->step}, {"time", line->time}, {"units", "m"}};
  const std::size_t places = site.setup().measurements.sensors.displacement_count();
  const auto at_places = [&](const Eigen::VectorXd& values) {
    return std::vector<double>(values.data(), values.data() + places);
  };
  if (name == "residual") {
    Json missing = Json::array();
    for (std::size_t i = 0; i < places; ++i)
      if (line->missing[i]) missing.push_back(i);
    answer["location"] = "sensors";
    answer["values"] = at_places(line->residual);
    answer["missing"] = missing;
    return answer;
  }
  if (name == "bias" && line->bias.sensors.size() > 0) {
    answer["location"] = "sensors";
    answer["values"] = at_places(line->bias.sensors);
    answer["missing"] = Json::array();
    return answer;
  }
  if (name == "bias" && line->bias.functions.size() == 0)
    throw RequestError(404, "NoField",
                       fmt::format("the model's bias is not corrected in step {}", line->step));
  if (name != "displacement" && name != "sensitivity" && name != "bias")
    throw RequestError(
        404, "NoField",
        fmt::format("there is no field \"{}\"; there are displacement, sensitivity, residual, bias", name));
  const model::SeparatedModel& model = line->model->setup.model;
  const auto& contents = model.contents();
  if (!contents.mesh || contents.dofs.empty()) throw RequestError(404, "NoMesh", "the model has no mesh");
  answer["location"] = "nodes";
  const model::FieldOnMesh on_mesh(contents, "model");
  if (name == "bias") {
    const auto values = field_of_functions(contents, line->step, line->bias.functions);
    answer["values"] = triples(on_mesh.vectors(name, values).values);
    return answer;
  }
  std::vector<double> p(line->mean.begin(), line->mean.end());
  for (std::size_t k = 0; k < p.size(); ++k)
    p[k] = std::clamp(p[k], contents.axes[k].nodes.front(), contents.axes[k].nodes.back());
  const bool sensitivity = name == "sensitivity";
  auto found = model.evaluate(p, line->step, {}, sensitivity ? 1 : 0);
  if (sensitivity) {
    const auto names = model.parameter_names();
    const auto it = std::find(names.begin(), names.end(), parameter.empty() ? names.front() : parameter);
    if (it == names.end())
      throw RequestError(400, "Malformed", fmt::format("there is no parameter \"{}\"", parameter));
    const std::size_t k = it - names.begin();
    for (std::size_t i = 0; i < found.count; ++i)
      found.value[i] = found.gradient[i * found.dimension + k] * line->std[k];
    answer["parameter"] = *it;
  }
  answer["values"] = triples(on_mesh.vectors(name, found.value).values);
  return answer;
}

std::string picture(Site& site, const std::string& step) {
  const auto line = line_of(site, step);
  const std::string file = site.pictures().of(line->step);
  if (file.empty())
    throw RequestError(404, "NoPicture",
                       fmt::format("step {} was not measured in a watched picture", line->step));
  try {
    return files::png_bytes(reduced(files::read_picture(file), k_picture_width));
  } catch (const Error&) {  // its words would tell where it lies
    throw RequestError(404, "NoPicture", fmt::format("the picture of step {} cannot be read", line->step));
  }
}

Json observations(const Site& site, const std::string& step) {
  const auto line = line_of(site, step);
  const model::Sensors& sensors = site.setup().measurements.sensors;
  const std::size_t places = sensors.displacement_count();
  Json status = Json::array(), reason = Json::object(), scalars = Json::object();
  const std::vector<std::int64_t> off = site.logbook().off_at(line->step);
  for (std::size_t i = 0; i < line->missing.size(); ++i) {
    const std::string said = line->missing[i] ? "missing" : "used";
    if (i >= places) {
      Json entry = {{"status", said}};
      if (!line->missing[i]) entry["residual"] = line->residual[i];
      scalars[sensors.scalars[i - places]] = entry;
      continue;
    }
    status.push_back(said);
    if (line->missing[i])
      reason[std::to_string(i)] = std::find(off.begin(), off.end(), static_cast<std::int64_t>(i)) != off.end()
                                      ? "switched off"
                                      : "not measured";
  }
  return {{"step", line->step}, {"time", line->time}, {"status", status},
          {"reason", reason},   {"scalars", scalars}, {"misfit", misfit_record(line->misfit)}};
}

Json tests_of(const ServedSite& served) {
  const std::string& journal = served.project().serve.journal;
  const std::string current = served.current()->test();
  Json tests = Json::array();
  for (const std::string& name : tests_beside(journal)) {
    const std::string path = journal_of_test(journal, name);
    Json test = {{"name", name},
                 {"journal", std::filesystem::path(path).filename().string()},
                 {"current", name == current}};
    try {
      const JournalGlance glance = glance_at_journal(path);
      test["records"] = glance.records;
      test["finished"] = glance.finished;
      if (glance.begun_ms > 0) test["begun_at"] = 1e-3 * glance.begun_ms;
      if (glance.followed_by) test["followed_by"] = *glance.followed_by;
    } catch (const Error&) {  // its words would tell where it lies
      test["problem"] = "it cannot be read";
    }
    tests.push_back(test);
  }
  return tests;
}

Json samples(const Site& site, const std::string& step) {
  const auto line = line_of(site, step);
  Json points = Json::array();
  for (Eigen::Index i = 0; i < line->samples.rows(); ++i) {
    const Eigen::VectorXd row = line->samples.row(i);
    points.push_back(std::vector<double>(row.begin(), row.end()));
  }
  return {{"step", line->step}, {"parameters", site.setup().model.parameter_names()}, {"samples", points}};
}

}  // namespace knothe::service
