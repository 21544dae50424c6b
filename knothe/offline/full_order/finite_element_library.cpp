#include "knothe/offline/full_order/finite_element_library.hpp"

#include <dlfcn.h>
#include <fmt/format.h>

#include "knothe/base/error.hpp"

namespace knothe::offline {
namespace {

const FiniteElementLibrary& library() {
  static const FiniteElementLibrary& opened = open_finite_element_library("libknothe-finite-elements.so");
  return opened;
}

}  // namespace

const FiniteElementLibrary& open_finite_element_library(const std::string& file) {
  void* const handle = dlopen(file.c_str(), RTLD_LAZY | RTLD_LOCAL);
  const void* const functions = handle != nullptr ? dlsym(handle, "knothe_finite_element_library") : nullptr;
  if (functions == nullptr)
    throw Error(ExitStatus::internal,
                fmt::format("could not open the finite elements: {}; install the package knothe-offline "
                            "again, or build the target knothe_finite_elements",
                            dlerror()));
  return *static_cast<const FiniteElementLibrary*>(functions);
}

FiniteElements evaluate_finite_elements(std::span<const double> points, std::span<const std::int64_t> cells) {
  return library().evaluate_finite_elements(points, cells);
}

MeshPart distribute_mesh(const HexahedronMesh& coarse, int refinements) {
  return library().distribute_mesh(coarse, refinements);
}

std::unique_ptr<DistributedSystem> make_distributed_system(const MeshPart& part,
                                                           std::span<const char> prescribed) {
  return library().make_distributed_system(part, prescribed);
}

}  // namespace knothe::offline
