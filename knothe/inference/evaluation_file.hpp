#pragma once
/// @file Evaluations of a model kept over an interruption, so that they are not paid for twice.
#include <string>

#include "knothe/inference/model_evaluator.hpp"

namespace knothe::inference {

/// Writes what `evaluator` has stored: /points [n, d], /values [n, m], root attributes kind = "model
/// evaluations", schema_version and `identity` (what must be the same for the values to hold: the server, its
/// model, its configuration). Whole or not at all. Returns n. Errors: IoError.
Eigen::Index keep_evaluations(const std::string& path, const ModelEvaluator& evaluator,
                              const std::string& identity);

/// What became of a file of kept evaluations.
struct KeptEvaluations {
  Eigen::Index taken = 0;  ///< points that need not be evaluated again
  std::string refused;     ///< why nothing was taken, a clause; empty: there was no file, or it was taken
};

/// Reads such a file, if there is one, into `evaluator`. Three of its points are evaluated anew: where the
/// model answers otherwise than it did (by more than 1e-9 of the largest value), or the identity is another,
/// or the file is damaged, nothing is taken.
[[nodiscard]] KeptEvaluations take_evaluations(const std::string& path, ModelEvaluator& evaluator,
                                               const std::string& identity);

}  // namespace knothe::inference
