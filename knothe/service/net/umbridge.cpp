#include "knothe/service/net/umbridge.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/files/json_text.hpp"
#include "knothe/model/forward/separated_forward_model.hpp"

namespace knothe::service {
namespace {

using Received = nlohmann::json;

/// The protocol's types of errors.
[[noreturn]] void invalid_input(const std::string& message) {
  throw RequestError(400, "InvalidInput", message);
}

Received received(const std::string& body) {
  try {
    return files::parse_json(body);
  } catch (const DataError& error) {
    invalid_input(std::string("the body is not JSON that can be taken: ") + error.what());
  }
}

const Received& member(const Received& object, const char* name) {
  const auto it = object.find(name);
  if (it == object.end()) invalid_input(fmt::format("\"{}\" is missing", name));
  return *it;
}

Eigen::VectorXd read_vector(const Received& array, Eigen::Index size, const std::string& what) {
  if (!array.is_array() || std::ssize(array) != size)
    invalid_input(fmt::format("\"{}\" must be an array of {} numbers", what, size));
  Eigen::VectorXd v(size);
  for (Eigen::Index i = 0; i < size; ++i) {
    const Received& entry = array[i];
    if (!entry.is_number() || !std::isfinite(entry.get<double>()))
      invalid_input(fmt::format("{}[{}] is not a finite number", what, i));
    v[i] = entry.get<double>();
  }
  return v;
}

/// The only block of inputs and of outputs has index 0.
void require_block(const Received& request, const char* name) {
  const Received& index = member(request, name);
  if (!index.is_number_integer() || index.get<std::int64_t>() != 0)
    invalid_input(fmt::format("\"{}\" must be 0: there is one vector of inputs and one of outputs", name));
}

Json array_of(const Eigen::VectorXd& v) {
  if (!v.allFinite()) throw RequestError(500, "InvalidOutput", "the result is not finite");
  return std::vector<double>(v.begin(), v.end());
}

bool is_name(const std::string& name) {
  return name == "forward" || name == "posterior" || name == "predict";
}

}  // namespace

/// A request for a model's value or derivatives, read and checked; then its answer.
struct UmBridge::Call {
  std::string name;
  SiteModels* models = nullptr;
  std::shared_ptr<Site> site;
  const Received& request;
  Eigen::VectorXd p;
  std::optional<std::size_t> step;  ///< none: there are no data
  bool inside = true;               ///< the model's box
  Eigen::VectorXd value;            ///< m
  Eigen::MatrixXd jacobian;         ///< m × d
  Eigen::MatrixXd hessian;          ///< d × d, of sensitivity · value
};

UmBridge::UmBridge(const std::vector<std::shared_ptr<ServedSite>>& sites) {
  for (const auto& site : sites) models_.push_back({site, {}, nullptr, nullptr, nullptr});
}

bool UmBridge::speaks(const std::string& path) {
  static const std::vector<std::string> k_paths = {"/Info",          "/ModelInfo",   "/InputSizes",
                                                   "/OutputSizes",   "/Evaluate",    "/Gradient",
                                                   "/ApplyJacobian", "/ApplyHessian"};
  return std::find(k_paths.begin(), k_paths.end(), path) != k_paths.end();
}

HttpResponse UmBridge::answer(const HttpRequest& request) {
  try {
    return {200, "application/json", files::json_line(respond(request))};
  } catch (const RequestError& error) {
    return error_response(error.status(), error.type(), error.what());
  } catch (const std::exception& error) {
    return error_response(500, "InvalidOutput", error.what());
  }
}

UmBridge::SiteModels& UmBridge::models_of(const nlohmann::json& config) {
  static const std::vector<std::string> k_keys = {"site", "step"};
  if (!config.is_object()) invalid_input("\"config\" must be an object");
  for (const auto& [key, value] : config.items())
    if (std::find(k_keys.begin(), k_keys.end(), key) == k_keys.end())
      invalid_input(fmt::format("config: \"{}\" is not a key of it{}; it has \"site\" and \"step\"",
                                key.substr(0, 100), did_you_mean(key, k_keys)));
  const auto it = config.find("site");
  if (it == config.end()) return models_.front();
  if (it->is_string())
    for (SiteModels& models : models_)
      if (models.served->name() == it->get<std::string>()) return models;
  invalid_input("config.site: there is no such site");
}

/// Another model has other functions.
void UmBridge::SiteModels::use(std::shared_ptr<const ServedModel> other) {
  if (model == other) return;
  model = std::move(other);
  density.reset();
  forecaster.reset();
}

Json UmBridge::respond(const HttpRequest& request) {
  if (request.path == "/Info")
    return {{"protocolVersion", 1.0}, {"models", {"forward", "posterior", "predict"}}};
  const Received body = received(request.body);
  if (!body.is_object()) invalid_input("the body must be a JSON object");
  const Received& name = member(body, "name");
  if (!name.is_string() || !is_name(name.get<std::string>()))
    throw RequestError(400, "ModelNotFound", fmt::format("Model {} not found!", name.dump().substr(0, 100)));
  Call call{name.get<std::string>(), nullptr, nullptr, body, {}, {}, true, {}, {}, {}};
  const Received config = body.value("config", Received::object());
  call.models = &models_of(config);
  call.site = call.models->served->current();
  if (call.models->site.lock() != call.site)
    *call.models = {call.models->served, call.site, nullptr, nullptr, nullptr};
  call.models->use(call.site->model());
  const Site& site = *call.site;
  const auto d = std::ssize(site.setup().problem.priors);
  const bool derivatives = call.name != "predict";
  if (request.path == "/ModelInfo")
    return {{"support",
             {{"Evaluate", true},
              {"Gradient", derivatives},
              {"ApplyJacobian", derivatives},
              {"ApplyHessian", derivatives}}}};
  if (request.path == "/InputSizes") return {{"inputSizes", {d}}};
  if (request.path == "/OutputSizes") {
    const auto forecasts = std::ssize(site.project().forecasts);
    return {{"outputSizes",
             {call.name == "forward"     ? site.setup().problem.model->observations()
              : call.name == "posterior" ? 1
                                         : forecasts}}};
  }
  if (request.path != "/Evaluate" && !derivatives)
    throw RequestError(400, "UnsupportedFeature",
                       fmt::format("{} is not supported by predict", request.path.substr(1)));
  const Received& input = member(body, "input");
  if (!input.is_array() || input.size() != 1) invalid_input("\"input\" must hold one vector");
  call.p = read_vector(input[0], d, "input[0]");
  if (const auto it = config.find("step"); it != config.end()) {
    const std::int64_t last = std::ssize(site.setup().problem.model->time) - 1;
    if (!it->is_number_integer() || it->get<std::int64_t>() < 0 || it->get<std::int64_t>() > last)
      invalid_input(fmt::format("config.step must be a step of the model, 0 to {}", last));
    call.step = it->get<std::size_t>();
  } else if (const auto line = site.lines().latest()) {
    call.step = line->step;
  }
  const auto& axes = site.setup().model.contents().axes;
  for (Eigen::Index k = 0; k < d; ++k) {
    const auto& nodes = axes[k].nodes;
    if (call.p[k] >= nodes.front() && call.p[k] <= nodes.back()) continue;
    call.inside = false;
    if (call.name != "posterior")
      invalid_input(fmt::format("{} = {} is outside the model's box [{}, {}]", axes[k].name, call.p[k],
                                nodes.front(), nodes.back()));
  }
  if (request.path == "/Evaluate") return evaluate(call);
  if (request.path == "/Gradient") return gradient(call);
  if (request.path == "/ApplyJacobian") return apply_jacobian(call);
  return apply_hessian(call);
}

Json UmBridge::evaluate(Call& call) {
  if (call.name == "forward") {
    evaluate_forward(call, 0, {});
  } else if (call.name == "posterior") {
    evaluate_posterior(call, 0);
  } else {
    evaluate_predict(call);
  }
  return {{"output", Json::array({array_of(call.value)})}};
}

Json UmBridge::gradient(Call& call) {
  require_block(call.request, "outWrt");
  require_block(call.request, "inWrt");
  const bool forward = call.name == "forward";
  forward ? evaluate_forward(call, 1, {}) : evaluate_posterior(call, 1);
  const Eigen::VectorXd sensitivity = read_vector(member(call.request, "sens"), call.jacobian.rows(), "sens");
  return {{"output", array_of(call.jacobian.transpose() * sensitivity)}};
}

Json UmBridge::apply_jacobian(Call& call) {
  require_block(call.request, "outWrt");
  require_block(call.request, "inWrt");
  const Eigen::VectorXd vec = read_vector(member(call.request, "vec"), call.p.size(), "vec");
  call.name == "forward" ? evaluate_forward(call, 1, {}) : evaluate_posterior(call, 1);
  return {{"output", array_of(call.jacobian * vec)}};
}

Json UmBridge::apply_hessian(Call& call) {
  require_block(call.request, "outWrt");
  require_block(call.request, "inWrt1");
  require_block(call.request, "inWrt2");
  const bool forward = call.name == "forward";
  const Eigen::Index m = forward ? call.site->setup().problem.model->observations() : 1;
  const Eigen::VectorXd sensitivity = read_vector(member(call.request, "sens"), m, "sens");
  const Eigen::VectorXd vec = read_vector(member(call.request, "vec"), call.p.size(), "vec");
  if (forward) {
    evaluate_forward(call, 2, sensitivity);
  } else {
    evaluate_posterior(call, 2);
    call.hessian *= sensitivity[0];
  }
  return {{"output", array_of(call.hessian * vec)}};
}

void UmBridge::evaluate_forward(Call& call, int derivatives, const Eigen::VectorXd& sensitivity) {
  const model::ObservedModel& observed = *call.models->model->setup.problem.model;
  const Eigen::Index d = call.p.size(), m = observed.observations();
  model::SeparatedForwardModel model(observed, {call.step.value_or(observed.time.size() - 1)}, "forward");
  if (derivatives == 0) {
    Eigen::MatrixXd values(m, 1);
    model.evaluate(call.p, values);
    call.value = values.col(0);
  } else if (derivatives == 1) {
    Eigen::MatrixXd columns(m * d, 1);
    model.jacobian(call.p, columns);
    call.jacobian = columns.reshaped(m, d);
  } else {
    Eigen::MatrixXd packed(d * d, 1);
    model.hessian(call.p, sensitivity, packed);
    call.hessian = packed.reshaped(d, d);
  }
}

void UmBridge::evaluate_posterior(Call& call, int derivatives) {
  Site& site = *call.site;
  const Eigen::Index d = call.p.size();
  call.value = Eigen::VectorXd::Constant(1, std::numeric_limits<double>::lowest());
  call.jacobian = Eigen::MatrixXd::Zero(1, d);
  call.hessian = Eigen::MatrixXd::Zero(d, d);
  if (!call.inside) return;
  const auto& priors = site.priors();
  for (Eigen::Index k = 0; k < d; ++k)
    if (!std::isfinite(priors[k].log_density(call.p[k]))) return;
  auto [model, form] = site.form_up_to(call.step.value_or(0));
  if (!form)
    throw RequestError(400, "UnsupportedFeature",
                       "this site's method has no posterior density in closed form");
  call.models->use(std::move(model));
  auto& density = call.models->density;
  if (!density) {
    const auto& functions = call.models->model->setup.problem.model->functions;
    model::FunctionBatch batch;
    batch.resize(1, d, functions->count(), 0);
    functions->evaluate(site.centre().transpose(), 0, batch);
    density = std::make_unique<likelihood::CollapsedLogDensity>(
        functions, std::make_shared<const posterior::PriorTransform>(priors), batch.value.row(0));
  }
  density->set_form(*form);
  posterior::LogDensityBatch batch;
  batch.resize(1, d, derivatives);
  density->evaluate_likelihood(call.p.transpose(), derivatives, batch);
  density->prior().add_log_density(call.p.transpose(), derivatives, batch);
  call.value[0] = batch.value[0];
  if (derivatives >= 1) call.jacobian = batch.gradient;
  for (Eigen::Index a = 0; derivatives >= 2 && a < d; ++a)
    for (Eigen::Index b = 0; b < d; ++b) call.hessian(a, b) = batch.hessian(0, posterior::packed_index(a, b));
}

void UmBridge::evaluate_predict(Call& call) {
  const Site& site = *call.site;
  auto& forecaster = call.models->forecaster;
  if (!forecaster)
    forecaster = std::make_unique<assimilation::Forecaster>(
        project::make_forecaster(site.project(), call.models->model->setup));
  const Eigen::MatrixXd point = call.p.transpose();
  const Eigen::VectorXd one = Eigen::VectorXd::Ones(1);
  std::map<std::string, double> values;
  for (const auto& named : forecaster->update(point, one)) values[named.name] = named.forecast.mean;
  call.value.resize(std::ssize(values));
  Eigen::Index i = 0;
  for (const auto& specification : site.project().forecasts) call.value[i++] = values.at(specification.name);
}

}  // namespace knothe::service
