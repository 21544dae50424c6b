#include "knothe/project/forecast_options.hpp"

#include <fmt/format.h>

#include "knothe/project/option_section.hpp"

namespace knothe::project {
namespace {

using F = assimilation::ForecastSpecification;

const Section<F>& forecast_section() {
  static const Section<F> k_section("forecast.*", "A forecast of that name.", [](Section<F>& s) {
    s.add("quantity", &F::quantity, "What is forecast.", required);
    s.add("horizon", &F::horizon, "Model time for which it is forecast.", required);
    s.add("threshold", &F::threshold,
          "P(q > threshold) is reported (the model's unit of q: SI where it is known).");
    s.table("prior", "Prior of an equivalent elastic crack length: `{ mean = …, std = … }`, m.");
    s.add("prior.mean", &F::prior_mean, "Prior mean of the equivalent elastic crack length, m.", required);
    s.add("prior.std", &F::prior_std, "Prior standard deviation of the equivalent elastic crack length, m.",
          positive, required);
    s.add("discrepancy_std", &F::discrepancy_std,
          "Discrepancy between damage model and elastic crack at each sensor, for Eq. 33, m; without it, "
          "estimated with the length.",
          positive);
    s.add("length_offset", &F::length_offset,
          "Length of the crack of interest minus that of the equivalent elastic crack, m "
          "(docs/explanation/forecast.md).");
    s.add("length_curve", &F::length_curve,
          "Length of the crack of interest at lengths of the equivalent elastic crack: `[[elastic, length], "
          "…]`, "
          "m, both increasing; linear in between. `length_offset` is added to it.",
          of_shape("a list of pairs, [[elastic, length], …], m"), no_default);
    s.add("model_error_std", &F::model_error_std,
          "Standard deviation of the model's error in the quantity at the horizon (for a crack length: of "
          "its offset), in its unit; added to the forecast.",
          non_negative);
    s.add("point", &F::point, "Where a displacement is forecast: x, y, z, m.", of_shape("[x, y, z]"),
          no_default);
    s.choice("component", &F::component, k_components, "Component of a displacement.", no_default);
    s.add("output", &F::output, "Name of a model's output, e.g. `reaction_force`.");
  });
  return k_section;
}

using D = assimilation::DecisionOptions;

const Section<D>& decide_section() {
  static const Section<D> k_section(
      "decide", "After each datum the next action: load, hold or stop (docs/explanation/decisions.md).",
      [](Section<D>& s) {
        s.add("failure", &D::failure,
              "Forecast whose quantity beyond its threshold is failure; its horizon means nothing here.",
              required);
        s.add("risk", &D::risk, "Largest probability that the whole test ends in failure.", positive,
              at_most(1));
        s.add("about", &D::about,
              "What to learn about: a parameter or a forecast (at its horizon); without it all parameters.");
        s.add("increments", &D::increments,
              "Increments of model time to choose among; without them any later time of the model.",
              of_shape("a list of positive numbers"), no_default);
        s.add("end", &D::end, "Model time beyond which there is no load; without it the model's last.");
        s.add("cost", &D::cost, "What a measurement costs, in nats: one that tells less is not made.",
              non_negative);
      });
  return k_section;
}

F read_forecast(Values& values, const std::string& name) {
  F f = forecast_section().read(values, name);
  f.name = name;
  const std::string path = "forecast." + name;
  const auto need = [&](F::Quantity quantity, const char* key, const char* text) {
    if (f.quantity == quantity && values.has(path + ".quantity") && !values.has(path + "." + key))
      values.complain(path, fmt::format("[{}] needs \"{}\"{}", path, key, text));
  };
  need(F::Quantity::displacement, "point", " = [x, y, z]");
  need(F::Quantity::displacement, "component", "");
  need(F::Quantity::output, "output", ", the name of one of the model's outputs");
  return f;
}

}  // namespace

std::vector<Option> forecast_option_table() {
  std::vector<Option> table = Section<F>("forecast", "One table per quantity of interest.").options();
  table.insert(table.end(), forecast_section().options().begin(), forecast_section().options().end());
  table.insert(table.end(), decide_section().options().begin(), decide_section().options().end());
  return table;
}

std::vector<F> read_forecasts(Values& values) {
  std::vector<F> forecasts;
  for (const std::string& name : values.children_of("forecast"))
    forecasts.push_back(read_forecast(values, name));
  return forecasts;
}

D read_decide(Values& values) {
  D options = decide_section().read(values);
  for (const double increment : options.increments)
    if (!(increment > 0))
      values.complain("decide.increments", "decide.increments must be positive: more model time");
  return options;
}

}  // namespace knothe::project
