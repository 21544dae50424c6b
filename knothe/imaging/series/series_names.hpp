#pragma once
/// @file Words in files for what a user chooses of a correlation.
#include <array>

#include "knothe/base/enum_names.hpp"
#include "knothe/imaging/mesh/registration.hpp"
#include "knothe/imaging/series/picture_series.hpp"

namespace knothe::imaging {

constexpr auto names_of(Brightness /*brightness*/) {
  using B = Brightness;
  return std::to_array<Named<B>>({{B::none, "none"}, {B::global, "global"}, {B::per_element, "per_element"}});
}

constexpr auto names_of(DisplacementRegularisation /*kind*/) {
  using R = DisplacementRegularisation;
  return std::to_array<Named<R>>({{R::tikhonov, "tikhonov"}, {R::mechanical, "mechanical"}});
}

constexpr auto names_of(ElementShape /*shape*/) {
  using S = ElementShape;
  return std::to_array<Named<S>>({{S::quadrilateral, "quadrilateral"}, {S::triangle, "triangle"}});
}

constexpr auto names_of(View /*view*/) {
  return std::to_array<Named<View>>({{View::side, "side"}, {View::bottom, "bottom"}});
}

constexpr auto names_of(Drift /*drift*/) {
  return std::to_array<Named<Drift>>(
      {{Drift::none, "none"}, {Drift::shift, "shift"}, {Drift::rigid, "rigid"}});
}

}  // namespace knothe::imaging
