#include "knothe/model/forward/umbridge_model.hpp"

#include <fmt/format.h>

#include <limits>
#include <numeric>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/files/json_text.hpp"
#include "knothe/model/forward/umbridge_protocol.hpp"

namespace knothe::model {

using umbridge::Json;

namespace {

constexpr double k_nothing = std::numeric_limits<double>::quiet_NaN();

Eigen::Index sum_of(const std::vector<std::size_t>& sizes) {
  return std::accumulate(sizes.begin(), sizes.end(), std::size_t{0});
}

/// First index of vector `i` among all, one after the other.
Eigen::Index offset(const std::vector<std::size_t>& sizes, std::size_t i) {
  return std::accumulate(sizes.begin(), sizes.begin() + i, std::size_t{0});
}

std::vector<double> piece(const Eigen::Ref<const Eigen::VectorXd>& values, Eigen::Index begin,
                          std::size_t size) {
  return {values.data() + begin, values.data() + begin + size};
}

std::vector<double> unit_vector(std::size_t size, std::size_t i) {
  std::vector<double> e(size, 0.0);
  e[i] = 1;
  return e;
}

}  // namespace

/// Requests at one point; every answer is written over a poisoned buffer and checked.
struct UmbridgeModel::Protocol {
  const UmbridgeModel& model;
  HttpConnection& connection;
  Point point;

  [[nodiscard]] Json ask(const std::string& route, Json request) const {
    if (!point.allFinite())  // JSON has no word for it
      throw NumericalError(
          fmt::format("the search for the posterior overflowed, at {}: are the priors' "
                      "scales under [parameters] right?",
                      model.describe(point)));
    request["name"] = model.settings_.name;
    request["config"] = files::parse_json(model.settings_.config);
    request["input"] = umbridge::cut(point, model.input_sizes_);
    HttpAnswer answer;
    try {
      answer = connection.post(route, request.dump());
    } catch (const DataError& error) {
      throw DataError(fmt::format("{} (at {})", error.what(), model.describe(point)));
    }
    return umbridge::read_answer(answer, place(route), model.settings_.density);
  }

  [[nodiscard]] std::string place(const std::string& route) const {
    return model.address_.text + route + " at " + model.describe(point);
  }

