#include "knothe/project/model_comparison.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "knothe/assimilation/bias/model_selection.hpp"
#include "knothe/project/update_setup.hpp"

namespace knothe::project {

struct ModelComparison::Candidate {
  explicit Candidate(const Project& project)
      : setup(set_up(project)),
        update(setup.observed, setup.measurements.noise, setup.priors, setup.options) {}
  UpdateSetup setup;
  assimilation::SequentialUpdate update;
};

ModelComparison::ModelComparison(const Project& project) {
  const auto relative = [&](const std::string& file) {
    const auto path =
        std::filesystem::path(file).lexically_relative(project.folder.empty() ? "." : project.folder);
    return path.empty() ? file : path.string();  // an absolute path has none from a relative folder
  };
  if (project.candidates.empty()) return;
  models_.push_back({relative(project.model), 0, 0, 0, ""});
  for (const std::string& file : project.candidates) {
    Project other = project;
    other.model = file;
    candidates_.push_back(std::make_unique<Candidate>(other));
    models_.push_back({relative(file), 0, 0, 0, ""});
  }
}

ModelComparison::~ModelComparison() = default;

void ModelComparison::set_step_noise(std::size_t step, const assimilation::NoiseModel& noise) {
  for (const auto& candidate : candidates_) candidate->update.set_step_noise(step, noise);
}

void ModelComparison::update(std::size_t step, double log_evidence,
                             const Eigen::Ref<const Eigen::VectorXd>& values) {
  if (empty()) return;
  models_[0].log_evidence = log_evidence;
  std::vector<double> evidences = {log_evidence};
  for (std::size_t k = 0; k < candidates_.size(); ++k) {
    const auto& result =
        candidates_[k]->update.update(step, candidates_[k]->setup.time_indices[step], values);
    evidences.push_back(models_[k + 1].log_evidence = result.log_evidence);
  }
  const std::vector<double> probabilities = assimilation::model_probabilities(evidences);
  const double best = *std::max_element(evidences.begin(), evidences.end());
  for (std::size_t k = 0; k < models_.size(); ++k) {
    models_[k].probability = probabilities[k];
    models_[k].log_bayes_factor = best - evidences[k];
    models_[k].scale = assimilation::jeffreys_scale(best - evidences[k]);
  }
}

std::string ModelComparison::verdict() const {
  std::vector<ComparedModel> order = models_;
  std::stable_sort(order.begin(), order.end(), [](const ComparedModel& a, const ComparedModel& b) {
    return a.log_evidence > b.log_evidence;
  });
  std::string text =
      fmt::format("most probable model: {} (probability {:.3g})", order[0].file, order[0].probability);
  for (std::size_t k = 1; k < order.size(); ++k) {
    text += fmt::format("\n  over {}: log Bayes factor {:.1f}, {} evidence", order[k].file,
                        order[k].log_bayes_factor, order[k].scale);
  }
  return text;
}

}  // namespace knothe::project
