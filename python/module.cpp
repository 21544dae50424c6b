/// @file Python's module `knothe._knothe`, on which the package (knothe/*.py) stands: errors, version.
#include <pybind11/pybind11.h>

#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"

namespace knothe::python {
namespace {

const char* name_of(ExitStatus status) {
  switch (status) {
    case ExitStatus::usage:
      return "UsageError";
    case ExitStatus::project:
      return "ProjectError";
    case ExitStatus::data:
      return "DataError";
    case ExitStatus::io:
      return "IoError";
    case ExitStatus::numerical:
      return "NumericalError";
    case ExitStatus::interrupted:
      return "Interrupted";
    default:
      return "Error";
  }
}

void raise(const Error& error) {
  // The signal has told Python too: heard here, it is not heard once more.
  if (error.status() == ExitStatus::interrupted && PyErr_CheckSignals() != 0) PyErr_Clear();
  const py::object type = py::module_::import("knothe._errors").attr(name_of(error.status()));
  PyErr_SetString(type.ptr(), error.what());
}

}  // namespace
}  // namespace knothe::python

PYBIND11_MODULE(_knothe, module) {
  using namespace knothe::python;
  pybind11::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const knothe::Error& error) {
      raise(error);
    }
  });
  module.attr("version") = knothe::k_version;
  module.def(
      "address", [](const Doubles& array) { return reinterpret_cast<std::uintptr_t>(span_of(array).data()); },
      pybind11::arg("array"));
  bind_maps_and_pictures(module);
  bind_engine(module);
  bind_models(module);
  bind_population(module);
}