  /// The answer of a derivative's route, one vector.
  [[nodiscard]] Eigen::VectorXd vector(const std::string& route, Json request, std::size_t size) const {
    const Json answer = ask(route, std::move(request));
    Eigen::VectorXd out = Eigen::VectorXd::Constant(size, k_nothing);
    umbridge::read_vector(umbridge::member(answer, "output", place(route)), out, "output", place(route));
    return out;
  }
};

UmbridgeModel::UmbridgeModel(UmbridgeSettings settings)
    : settings_(std::move(settings)), address_(HttpAddress::parse(settings_.url)) {
  for (int i = 0; i < settings_.connections; ++i)
    connections_.emplace_back(address_, settings_.timeout, settings_.table);
  ask_info();
  ask_model_info();
  input_sizes_ = ask_sizes("/InputSizes", "inputSizes");
  output_sizes_ = ask_sizes("/OutputSizes", "outputSizes");
  dimension_ = sum_of(input_sizes_);
  output_count_ = sum_of(output_sizes_);
}

std::string UmbridgeModel::where() const {
  return fmt::format("model \"{}\" at {}", settings_.name, address_.text);
}

/// Version and names. The reference implementations answer GET; servers that only take POST are asked so.
void UmbridgeModel::ask_info() {
  const std::string where = address_.text + "/Info";
  HttpAnswer answer = connections_[0].get("/Info");
  if (answer.status == 404 || answer.status == 405 || answer.status == 501)
    answer = connections_[0].post("/Info", "{}");
  const Json info = umbridge::read_answer(answer, where);
  const Json& version = umbridge::member(info, "protocolVersion", where);
  if (!version.is_number() || version.get<double>() != 1.0)
    throw DataError(
        fmt::format("{}: the server uses version {} of the UM-Bridge protocol; knothe supports 1.0", where,
                    version.dump()));
  std::vector<std::string> names;
  for (const Json& name : umbridge::member(info, "models", where))
    if (name.is_string()) names.push_back(name.get<std::string>());
  if (names.empty()) throw DataError(where + ": the server has no models");
  const std::string listed = fmt::format("\"{}\"", fmt::join(names, "\", \""));
  if (settings_.name.empty()) {
    if (names.size() > 1)
      throw DataError(fmt::format("{}: the server has several models: {}; choose one by `name` under {}",
                                  address_.text, listed, settings_.table));
    settings_.name = names[0];
  }
  if (std::find(names.begin(), names.end(), settings_.name) == names.end())
    throw DataError(fmt::format("{}: the server has no model \"{}\"{}; it has {}", address_.text,
                                settings_.name, did_you_mean(settings_.name, names), listed));
}

void UmbridgeModel::ask_model_info() {
  const std::string where = address_.text + "/ModelInfo";
  const Json info =
      umbridge::read_answer(connections_[0].post("/ModelInfo", Json{{"name", settings_.name}}.dump()), where);
  const Json& support = umbridge::member(info, "support", where);
  const auto supports = [&](const char* feature) {
    return support.is_object() && support.contains(feature) && support[feature].is_boolean() &&
           support[feature].get<bool>();
  };
  if (!supports("Evaluate"))
    throw DataError(fmt::format("{}: model \"{}\" does not support Evaluate", where, settings_.name));
  gradient_ = settings_.derivatives >= 1 && supports("Gradient");
  apply_jacobian_ = settings_.derivatives >= 1 && supports("ApplyJacobian");
  apply_hessian_ = settings_.derivatives >= 2 && supports("ApplyHessian");
}

std::vector<std::size_t> UmbridgeModel::ask_sizes(const std::string& route, const std::string& key) {
  const std::string where = address_.text + route;
  const Json request = {{"name", settings_.name}, {"config", files::parse_json(settings_.config)}};
  return umbridge::read_sizes(umbridge::read_answer(connections_[0].post(route, request.dump()), where), key,
                              where);
}

std::string UmbridgeModel::describe(const Point& point) const {
  std::string text;
  for (Eigen::Index k = 0; k < point.size(); ++k) {
    const std::size_t i = k;
    text += fmt::format("{}{} = {}", k > 0 ? ", " : "",
                        i < settings_.parameters.size() ? settings_.parameters[i] : fmt::format("p[{}]", k),
                        point[k]);
  }
  return text;
}

/// Calls `body` for each point, on as many connections at once as there are; point i is always done by
/// connection i modulo their number.
void UmbridgeModel::each_point(Eigen::Index count,
                               const std::function<void(HttpConnection&, Eigen::Index)>& body) {
  const auto lanes = std::ssize(connections_);
  parallel_for(connections_.size(), connections_.size(), [&](std::size_t lane) {
    for (Eigen::Index i = lane; i < count; i += lanes) {
      check_cancellation("the model was being evaluated");
      body(connections_[lane], i);
      if (answered) answered(i);
    }
  });
}

void UmbridgeModel::evaluate_one(HttpConnection& connection, const Point& point,
                                 Eigen::Ref<Eigen::VectorXd> out) const {
  const Protocol protocol{*this, connection, point};
  const std::string place = protocol.place("/Evaluate");
  const Json answer = protocol.ask("/Evaluate", {});
  const Json& output = umbridge::member(answer, "output", place);
  if (!output.is_array() || output.size() != output_sizes_.size())
    throw DataError(fmt::format("{}: \"output\" has {} vectors; by /OutputSizes it must have {}", place,
                                output.is_array() ? output.size() : 0, output_sizes_.size()));
  out.setConstant(k_nothing);
  for (std::size_t o = 0; o < output_sizes_.size(); ++o)
    umbridge::read_vector(output[o], out.segment(offset(output_sizes_, o), output_sizes_[o]),
                          fmt::format("output[{}]", o), place);
}

void UmbridgeModel::evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points,
                             Eigen::Ref<Eigen::MatrixXd> values) {
  each_point(points.cols(), [&](HttpConnection& connection, Eigen::Index i) {
    evaluate_one(connection, points.col(i), values.col(i));
  });
  calls_.evaluations += points.cols();
}

