#pragma once
/// @file Several models side by side on the same data: which of them made it? (Rubio et al. 2019, Eq. 21-23)
#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "knothe/assimilation/noise/noise_model.hpp"
#include "knothe/project/project_file.hpp"

namespace knothe::project {

/// What is known of a model after some data.
struct ComparedModel {
  std::string file;         ///< as in the project file
  double log_evidence = 0;  ///< log p(d₀ … d_i) under this model
  double probability = 0;   ///< given the data, all models equally probable beforehand
  /// log of the Bayes factor of the most probable model over this one, and what it amounts to on the scale of
  /// Jeffreys.
  double log_bayes_factor = 0;
  std::string scale;
};

/// The project's model and those of `[model] candidates`, each with the priors and the method of the project.
class ModelComparison {
 public:
  /// Reads the candidates and the data. Errors: those of `set_up`, for each candidate. Without candidates
  /// there is nothing to compare.
  explicit ModelComparison(const Project& project);
  ~ModelComparison();

  [[nodiscard]] bool empty() const { return candidates_.empty(); }
  /// Assimilates step `step` with every candidate. `log_evidence`: of the project's own model; `values`: the
  /// datum, n_obs.
  /// `SequentialUpdate::set_step_noise` for each of the candidates.
  void set_step_noise(std::size_t step, const assimilation::NoiseModel& noise);
  void update(std::size_t step, double log_evidence, const Eigen::Ref<const Eigen::VectorXd>& values);
  /// The project's model first, then the candidates in order.
  [[nodiscard]] const std::vector<ComparedModel>& models() const { return models_; }
  /// The most probable model and by how much, in words.
  [[nodiscard]] std::string verdict() const;

 private:
  struct Candidate;
  std::vector<std::unique_ptr<Candidate>> candidates_;
  std::vector<ComparedModel> models_;
};

}  // namespace knothe::project
