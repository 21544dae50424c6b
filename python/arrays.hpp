#pragma once
/// @file Between numpy and the library's spans and vectors. Nothing is copied on the way in, and a result is
/// moved into the array that owns it.
#include <pybind11/numpy.h>

#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::python {

namespace py = pybind11;

/// C order, contiguous: the caller's own memory where it is that already.
using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Shape = std::vector<py::ssize_t>;

[[nodiscard]] inline std::span<const double> span_of(const Doubles& array) {
  return {array.data(), static_cast<std::size_t>(array.size())};
}
template <class T, int flags>
[[nodiscard]] std::vector<T> vector_of(const py::array_t<T, flags>& array) {
  return {array.data(), array.data() + array.size()};
}

/// An array of that shape whose memory is the vector's.
template <class T>
[[nodiscard]] py::array_t<T> array_of(std::vector<T> values, Shape shape) {
  auto owner = std::make_unique<std::vector<T>>(std::move(values));
  T* const data = owner->data();
  const py::capsule capsule(owner.get(), [](void* owned) { delete static_cast<std::vector<T>*>(owned); });
  owner.release();
  return py::array_t<T>(std::move(shape), data, capsule);
}
template <class T>
[[nodiscard]] py::array_t<T> array_of(std::vector<T> values) {
  const auto size = std::ssize(values);
  return array_of(std::move(values), {size});
}
/// n × d of n·d numbers.
[[nodiscard]] inline py::array_t<double> rows_of(std::vector<double> values, std::size_t columns) {
  const auto d = static_cast<py::ssize_t>(columns);
  const auto n = d == 0 ? 0 : std::ssize(values) / d;
  return array_of(std::move(values), {n, d});
}

}  // namespace knothe::python