void UmbridgeModel::gradient(const Eigen::Ref<const Eigen::MatrixXd>& points,
                             const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                             Eigen::Ref<Eigen::MatrixXd> gradients) {
  each_point(points.cols(), [&](HttpConnection& connection, Eigen::Index i) {
    const Eigen::VectorXd point = points.col(i), sensitivity = sensitivities.col(i);
    const Protocol protocol{*this, connection, point};
    gradients.col(i).setZero();
    for (std::size_t o = 0; o < output_sizes_.size(); ++o)
      for (std::size_t b = 0; b < input_sizes_.size(); ++b)
        gradients.col(i).segment(offset(input_sizes_, b), input_sizes_[b]) +=
            protocol.vector("/Gradient",
                            {{"outWrt", o},
                             {"inWrt", b},
                             {"sens", piece(sensitivity, offset(output_sizes_, o), output_sizes_[o])}},
                            input_sizes_[b]);
  });
  calls_.gradients += points.cols() * std::ssize(output_sizes_) * std::ssize(input_sizes_);
}

void UmbridgeModel::jacobian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                             Eigen::Ref<Eigen::MatrixXd> jacobians) {
  each_point(points.cols(), [&](HttpConnection& connection, Eigen::Index i) {
    const Eigen::VectorXd point = points.col(i);
    const Protocol protocol{*this, connection, point};
    Eigen::MatrixXd j = Eigen::MatrixXd::Constant(output_count_, dimension_, k_nothing);
    for (std::size_t o = 0; o < output_sizes_.size(); ++o)
      for (std::size_t b = 0; b < input_sizes_.size(); ++b)
        for (std::size_t k = 0; k < input_sizes_[b]; ++k)
          j.col(offset(input_sizes_, b) + k).segment(offset(output_sizes_, o), output_sizes_[o]) =
              protocol.vector("/ApplyJacobian",
                              {{"outWrt", o}, {"inWrt", b}, {"vec", unit_vector(input_sizes_[b], k)}},
                              output_sizes_[o]);
    jacobians.col(i) = j.reshaped();
  });
  calls_.jacobians += points.cols() * dimension_ * std::ssize(output_sizes_);
}

void UmbridgeModel::hessian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                            const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                            Eigen::Ref<Eigen::MatrixXd> hessians) {
  each_point(points.cols(), [&](HttpConnection& connection, Eigen::Index i) {
    const Eigen::VectorXd point = points.col(i), sensitivity = sensitivities.col(i);
    const Protocol protocol{*this, connection, point};
    Eigen::MatrixXd h = Eigen::MatrixXd::Zero(dimension_, dimension_);
    for (std::size_t o = 0; o < output_sizes_.size(); ++o)
      for (std::size_t a = 0; a < input_sizes_.size(); ++a)
        for (std::size_t b = 0; b < input_sizes_.size(); ++b)
          for (std::size_t k = 0; k < input_sizes_[b]; ++k)
            h.col(offset(input_sizes_, b) + k).segment(offset(input_sizes_, a), input_sizes_[a]) +=
                protocol.vector("/ApplyHessian",
                                {{"outWrt", o},
                                 {"inWrt1", a},
                                 {"inWrt2", b},
                                 {"sens", piece(sensitivity, offset(output_sizes_, o), output_sizes_[o])},
                                 {"vec", unit_vector(input_sizes_[b], k)}},
                                input_sizes_[a]);
    hessians.col(i) = (0.5 * (h + h.transpose())).reshaped();
  });
  calls_.hessians += points.cols() * dimension_ * std::ssize(output_sizes_) * std::ssize(input_sizes_);
}

}  // namespace knothe::model
