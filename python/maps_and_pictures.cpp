/// @file Transport maps and image correlation: the facade of the library as it is (docs/how-to/library.md).
#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/text.hpp"
#include "knothe/knothe.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/interruption.hpp"

namespace knothe::python {
namespace {

using py::arg;

/// A point of the library as an array of its own: the caller may keep it.
py::array_t<double> copy_of(std::span<const double> point) {
  // Not of a count and a pointer: pybind11 2.10 then asks the element type of numpy 2 for its size, and gets
  // 0.
  return array_of(std::vector<double>(point.begin(), point.end()));
}

/// What a function of the caller has given. UsageError for something else.
template <class T>
T cast_of(const py::object& given, const char* what, const char* wanted) {
  try {
    return given.cast<T>();
  } catch (const std::exception&) {  // cast_error, or Python's own
    throw UsageError(std::string("fit: ") + what + " gave " + py::repr(given).cast<std::string>() + ", not " +
                     wanted);
  }
}

/// The caller's functions of Python, which are called with the interpreter's lock.
Density density_of(std::size_t dimension, py::function log_density, std::optional<py::function> gradient) {
  Density density{.dimension = dimension, .log_value = {}};
  density.log_value = [function = std::move(log_density)](std::span<const double> point) {
    check_cancellation("the map is not solved");
    const py::gil_scoped_acquire hold;
    return cast_of<double>(function(copy_of(point)), "the log-density", "a number");
  };
  if (gradient)
    density.gradient = [function = *std::move(gradient)](std::span<const double> point,
                                                         std::span<double> slope) {
      const py::gil_scoped_acquire hold;
      const auto values = cast_of<Doubles>(function(copy_of(point)), "the gradient", "numbers");
      if (values.size() != std::ssize(slope))
        throw UsageError("fit: the gradient has " + counted(values.size(), "value") + " for " +
                         counted(slope.size(), "variable"));
      std::copy_n(values.data(), slope.size(), slope.data());
    };
  return density;
}

/// The caller's compiled functions (addresses; 0: no gradient): without the lock, so threads fit side by
/// side.
Density density_of(std::size_t dimension, std::uintptr_t log_density, std::uintptr_t gradient) {
  // NOLINTBEGIN(performance-no-int-to-ptr): ctypes gives addresses as numbers
  Density density{.dimension = dimension, .log_value = {}};
  density.log_value = [function = reinterpret_cast<double (*)(const double*, std::size_t)>(log_density)](
                          std::span<const double> point) {
    check_cancellation("the map is not solved");
    return function(point.data(), point.size());
  };
  if (gradient != 0)
    density.gradient = [function = reinterpret_cast<void (*)(const double*, std::size_t, double*)>(gradient)](
                           std::span<const double> point, std::span<double> slope) {
      function(point.data(), point.size(), slope.data());
    };
  // NOLINTEND(performance-no-int-to-ptr)
  return density;
}

py::dict dictionary_of(Posterior p) {
  using namespace py::literals;
  const std::size_t d = p.dimension(), levels = p.levels.size();
  return py::dict(
      "mean"_a = array_of(std::move(p.mean)), "covariance"_a = rows_of(std::move(p.covariance), d),
      "maximum_a_posteriori"_a = array_of(std::move(p.maximum_a_posteriori)),
      "levels"_a = array_of(std::move(p.levels)), "quantiles"_a = rows_of(std::move(p.quantiles), levels),
      "points"_a = rows_of(std::move(p.points), d), "weights"_a = array_of(std::move(p.weights)),
      "log_evidence"_a = p.log_evidence, "map_order"_a = p.map_order,
      "variance_diagnostic"_a = p.variance_diagnostic, "ess"_a = p.effective_sample_size,
      "tolerance_reached"_a = p.tolerance_reached, "trusted"_a = p.trusted, "remark"_a = p.remark,
      "model_evaluations"_a = p.evaluations);
}

void bind_maps(py::module_& module) {
  using Map = TransportMap;
  const auto points = [](auto function) {
    return [function](const Map& map, const Doubles& x) {
      const auto span = span_of(x);
      return rows_of(long_call([&] { return (map.*function)(span); }), map.dimension());
    };
  };
  py::class_<Map>(module, "TransportMap")
      .def_property_readonly("dimension", &Map::dimension)
      .def_property_readonly("trusted", &Map::trusted)
      .def_property_readonly("remark", &Map::remark)
      .def("evaluate", points(&Map::evaluate), arg("reference"))
      .def("inverse", points(&Map::inverse), arg("points"))
      .def(
          "log_density",
          [](const Map& map, const Doubles& x) {
            const auto span = span_of(x);
            return array_of(long_call([&] { return map.log_density(span); }));
          },
          arg("points"))
      .def(
          "sample",
          [](const Map& map, std::size_t count, std::uint64_t seed) {
            return rows_of(long_call([&] { return map.sample(count, seed); }), map.dimension());
          },
          arg("count"), arg("seed"))
      .def(
          "conditional_sample",
          [](const Map& map, const Doubles& given, std::size_t count, std::uint64_t seed) {
            const auto span = span_of(given);
            return rows_of(long_call([&] { return map.conditional_sample(span, count, seed); }),
                           map.dimension());
          },
          arg("given"), arg("count"), arg("seed"))
      .def("save", &Map::save, arg("path"))
      .def_static("load", &Map::load, arg("path"))
      .def("describe", &Map::describe);
  module.def(
      "map_from_samples",
      [](const Doubles& samples, std::size_t dimension, int max_order, int folds, std::uint64_t seed) {
        const auto span = span_of(samples);
        return long_call([&] {
          return Map::from_samples(span, dimension, {.max_order = max_order, .folds = folds, .seed = seed});
        });
      },
      arg("samples"), arg("dimension"), arg("max_order"), arg("folds"), arg("seed"));
  const auto solve = [](auto log_density, auto gradient) {
    return [](std::size_t dimension, decltype(log_density) function, decltype(gradient) slope,
              double tolerance, int max_order, std::uint64_t seed, bool standardised, bool triangular,
              std::int64_t evaluations, double seconds) {
      const Density density = density_of(dimension, std::move(function), std::move(slope));
      MapSolution solution = long_call([&] {
        return solve_map(density,
                         {tolerance, max_order, seed, standardised, triangular, evaluations, seconds});
      });
      return py::make_tuple(std::move(solution.map), dictionary_of(std::move(solution.posterior)));
    };
  };
  module.def("solve_map", solve(py::function(), std::optional<py::function>()), arg("dimension"),
             arg("log_density"), arg("gradient"), arg("tolerance"), arg("max_order"), arg("seed"),
             arg("standardised"), arg("triangular"), arg("evaluations"), arg("seconds"));
  module.def("solve_compiled", solve(std::uintptr_t(), std::uintptr_t()), arg("dimension"),
             arg("log_density"), arg("gradient"), arg("tolerance"), arg("max_order"), arg("seed"),
             arg("standardised"), arg("triangular"), arg("evaluations"), arg("seconds"));
}

GreyPicture picture_of(const py::array_t<float, py::array::c_style | py::array::forcecast>& pixels,
                       float maximum) {
  if (pixels.ndim() != 2)
    throw UsageError("a picture is an array [height, width] of grey levels; this one has " +
                     std::to_string(pixels.ndim()) + (pixels.ndim() == 1 ? " index" : " indices"));
  return {static_cast<int>(pixels.shape(1)), static_cast<int>(pixels.shape(0)),
          std::vector<float>(pixels.data(), pixels.data() + pixels.size()), maximum};
}

py::tuple rows_of_precision(Noise::Precision& precision) {
  return py::make_tuple(array_of(std::move(precision.values)), array_of(std::move(precision.columns)),
                        array_of(std::move(precision.row_begin)));
}

py::dict dictionary_of(Displacements moved) {
  using namespace py::literals;
  return py::dict("u"_a = array_of(std::move(moved.u)), "v"_a = array_of(std::move(moved.v)),
                  "std_u"_a = array_of(std::move(moved.std_u)), "std_v"_a = array_of(std::move(moved.std_v)),
                  "precision"_a = rows_of_precision(moved.precision), "converged"_a = moved.converged,
                  "iterations"_a = moved.iterations, "elements_rejected"_a = moved.elements_rejected,
                  "residual_rms"_a = moved.residual_rms, "picture_noise"_a = moved.picture_noise,
                  "message"_a = moved.message);
}

using Corners = py::array_t<int, py::array::c_style | py::array::forcecast>;

/// Nodes n × 2 and elements m × 4, which Python has checked.
PictureMesh mesh_of(const Doubles& nodes, const Corners& elements) {
  PictureMesh mesh;
  for (py::ssize_t i = 0; i < nodes.size() / 2; ++i) {
    mesh.x.push_back(nodes.data()[2 * i]);
    mesh.y.push_back(nodes.data()[2 * i + 1]);
  }
  for (py::ssize_t i = 0; i < elements.size(); i += 4) {
    const int* corner = elements.data() + i;
    mesh.elements.push_back({corner[0], corner[1], corner[2], corner[3]});
  }
  return mesh;
}
/// x, y, elements.
py::tuple arrays_of_mesh(PictureMesh mesh) {
  std::vector<int> corners;
  for (const auto& element : mesh.elements) corners.insert(corners.end(), element.begin(), element.end());
  const auto count = std::ssize(mesh.elements);
  return py::make_tuple(array_of(std::move(mesh.x)), array_of(std::move(mesh.y)),
                        array_of(std::move(corners), {count, 4}));
}

/// A correlation that one thread uses at a time.
struct GuardedCorrelation {
  Correlation correlation;
  std::mutex mutex = {};
};

void bind_pictures(py::module_& module) {
  using Guarded = GuardedCorrelation;
  using Pixels = py::array_t<float, py::array::c_style | py::array::forcecast>;
  py::class_<Guarded>(module, "Correlation")
      .def(py::init([](const Pixels& reference, float maximum, const Doubles& nodes, const Corners& elements,
                       double element_size, std::array<double, 4> region, double prefilter_sigma,
                       int max_iterations, double tolerance, int threads) {
             const GreyPicture picture = picture_of(reference, maximum);
             const PictureMesh mesh = mesh_of(nodes, elements);
             return long_call([&] {
               return std::unique_ptr<Guarded>(
                   new Guarded{Correlation(picture, {element_size, region, prefilter_sigma, max_iterations,
                                                     tolerance, threads, mesh})});
             });
           }),
           arg("reference"), arg("maximum"), arg("nodes"), arg("elements"), arg("element_size"),
           arg("region"), arg("prefilter_sigma"), arg("max_iterations"), arg("tolerance"), arg("threads"))
      .def(
          "mesh",
          [](const Guarded& c) {
            return arrays_of_mesh({c.correlation.node_x(), c.correlation.node_y(), c.correlation.elements()});
          })
      .def(
          "correlate",
          [](Guarded& c, const Pixels& deformed, float maximum) {
            const GreyPicture picture = picture_of(deformed, maximum);
            return dictionary_of(long_call(c.mutex, [&] { return c.correlation.correlate(picture); }));
          },
          arg("deformed"), arg("maximum"))
      .def(
          "at",
          [](Guarded& c, const Doubles& points) {
            const auto span = span_of(points);
            return rows_of(long_call(c.mutex, [&] { return c.correlation.at(span); }), 2);
          },
          arg("points"));
  module.def(
      "read_mesh",
      [](const std::string& path) {
        return arrays_of_mesh(long_call([&] { return read_picture_mesh(path); }));
      },
      arg("path"));
  module.def(
      "read_picture",
      [](const std::string& path) {
        GreyPicture picture = long_call([&] { return read_grey_picture(path); });
        return py::make_tuple(array_of(std::move(picture.pixels), {picture.height, picture.width}),
                              picture.maximum);
      },
      arg("path"));
}

}  // namespace

void bind_maps_and_pictures(py::module_& module) {
  bind_maps(module);
  bind_pictures(module);
}

}  // namespace knothe::python
