#pragma once
/// @file The model that a journal's data are assimilated with: the project's, or what it was refined to.
#include "knothe/project/project_engine.hpp"
#include "knothe/service/journal/verification.hpp"

namespace knothe::service {

/// Immutable once it is shared.
struct ServedModel {
  project::Project project;  ///< its `model` is the file that is used
  project::UpdateSetup setup;
  Verification verification;

  [[nodiscard]] assimilation::EngineSetup engine_setup() const;
  /// Says in a result what the full-order model left open.
  void amend(assimilation::StepResult& result) const;
};

/// The model of a journal (`journal`: its path), by the last verification of its logbook. `setup` is that of
/// the project's own model. DataError where a refined model is not there, or not the one that was used.
[[nodiscard]] ServedModel served_model(const project::Project& project, const project::UpdateSetup& setup,
                                       const std::string& journal, Verification verification);

}  // namespace knothe::service
