#pragma once
/// @file `knothe infer`: one method on a project's model, its results folder, and what is said of it.
#include <string>

#include "knothe/assimilation/inference/comparison.hpp"
#include "knothe/assimilation/inference/inference.hpp"
#include "knothe/project/inference_setup.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::record {

struct InferenceRun {
  project::InferenceSetup setup;
  assimilation::InferenceResult result;
  std::string folder;
};

/// Runs one method, with a model of its own, so that its count of evaluations is its own, and writes its
/// results to `folder`. Warnings and the count of evaluations go to stderr. Evaluations of a server's model
/// that an interrupted run has stored in the folder are not paid for twice. Errors: as of set_up_inference
/// and infer; Interrupted with what is stored; IoError.
[[nodiscard]] InferenceRun run_inference(const project::Project& project, posterior::Method method,
                                         const std::string& folder);

/// The result as a table for people, without line end.
[[nodiscard]] std::string inference_text(const InferenceRun& run);
/// The differences of two results, likewise.
[[nodiscard]] std::string comparison_text(const InferenceRun& first, const InferenceRun& second,
                                          const assimilation::Comparison& comparison);

}  // namespace knothe::record
