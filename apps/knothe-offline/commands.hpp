#pragma once
/// @file The commands of `knothe-offline` that are more than one call of the library.
#include <optional>

#include "apps/offline_command_line.hpp"

namespace knothe::offline_commands {

int full_order(const FullOrderArguments& arguments);

struct FullOrderDataArguments {
  std::string project;
  std::string output;
  std::optional<unsigned long> seed;
  bool images = false;
};
int simulate(const FullOrderDataArguments& arguments);

int reproduce(const ReproduceArguments& arguments);

}  // namespace knothe::offline_commands
