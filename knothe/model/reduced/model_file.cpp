#include "knothe/model/reduced/model_file.hpp"

#include <fmt/format.h>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/seal.hpp"
#include "knothe/model/grid/validation.hpp"
#include "knothe/model/reduced/form_names.hpp"
#include "knothe/model/reduced/truncation_error.hpp"

namespace knothe::model {

namespace {

constexpr int k_schema_version = 1;
/// How a mode is interpolated between its nodes (numerics/cubic_spline.hpp).
constexpr const char* k_basis = "not-a-knot cubic spline";

files::Shape temporal_shape(const ModelContents& model) {
  const std::size_t times = model.time.size();
  return model.form == Form::canonical ? files::Shape{model.space_modes, times}
                                       : files::Shape{times, model.space_modes, model.parameter_modes};
}

void validate_crack(const CrackSolutions& crack, std::size_t dofs, const Validation& check) {
  if (crack.empty()) return;
  check.increasing("/crack/length", crack.length);
  const std::size_t modes = crack.coefficients.size() / crack.length.size();
  check.require(modes > 0, "/crack/coefficients is empty");
  check.array("/crack/coefficients", crack.coefficients, {crack.length.size(), modes});
  check.array("/crack/modes", crack.modes, {modes, dofs});
}

Form read_form(const files::Hdf5Reader& file) {
  const std::string form = file.text_attribute("/", "form");
  if (const auto value = from_text<Form>(form)) return *value;
  throw DataError(fmt::format("{}: attribute form of / is \"{}\": \"canonical\" or \"tree\" is needed",
                              file.path(), form));
}

/// Before anything else: is it a reduced model, and one that this program understands?
void check_schema(const files::Hdf5Reader& file) {
  const std::string& path = file.path();
  if (!file.has_attribute("/", "schema_version")) {
    const bool snapshots = file.has("/snapshots");
    throw DataError(fmt::format(
        "{}: not a reduced model: attribute schema_version of / is missing{}", path,
        snapshots ? " (these are snapshots: make a model of them with knothe model import)" : ""));
  }
  const double version = file.number_attribute("/", "schema_version");
  if (version != k_schema_version) {
    throw DataError(fmt::format("{}: schema_version is {}, this is {} and reads {}: {}", path, version,
                                k_created_by, k_schema_version,
                                version > k_schema_version ? "use a newer knothe" : "make the model again"));
  }
}

/// The shape of `name` in the file, which must have `rank` dimensions.
files::Shape shape_of_rank(const files::Hdf5Reader& file, const std::string& name, std::size_t rank) {
  files::Shape shape = file.shape(name);
  if (shape.size() != rank) {
    throw DataError(
        fmt::format("{}: data set {} has {} dimensions, expected {}", file.path(), name, shape.size(), rank));
  }
  return shape;
}

void read_modes(const files::Hdf5Reader& file, ModelContents& model) {
  const files::Shape space = shape_of_rank(file, "/modes/space", 2);
  model.space_modes = space[0];
  model.space = file.read("/modes/space");
  if (model.form == Form::canonical) {
    model.parameter_modes = model.space_modes;
    for (const Axis& axis : model.axes) {
      model.parameters.push_back(
          file.read("/modes/parameters/" + axis.name, {model.parameter_modes, axis.nodes.size()}));
    }
  } else {
    const files::Shape joint = shape_of_rank(file, "/modes/parameters/joint", model.axes.size() + 1);
    model.parameter_modes = joint[0];
    model.joint = file.read("/modes/parameters/joint", joined({model.parameter_modes}, model.grid_shape()));
  }
  model.temporal = file.read("/modes/time", temporal_shape(model));
  model.lift = file.read("/lift", {model.time.size(), space[1]});
  if (const files::Labels labels = file.labels("/lift"); !labels.units.empty()) model.field = labels;
}

void read_crack(const files::Hdf5Reader& file, ModelContents& model) {
  if (!file.has("/crack/length")) return;
  model.crack.length = file.read("/crack/length");
  const std::size_t modes = shape_of_rank(file, "/crack/coefficients", 2)[1];
  model.crack.coefficients = file.read("/crack/coefficients", {model.crack.length.size(), modes});
  model.crack.modes = file.read("/crack/modes", {modes, model.dof_count()});
}

void write_modes(files::Hdf5Writer& file, const ModelContents& model) {
  const std::string& units = model.field.units;
  file.write("/modes/space", model.space, {model.space_modes, model.dof_count()}, {"1", "space modes"});
  file.write(
      "/modes/time", model.temporal, temporal_shape(model),
      {units, model.form == Form::canonical ? "time modes"
                                            : "time-dependent core C_t, space mode x parameter function"});
  if (model.form == Form::canonical) {
    for (Index i = 0; i < std::ssize(model.axes); ++i) {
      const Axis& axis = model.axes[i];
      const std::string path = "/modes/parameters/" + axis.name;
      file.write(path, model.parameters[i], {model.parameter_modes, axis.nodes.size()},
                 {"1", "parameter modes of " + axis.name + " at the nodes"});
      file.text_attribute(path, "basis", k_basis);
    }
  } else {
    const std::string path = "/modes/parameters/joint";
    file.write(path, model.joint, joined({model.parameter_modes}, model.grid_shape()),
               {"1", "parameter functions at the nodes of the grid"});
    file.text_attribute(path, "basis", std::string("tensor-product ") + k_basis);
  }
  file.write("/lift", model.lift, {model.time.size(), model.dof_count()},
             {units, model.field.long_name.empty() ? "lift" : model.field.long_name});
}

void write_rest(files::Hdf5Writer& file, const ModelContents& model) {
  write_dofs(file, model.dofs);
  write_quantities(file, model.quantities);
  write_mesh(file, model.mesh);
  write_outputs(file, model.outputs, model.grid_shape(), model.time.size());
  if (!model.crack.empty()) {
    const std::size_t lengths = model.crack.length.size(), modes = model.crack.coefficients.size() / lengths;
    file.write("/crack/length", model.crack.length, {lengths}, {"m", "crack length"});
    file.write("/crack/modes", model.crack.modes, {modes, model.dof_count()},
               {"1", "space modes of the elastic cracked solutions"});
    file.write("/crack/coefficients", model.crack.coefficients, {lengths, modes},
               {"1", "coefficients per metre of prescribed displacement"});
  }
}

/// Group of the outputs' errors.
const std::string k_output_errors = "/truncation/off_grid_outputs/";

void validate_truncation(const TruncationError& error, std::size_t times, std::size_t dofs,
                         const Validation& check) {
  if (error.count == 0) return;
  check.array("/truncation/space", error.space, {error.count, dofs});
  check.array("/truncation/covariance", error.covariance, {times, error.count, error.count});
  check.array("/truncation/variance", error.variance, {times});
  if (!error.off_grid.empty())
    check.array("/truncation/off_grid", error.off_grid, {error.off_grid_count(), times, error.count});
  for (const auto& [name, errors] : error.off_grid_outputs)
    check.array(k_output_errors + name, errors, {error.off_grid_count(), times});
  if (error.off_grid_points.empty()) return;
  const files::Shape shape = {error.off_grid_count(), error.parameters.size()};
  check.array("/truncation/off_grid_points", error.off_grid_points, shape);
  check.array("/truncation/off_grid_reach", error.off_grid_reach, shape);
  if (error.alike.empty()) return;
  check.array("/truncation/alike", error.alike, {error.parameters.size()});
  check.require(error.alike_within > 0, "attribute within of /truncation/alike must be positive");
}

void write_truncation(files::Hdf5Writer& file, const TruncationError& error, std::size_t times,
                      std::size_t dofs) {
  if (error.count == 0) return;
  file.write("/truncation/space", error.space, {error.count, dofs},
             {"1", "space modes of the model's own error"});
  file.write("/truncation/covariance", error.covariance, {times, error.count, error.count},
             {"m2", "second moments of the error's coefficients over the parameters"});
  file.write("/truncation/variance", error.variance, {times},
             {"m2", "variance per dof that the error's space modes leave out"});
  file.number_attribute("/truncation/covariance", "persistence", error.persistence);
  if (!error.off_grid.empty())
    file.write("/truncation/off_grid", error.off_grid, {error.off_grid_count(), times, error.count},
               {"m", "coefficients of the errors at solutions that the model was not made from"});
  for (const auto& [name, errors] : error.off_grid_outputs)
    file.write(k_output_errors + name, errors, {error.off_grid_count(), times},
               {"", "errors of the output at those solutions, in its unit"});
  if (error.off_grid_points.empty()) return;
  const files::Shape shape = {error.off_grid_count(), error.parameters.size()};
  file.write("/truncation/off_grid_points", error.off_grid_points, shape,
             {"1", "parameters of those solutions"});
  file.write(
      "/truncation/off_grid_reach", error.off_grid_reach, shape,
      {"1", "standard deviation around each within which its error speaks for others; 0: the whole box"});
  if (error.alike.empty()) return;
  file.write("/truncation/alike", error.alike, {error.parameters.size()},
             {"1", "exponents e: errors are alike where the sum of e ln p is"});
  file.number_attribute("/truncation/alike", "within", error.alike_within);
}

}  // namespace

namespace {

TruncationError read_sound_truncation_error(const std::string& path) {
  const files::Hdf5Reader file(path);
  check_schema(file);
  TruncationError error;
  if (!file.has("/truncation/space")) return error;
  const files::Shape space = shape_of_rank(file, "/truncation/space", 2);
  error.count = space[0];
  error.space = file.read("/truncation/space");
  error.variance = file.read("/truncation/variance");
  error.covariance = file.read("/truncation/covariance", {error.variance.size(), error.count, error.count});
  error.persistence = file.number_attribute("/truncation/covariance", "persistence");
  if (file.has("/truncation/off_grid")) error.off_grid = file.read("/truncation/off_grid");
  if (file.has("/truncation/off_grid_outputs"))
    for (const std::string& name : file.members("/truncation/off_grid_outputs"))
      error.off_grid_outputs[name] = file.read(k_output_errors + name);
  if (file.has("/truncation/off_grid_points")) {
    for (const Axis& axis : read_axes(file)) error.parameters.push_back(axis.name);
    error.off_grid_points = file.read("/truncation/off_grid_points");
    error.off_grid_reach = file.read("/truncation/off_grid_reach");
  }
  if (file.has("/truncation/alike")) {
    error.alike = file.read("/truncation/alike");
    error.alike_within = file.number_attribute("/truncation/alike", "within");
  }
  validate_truncation(error, error.variance.size(), space[1], Validation(path));
  return error;
}

}  // namespace

TruncationError read_truncation_error(const std::string& path) {
  files::require_sound(path, [&] { (void)read_sound_truncation_error(path); });
  return read_sound_truncation_error(path);
}

std::string to_text(Form form) {
  return knothe::to_text(form);
}

files::Shape ModelContents::grid_shape() const {
  return grid_of(axes);
}

void validate(const ModelContents& model, const std::string& where) {
  const Validation check(where);
  check.axes(model.axes);
  check.require(!model.time.empty(), "/time is empty");
  check.increasing("/time", model.time);
  const std::size_t dofs = model.dof_count();
  check.require(dofs > 0, "/modes/space is empty");
  check.array("/modes/space", model.space, {model.space_modes, dofs});
  check.array("/modes/time", model.temporal, temporal_shape(model));
  check.array("/lift", model.lift, {model.time.size(), dofs});
  if (model.form == Form::canonical) {
    check.require(model.space_modes == model.parameter_modes && model.parameters.size() == model.axes.size(),
                  "a canonical model has as many parameter modes per axis as space modes");
    for (Index i = 0; i < std::ssize(model.axes); ++i) {
      check.array("/modes/parameters/" + model.axes[i].name, model.parameters[i],
                  {model.parameter_modes, model.axes[i].nodes.size()});
    }
  } else {
    check.array("/modes/parameters/joint", model.joint, joined({model.parameter_modes}, model.grid_shape()));
  }
  check.dofs(model.dofs, dofs);
  check.quantities(model.quantities, dofs);
  if (model.mesh) check.mesh(*model.mesh);
  check.outputs(model.outputs, model.grid_shape(), model.time.size());
  validate_crack(model.crack, dofs, check);
}

void write_model(const ModelContents& model, const std::string& path) {
  write_model(model, TruncationError{}, path);
}

void write_model(const ModelContents& model, const TruncationError& truncation, const std::string& path) {
  validate(model, path);
  validate_truncation(truncation, model.time.size(), model.dof_count(), Validation(path));
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    file.integer_attribute("/", "schema_version", k_schema_version);
    file.text_attribute("/", "created_by", k_created_by);
    file.text_attribute("/", "form", to_text(model.form));
    file.text_attribute("/", "project", model.project);
    file.number_attribute("/", "relative_error", model.relative_error);
    file.number_attribute("/", "max_error_m", model.max_error_m);
    if (model.off_grid) {
      file.number_attribute("/", "off_grid_relative_error", model.off_grid->relative_error);
      file.number_attribute("/", "off_grid_max_error_m", model.off_grid->max_error_m);
      file.text_attribute("/", "off_grid_source", model.off_grid->source);
    }
    write_axes(file, model.axes, model.time, model.time_units);
    for (const Axis& axis : model.axes) file.text_attribute("/parameters/" + axis.name, "basis", k_basis);
    write_modes(file, model);
    write_rest(file, model);
    write_truncation(file, truncation, model.time.size(), model.dof_count());
    file.close();
    files::seal(temporary);
  });
}

namespace {

ModelContents read_sound_model(const std::string& path) {
  const files::Hdf5Reader file(path);
  check_schema(file);
  ModelContents model;
  model.form = read_form(file);
  model.project = file.text_attribute("/", "project");
  model.created_by = file.text_attribute("/", "created_by");
  model.relative_error = file.number_attribute("/", "relative_error");
  if (file.has_attribute("/", "off_grid_relative_error"))
    model.off_grid = {file.number_attribute("/", "off_grid_relative_error"),
                      file.number_attribute("/", "off_grid_max_error_m"),
                      file.text_attribute("/", "off_grid_source")};
  model.max_error_m = file.number_attribute("/", "max_error_m");
  model.axes = read_axes(file);
  model.time = read_time(file);
  model.time_units = read_time_units(file);
  read_modes(file, model);
  model.dofs = read_dofs(file);
  model.quantities = read_quantities(file);
  model.mesh = read_mesh(file);
  model.outputs = read_outputs(file, model.grid_shape(), model.time.size());
  read_crack(file, model);
  validate(model, path);
  return model;
}

}  // namespace

ModelContents read_model(const std::string& path) {
  files::require_sound(path, [&] { (void)read_sound_model(path); });
  return read_sound_model(path);
}

}  // namespace knothe::model
