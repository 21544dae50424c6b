#pragma once
/// @file Full-order runs while the test goes on: the reduced model is refined at the posterior
/// (docs/explanation/verdict.md, "Running the full-order model at the posterior").
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "knothe/model/grid/local_refinement.hpp"
#include "knothe/model/simulator/simulator.hpp"
#include "knothe/project/project_engine.hpp"

namespace knothe::project {

/// The full-order model of the project's table [offline], in processes of `knothe-offline`. ProjectError
/// where the project has no such table. `keep`, `stop`: of `SolverProcessOptions`.
[[nodiscard]] std::unique_ptr<model::Simulator> full_order_simulator(const Project& project,
                                                                     std::string keep = {},
                                                                     std::stop_token stop = {});

/// The mean of a posterior, then one and a half standard deviations to both sides of it along its principal
/// axes; inside the box.
[[nodiscard]] std::vector<std::vector<double>> points_around(const Eigen::VectorXd& mean,
                                                             const Eigen::MatrixXd& covariance,
                                                             std::span<const model::Axis> box);

/// How far a posterior moves from one model to the next.
struct PosteriorMove {
  double mean = 0;  ///< largest change of a mean, in standard deviations of the later posterior
  double std = 0;   ///< largest relative change of a standard deviation
};
[[nodiscard]] PosteriorMove move_between(const posterior::Posterior& before,
                                         const posterior::Posterior& after);

/// When the posterior is the full-order model's: what one more refinement may still move it. A thorough
/// refinement ends when two rounds in a row have moved it by less than half of that, and the verdict does not
/// doubt the model.
struct RefinementGoal {
  double mean = 0.1;  ///< in standard deviations
  double std = 0.05;
};

/// Where a refinement goes on, that was begun by another process.
struct RefinementStart {
  std::vector<model::Snapshots> solutions;  ///< made so far
  std::size_t used = 0;                     ///< how many of them the present model was made from
  std::size_t version = 0;                  ///< of that model
  bool quiet = false;                       ///< shows no progress
  bool online = false;                      ///< for the service
};

/// Says in a verdict what `runs` full-order runs leave open: a doubt of the reduced model has other advice
/// then than to ask for them. `trouble`: a sentence on why the error of the model is not verified; empty: it
/// is.
void tell_what_was_asked(assimilation::Verdict& verdict, std::size_t runs, const std::string& trouble);
/// That sentence where the full-order model could not be asked.
[[nodiscard]] std::string not_verified(const std::string& why);

/// Whether a verdict doubts the reduced model.
[[nodiscard]] bool doubts_model(const assimilation::Verdict& verdict);

/// File of a refined model in the folder of a `Refinement`.
[[nodiscard]] std::string refined_model(const std::string& folder, std::size_t version);

/// What a project's model has become by the full-order solutions asked so far.
class Refinement {
 public:
  /// `folder`: where refined models go (`refined_model`). The project's model is the one that is refined;
  /// `setup` is with it. ProjectError, UsageError for what cannot be combined with it.
  Refinement(const Project& project, const UpdateSetup& setup, std::unique_ptr<model::Simulator> simulator,
             std::string folder, RefinementStart start = {});

  /// Makes the model finer around the posterior of `result`, the engine's last, and the engine that of the
  /// refined model with the same data, again and again until the posterior moves no more, or `runs`
  /// full-order runs have been made in all; `result` is then the new one. Without `thorough` the posterior's
  /// mean alone is asked for. False where no run was needed. NumericalError where the full-order model fails.
  bool refine(std::unique_ptr<assimilation::Engine>& engine, assimilation::StepResult& result,
              std::size_t runs, bool thorough, RefinementGoal goal = {});
  /// What a run of recorded data wants: at the last step all of that; before it, with half of the runs that
  /// the project allows, where the verdict doubts the model. A full-order model that fails is not asked
  /// again, and the last verdict says so.
  bool refine_if_needed(std::unique_ptr<assimilation::Engine>& engine, assimilation::StepResult& result,
                        bool is_last);

  [[nodiscard]] std::size_t runs() const { return solutions_.size(); }
  [[nodiscard]] std::size_t version() const { return version_; }            ///< 0: the project's own model
  [[nodiscard]] const std::string& file() const { return project_.model; }  ///< of this version
  /// Why the model's error is not verified: the full-order model failed, or the runs allowed were too few.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }
  [[nodiscard]] const std::optional<UpdateSetup>& setup() const { return setup_; }  ///< of it, unless it is 0
  /// By the last refinement of the last `refine`, and from its beginning to its end.
  [[nodiscard]] const PosteriorMove& last_move() const { return last_move_; }
  [[nodiscard]] const PosteriorMove& whole_move() const { return whole_move_; }

 private:
  [[nodiscard]] posterior::Posterior with_known(const posterior::Posterior& posterior) const;
  [[nodiscard]] std::vector<std::vector<double>> points_to_ask(const posterior::Posterior& posterior,
                                                               bool thorough) const;
  [[nodiscard]] bool covers(const posterior::Posterior& posterior) const;
  void solve(const std::vector<std::vector<double>>& points);
  [[nodiscard]] std::unique_ptr<assimilation::Engine> with_refined_model(
      const assimilation::Engine& engine, const posterior::Posterior& posterior);

  Project project_;  ///< its model is the present version
  model::ModelContents base_;
  model::TruncationError base_error_;
  std::shared_ptr<PictureMeasurements> pictures_;
  Eigen::MatrixXd known_;  ///< values of the parameters that are known, a row a time
  std::unique_ptr<model::Simulator> simulator_;
  std::string folder_;
  std::vector<model::Snapshots> solutions_;
  std::optional<model::InterpolationKernel> kernel_;  ///< of the last refinement made here
  std::size_t used_;                                  ///< how many of them the model is made from
  std::size_t version_;
  bool quiet_;
  bool online_ = false;
  std::optional<UpdateSetup> setup_;
  std::string trouble_;  ///< why the full-order model is no longer asked
  bool settled_ = true;  ///< the last round of the last `refine` moved the posterior by less than the goal
  PosteriorMove last_move_, whole_move_;
};

/// That of a project with [method] verify = "full-order", in its results folder; null for others.
[[nodiscard]] std::unique_ptr<Refinement> make_refinement(const Project& project, const UpdateSetup& setup);

}  // namespace knothe::project
