#pragma once
/// @file From a project file to everything one-shot inference needs.
#include <memory>
#include <optional>
#include <vector>

#include "knothe/assimilation/inference/inference.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {

struct InferenceSetup {
  std::vector<std::string> parameters;
  std::vector<posterior::Prior> priors;  ///< of a separated model: truncated to its box
  std::vector<model::Axis> axes;         ///< what 1 means and in which units; of a server: 1, not known
  std::unique_ptr<model::ForwardModel> model;
  std::optional<assimilation::Observations> observations;  ///< none: the model is a log posterior density
};

/// Reads the model, or asks the server what it has, and checks that model, observations and parameters fit
/// together. Nothing is evaluated. Errors: ProjectError at file:line:column, DataError of the model.
[[nodiscard]] InferenceSetup set_up_inference(const Project& project);

/// What the project says about the method; `method`, if not empty, overrides its kind.
[[nodiscard]] assimilation::InferenceOptions inference_options(const Project& project,
                                                               posterior::Method method);

}  // namespace knothe::project
