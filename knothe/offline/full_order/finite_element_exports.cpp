/// @file All that libknothe-finite-elements.so shows.
#include "knothe/offline/full_order/finite_element_library.hpp"

extern "C" [[gnu::visibility(
    "default")]] const knothe::offline::FiniteElementLibrary knothe_finite_element_library = {
    knothe::offline::evaluate_finite_elements, knothe::offline::distribute_mesh,
    knothe::offline::make_distributed_system};
