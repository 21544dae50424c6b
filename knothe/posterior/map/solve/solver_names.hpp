#pragma once
/// @file Words in files for what a user chooses of a map solver.
#include <array>

#include "knothe/base/enum_names.hpp"
#include "knothe/posterior/map/solve/map_solver.hpp"

namespace knothe::posterior {

constexpr auto names_of(MinimiserKind /*kind*/) {
  using Kind = MinimiserKind;
  return std::to_array<Named<Kind>>(
      {{Kind::newton, "newton"}, {Kind::bfgs, "bfgs"}, {Kind::nelder_mead, "nelder-mead"}});
}

constexpr auto names_of(ModeSearchLevel /*level*/) {
  using Level = ModeSearchLevel;
  return std::to_array<Named<Level>>({{Level::tempered, "tempered"}, {Level::multi_start, "multi-start"}});
}

}  // namespace knothe::posterior
