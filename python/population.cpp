#include "knothe/assimilation/population/population.hpp"

#include <pybind11/stl.h>

#include <nlohmann/json.hpp>

#include "knothe/files/atomic_file.hpp"
#include "knothe/files/json_line.hpp"
#include "knothe/library/plain.hpp"
#include "knothe/record/population_record.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/interruption.hpp"
#include "python/values.hpp"

namespace knothe::python {
namespace {

using assimilation::NamedPosterior;
using library::plain;
using namespace py::literals;

Eigen::MatrixXd matrix_of(const py::handle& array, std::size_t columns, const char* what) {
  return library::rows_of(span_of(array.cast<Doubles>()), columns, what);
}

posterior::PriorValues prior_of(const py::dict& values, std::size_t d) {
  posterior::PriorValues prior;
  for (const std::string& family : values["families"].cast<std::vector<std::string>>())
    prior.families.push_back(from_text<posterior::Prior::Family>(family).value());
  prior.mean = library::vector_of(span_of(values["mean"].cast<Doubles>()));
  prior.std = library::vector_of(span_of(values["std"].cast<Doubles>()));
  prior.log_density = matrix_of(values["log_density"], d, "log_density");
  prior.log_dependence = library::vector_of(span_of(values["log_dependence"].cast<Doubles>()));
  return prior;
}

/// A result that is in no folder: its name, and the values of `InferenceResult`.
NamedPosterior posterior_of(const py::dict& result) {
  NamedPosterior named{result["name"].cast<std::string>(),
                       {result["parameters"].cast<std::vector<std::string>>(), {}, {}, {}}};
  const std::size_t d = named.posterior.parameters.size();
  named.posterior.points = matrix_of(result["points"], d, "points");
  named.posterior.weights = library::vector_of(span_of(result["weights"].cast<Doubles>()));
  named.posterior.prior = prior_of(result["prior"].cast<py::dict>(), d);
  return named;
}

py::dict solve(const std::vector<std::variant<std::string, py::dict>>& results,
               const std::map<std::string, std::pair<double, double>>& mean,
               const std::map<std::string, double>& spread, std::uint64_t seed, const std::string& output) {
  std::vector<NamedPosterior> posteriors;
  for (const auto& result : results) {
    if (const auto* path = std::get_if<std::string>(&result))
      posteriors.push_back(assimilation::read_posterior(*path));
    else
      posteriors.push_back(posterior_of(std::get<py::dict>(result)));
  }
  assimilation::PopulationOptions options{.priors = {{}, spread}, .seed = seed};
  for (const auto& [name, prior] : mean) options.priors.mean[name] = {prior.first, prior.second};
  const assimilation::PopulationResult found = long_call([&] {
    if (!output.empty()) files::require_writable_folder(output);
    assimilation::PopulationResult solved = assimilation::solve_population(posteriors, options);
    if (!output.empty()) record::write_population(output, solved);
    return solved;
  });
  const std::size_t d = found.parameters.size(), all = found.population.mean.size();
  return py::dict("json"_a = files::json_line(record::population_record(found)),
                  "predictive"_a = rows_of(plain(found.predictive), d),
                  "points"_a = rows_of(plain(found.population.points), all),
                  "weights"_a = array_of(plain(found.population.weights)));
}

}  // namespace

py::dict prior_at(const std::vector<posterior::Prior>& priors, const Eigen::MatrixXd& points) {
  const posterior::PriorValues values = posterior::prior_values(priors, points);
  py::list families;
  for (const posterior::Prior::Family family : values.families) families.append(to_text(family));
  return py::dict("families"_a = families, "mean"_a = array_of(plain(values.mean)),
                  "std"_a = array_of(plain(values.std)),
                  "log_density"_a = rows_of(plain(values.log_density), priors.size()),
                  "log_dependence"_a = array_of(plain(values.log_dependence)));
}

void bind_population(py::module_& module) {
  module.def("population", &solve, py::arg("results"), py::arg("mean"), py::arg("spread"), py::arg("seed"),
             py::arg("output"));
}

}  // namespace knothe::python
