#pragma once
/// @file Error of a reduced model against full-order solutions that it was not built from.
#include <cstdint>
#include <string>

#include "knothe/files/command_output.hpp"

namespace knothe::offline {

struct VerifyOptions {
  std::string project;  ///< file that the model was built from
  std::string model;    ///< file
  int points = 5;       ///< of the box
  std::uint64_t seed = 1;
};
/// Solves at the points and prints a line for each, then one for all: errors of the field, and how far they
/// move the posterior of synthetic data, where the project describes any. Errors: DataError where the model
/// is not of the project's full-order model.
void verify_model(const VerifyOptions& options, const files::CommandOutput& output);

}  // namespace knothe::offline
