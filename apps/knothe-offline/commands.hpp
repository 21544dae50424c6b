#pragma once
/// @file The commands of `knothe-offline`; `knothe` passes its own command line on to them.
#include <optional>
#include <string>

namespace knothe::offline_commands {

struct BuildArguments {
  std::string project;
  std::string output;
  std::string method;  ///< overrides the project's
  bool json = false;
};
int build_model(const BuildArguments& arguments);

struct VerifyArguments {
  std::string project;
  std::string model;
  int points = 5;
  unsigned long seed = 1;
  bool json = false;
};
int verify(const VerifyArguments& arguments);

struct SimulateArguments {
  std::string project;
  std::string output;
  std::optional<unsigned long> seed;
  bool images = false;
};
int simulate(const SimulateArguments& arguments);

}  // namespace knothe::offline_commands
