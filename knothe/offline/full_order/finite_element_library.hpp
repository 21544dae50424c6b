#pragma once
/// @file deal.II, p4est and PETSc: in a library of its own, libknothe-finite-elements.so, which
/// knothe-offline opens when it first needs finite elements. They come with some 140 other libraries, and to
/// link all those takes 0.15 s: too long for a command that has no mesh yet, or none at all.
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "knothe/offline/distributed/distributed_system.hpp"
#include "knothe/offline/distributed/mesh_part.hpp"
#include "knothe/offline/full_order/finite_elements.hpp"

namespace knothe::offline {

/// What the library can do. The functions of the same names that the rest of the room calls
/// (finite_elements.hpp, mesh_part.hpp, distributed_system.hpp) open it and hand on to these.
struct FiniteElementLibrary {
  FiniteElements (*evaluate_finite_elements)(std::span<const double> points,
                                             std::span<const std::int64_t> cells);
  MeshPart (*distribute_mesh)(const HexahedronMesh& coarse, int refinements);
  std::unique_ptr<DistributedSystem> (*make_distributed_system)(const MeshPart& part,
                                                                std::span<const char> prescribed);
};

/// Opens `file`, sought where the program's RUNPATH says if it is only a name; it stays open. Throws Error
/// (internal) if it cannot be opened or is something else.
[[nodiscard]] const FiniteElementLibrary& open_finite_element_library(const std::string& file);

}  // namespace knothe::offline
