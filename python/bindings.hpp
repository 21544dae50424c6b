#pragma once
/// @file The parts of Python's module: one function for each source.
#include <pybind11/pybind11.h>

namespace knothe::python {

void bind_maps_and_pictures(pybind11::module_& module);
void bind_engine(pybind11::module_& module);
void bind_models(pybind11::module_& module);
void bind_population(pybind11::module_& module);

}  // namespace knothe::python
