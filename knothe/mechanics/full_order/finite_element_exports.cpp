/// @file All that libknothe-finite-elements.so shows.
#include "knothe/mechanics/full_order/finite_element_library.hpp"

extern "C" [[gnu::visibility(
    "default")]] const knothe::mechanics::FiniteElementLibrary knothe_finite_element_library = {
    knothe::mechanics::evaluate_finite_elements, knothe::mechanics::distribute_mesh,
    knothe::mechanics::make_distributed_system};
