#include "knothe/service/journal/served_model.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/base/sha256.hpp"
#include "knothe/project/refinement.hpp"

namespace knothe::service {

assimilation::EngineSetup ServedModel::engine_setup() const {
  assimilation::EngineSetup engine = project::engine_setup(project, setup);
  engine.model_version = verification.version;
  engine.archive = std::filesystem::absolute(project.serve.journal).parent_path().string();
  return engine;
}

void ServedModel::amend(assimilation::StepResult& result) const {
  const bool is_told = result.update.time >= verification.time;
  project::tell_what_was_asked(result.update.verdict, verification.runs,
                               is_told ? verification.trouble : std::string());
}

ServedModel served_model(const project::Project& project, const project::UpdateSetup& setup,
                         const std::string& journal, Verification verification) {
  if (verification.version == 0) return {project, setup, std::move(verification)};
  const std::string file =
      project::refined_model(refinement_folder(journal, verification.base), verification.version);
  const bool is_there = std::filesystem::exists(file);
  if (!is_there || to_hex(sha256_of_file(file)) != verification.model)
    throw DataError(
        fmt::format("{}: {}, the refined model that the data of {} were assimilated with: put it back", file,
                    is_there ? "is not what it was" : "is missing", journal));
  project::Project refined = project;
  refined.model = file;
  project::UpdateSetup other = project::set_up_again(refined, setup.pictures, true);
  return {std::move(refined), std::move(other), std::move(verification)};
}

}  // namespace knothe::service
