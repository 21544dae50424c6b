#include "knothe/project/refinement.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/base/program.hpp"
#include "knothe/base/progress.hpp"
#include "knothe/base/text.hpp"
#include "knothe/model/reduced/parameter_order.hpp"
#include "knothe/model/simulator/solver_process.hpp"
#include "knothe/numerics/statistics/weighted_statistics.hpp"

namespace knothe::project {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using model::Neighbourhood;
using posterior::Posterior;

namespace {

std::vector<std::string> names_of(const Project& project) {
  std::vector<std::string> names;
  for (const NamedPrior& parameter : project.parameters) names.push_back(parameter.name);
  for (const KnownParameter& parameter : project.known) names.push_back(parameter.name);
  return names;
}

/// The recorded values of what is known; where there are none, those of the project.
MatrixXd known_values(const Project& project, const MatrixXd& recorded) {
  if (recorded.rows() > 0 && recorded.cols() > 0) return recorded;
  MatrixXd values(1, std::ssize(project.known));
  for (Index k = 0; k < values.cols(); ++k) values(0, k) = project.known[k].value.value();
  return values;
}

std::vector<double> values_of(const VectorXd& vector) {
  return {vector.data(), vector.data() + vector.size()};
}

VectorXd as_vector(const std::vector<double>& values) {
  return Eigen::Map<const VectorXd>(values.data(), std::ssize(values));
}

}  // namespace

std::vector<std::vector<double>> points_around(const VectorXd& mean, const Eigen::MatrixXd& covariance,
                                               std::span<const model::Axis> box) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(covariance);
  std::vector<std::vector<double>> points;
  const auto add = [&](VectorXd p) {
    for (Index k = 0; k < p.size(); ++k) {
      const std::vector<double>& nodes = box[k].nodes;
      p[k] = std::clamp(p[k], nodes.front(), nodes.back());
    }
    points.push_back(values_of(p));
  };
  add(mean);
  for (Index a = 0; a < mean.size(); ++a)
    for (const double side : {-1.5, 1.5})
      add(mean + side * std::sqrt(std::max(0.0, axes.eigenvalues()[a])) * axes.eigenvectors().col(a));
  return points;
}

std::unique_ptr<model::Simulator> full_order_simulator(const Project& project, std::string keep,
                                                       std::stop_token stop) {
  project.require(project.offline.has_value(),
                  "the table [offline] that the model was made from, to ask its full-order model");
  model::SolverProcessOptions options;
  options.words = {program_beside("knothe-offline"), "solve", project.path};
  options.names = names_of(project);
  options.identity = project.text;
  options.processes = project.offline->processes;
  options.keep = std::move(keep);
  options.stop = std::move(stop);
  return std::make_unique<model::SolverProcess>(std::move(options));
}

std::unique_ptr<Refinement> make_refinement(const Project& project, const UpdateSetup& setup) {
  if (project.method.verify == ModelVerification::off) return nullptr;
  return std::make_unique<Refinement>(project, setup, full_order_simulator(project),
                                      (std::filesystem::path(project.results) / "refinement").string());
}

namespace {

/// Standard deviations within which 98 % of a normal distribution in d variables are.
double bulk_radius(Index d) {
  return 1.5 + std::sqrt(d);
}

/// Parameters as a vector of standard deviations from the posterior's mean, uncorrelated.
class Standardised {
 public:
  explicit Standardised(const Posterior& posterior) : mean_(posterior.mean), factor_(posterior.covariance) {}
  [[nodiscard]] VectorXd operator()(const VectorXd& p) const { return factor_.matrixL().solve(p - mean_); }

 private:
  VectorXd mean_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
};

}  // namespace

PosteriorMove move_between(const Posterior& before, const Posterior& after) {
  const VectorXd std = after.standard_deviations();
  return {(after.mean - before.mean).cwiseQuotient(std).cwiseAbs().maxCoeff(),
          (before.standard_deviations().cwiseQuotient(std).array() - 1).abs().maxCoeff()};
}

Refinement::Refinement(const Project& project, const UpdateSetup& setup,
                       std::unique_ptr<model::Simulator> simulator, std::string folder, RefinementStart start)
    : project_(project),
      base_(model::with_parameter_order(model::read_model(project.model), names_of(project))),
      base_error_(model::read_truncation_error(project.model)),
      pictures_(setup.pictures),
      known_(known_values(project, setup.known)),
      simulator_(std::move(simulator)),
      folder_(std::move(folder)),
      solutions_(std::move(start.solutions)),
      used_(start.used),
      version_(start.version),
      quiet_(start.quiet),
      online_(start.online) {}

std::string refined_model(const std::string& folder, std::size_t version) {
  return fmt::format("{}/model-{}.h5", folder, version);
}

/// The posterior with the parameters that are known: each has the values that were recorded, whatever the
/// others are.
Posterior Refinement::with_known(const Posterior& posterior) const {
  const Index d = posterior.mean.size(), k = known_.cols(), times = known_.rows();
  if (k == 0) return posterior;
  constexpr double k_width = 1e-3;          // of the axis: a value that is always the same
  constexpr double k_golden = 0.618033988;  // spreads a sequence evenly over the times
  Posterior whole = posterior;
  whole.mean.conservativeResize(d + k);
  whole.mean.tail(k) = known_.colwise().mean().transpose();
  const MatrixXd centred = known_.rowwise() - known_.colwise().mean();
  whole.covariance = MatrixXd::Zero(d + k, d + k);
  whole.covariance.topLeftCorner(d, d) = posterior.covariance;
  whole.covariance.bottomRightCorner(k, k) = centred.transpose() * centred / times;
  for (Index a = d; a < d + k; ++a) {
    const std::vector<double>& nodes = base_.axes[a].nodes;
    whole.covariance(a, a) += std::pow(k_width * (nodes.back() - nodes.front()), 2);
  }
  whole.points.conservativeResize(Eigen::NoChange, d + k);
  for (Index i = 0; i < whole.points.rows(); ++i) {
    const double turn = k_golden * i;
    const Index time = (turn - std::floor(turn)) * times;
    whole.points.row(i).tail(k) = known_.row(time);
  }
  return whole;
}

/// The mean, unless a solution is near it; then, if `thorough`, those of the bulk that reduce the kriging
/// variance most: two points at a time, since each pair moves the posterior.
std::vector<std::vector<double>> Refinement::points_to_ask(const Posterior& given, bool thorough) const {
  const Posterior posterior = with_known(given);
  constexpr double k_near = 0.5;  // in standard deviations
  constexpr Index k_at_once = 2, k_candidates = 256;
  const Index d = posterior.mean.size();
  MatrixXd known(std::ssize(solutions_), d);
  for (std::size_t i = 0; i < solutions_.size(); ++i)
    known.row(i) = as_vector(solutions_[i].parameters_at(0)).transpose();
  const Standardised scale(posterior);
  const auto is_near = [&](const auto& p) { return scale(p.transpose()).norm() <= k_near; };
  std::vector<std::vector<double>> points;
  const auto ask = [&](const VectorXd& p) {
    points.push_back(values_of(p));
    known.conservativeResize(known.rows() + 1, Eigen::NoChange);
    known.bottomRows(1) = p.transpose();
  };
  if (std::none_of(known.rowwise().begin(), known.rowwise().end(), is_near)) ask(posterior.mean);
  if (!thorough) return points;
  // Tails count more: the standard deviations depend on them.
  VectorXd weights = posterior.weights;
  for (Index i = 0; i < weights.size(); ++i) {
    const double far = scale(posterior.points.row(i).transpose()).norm();
    weights[i] *= far < bulk_radius(d) ? 1 + far * far : 0;
  }
  if (!(weights.sum() > 0)) return points;  // a posterior of no width
  const MatrixXd candidates = posterior.points(numerics::equal_draws(weights, k_candidates), Eigen::all);
  const Neighbourhood at{posterior.mean, posterior.covariance};
  const MatrixXd more = model::most_informative(base_.axes, known, candidates,
                                                kernel_ ? *kernel_ : model::kernel_of_cell(base_.axes, at),
                                                k_at_once - std::ssize(points));
  for (const auto& p : more.rowwise()) points.push_back(values_of(p.transpose()));
  return points;
}

/// Enough solutions in the bulk to know how the error changes over it: two for each parameter; of many
/// parameters few matter.
bool Refinement::covers(const Posterior& given) const {
  const Posterior posterior = with_known(given);
  constexpr Index k_enough = 6;
  const Standardised scale(posterior);
  const auto inside =
      std::count_if(solutions_.begin(), solutions_.end(), [&](const model::Snapshots& solution) {
        return scale(as_vector(solution.parameters_at(0))).norm() < bulk_radius(posterior.mean.size());
      });
  return inside > std::min(2 * posterior.mean.size(), k_enough);
}

void Refinement::solve(const std::vector<std::vector<double>>& points) {
  Progress progress("full-order runs at the posterior", points.size(), quiet_);
  for (model::Snapshots& solution :
       simulator_->solve_all(points, [&](std::size_t done) { progress.advance_to(done); }))
    solutions_.push_back(std::move(solution));
}

std::unique_ptr<assimilation::Engine> Refinement::with_refined_model(const assimilation::Engine& engine,
                                                                     const Posterior& given) {
  const Posterior posterior = with_known(given);
  model::RefinedModel fine =
      model::refined(base_, base_error_, solutions_, {posterior.mean, posterior.covariance});
  fine.model.project = project_.text;
  kernel_ = fine.kernel;
  std::filesystem::create_directories(folder_);
  const std::string file = refined_model(folder_, version_ + 1);
  model::write_model(fine.model, fine.error, file);
  project_.model = file;
  ++version_;
  used_ = solutions_.size();
  setup_ = set_up_again(project_, pictures_, online_);
  assimilation::EngineSetup refined = engine_setup(project_, *setup_);
  refined.model_version = version_;
  return std::make_unique<assimilation::Engine>(engine.with_setup(std::move(refined)));
}

bool Refinement::refine(std::unique_ptr<assimilation::Engine>& engine, assimilation::StepResult& result,
                        std::size_t runs, bool thorough, RefinementGoal goal) {
  const Posterior first = result.update;
  const std::size_t version = version_;
  int settled = 0;  // rounds in a row
  settled_ = true;
  while (true) {
    std::vector<std::vector<double>> points = points_to_ask(result.update, thorough);
    points.resize(std::min(points.size(), runs - std::min(runs, solutions_.size())));
    if (points.empty() && used_ == solutions_.size()) break;
    solve(points);
    engine = with_refined_model(*engine, result.update);
    assimilation::StepResult next = engine->posterior_at(result.update.step);
    last_move_ = move_between(result.update, next.update);
    result = std::move(next);
    const auto within = [&](double share) {
      return last_move_.mean < share * goal.mean && last_move_.std < share * goal.std;
    };
    settled_ = within(1);
    settled = within(0.5) ? settled + 1 : 0;
    const bool convinced = settled > 1 && covers(result.update) && !doubts_model(result.update.verdict);
    if (thorough ? convinced : settled_) break;
  }
  if (version_ != version) whole_move_ = move_between(first, result.update);
  return version_ != version;
}

void tell_what_was_asked(assimilation::Verdict& verdict, std::size_t runs, const std::string& trouble) {
  using assimilation::VerdictPart;
  for (assimilation::VerdictReason& reason : verdict.reasons) {
    const auto advice = reason.message.find(": set method.verify");
    if (runs == 0 || reason.part != VerdictPart::model || advice == std::string::npos) continue;
    reason.message = fmt::format(
        "{}, and {} at the posterior (method.verify) did not settle it: raise method.verify_runs, or "
        "make a finer model (more nodes and modes under [offline])",
        reason.message.substr(0, advice), counted(runs, "run"));
  }
  if (!trouble.empty())
    verdict.add({VerdictPart::model, assimilation::VerdictLevel::caution, 0, 0, trouble, {}});
}

std::string not_verified(const std::string& why) {
  return "the full-order model could not be used, so the error of the reduced model is not verified: " + why;
}

bool doubts_model(const assimilation::Verdict& verdict) {
  return std::any_of(verdict.reasons.begin(), verdict.reasons.end(),
                     [](const auto& reason) { return reason.part == assimilation::VerdictPart::model; });
}

bool Refinement::refine_if_needed(std::unique_ptr<assimilation::Engine>& engine,
                                  assimilation::StepResult& result, bool is_last) {
  const std::size_t all = project_.method.verify_runs;
  const bool doubted = doubts_model(result.update.verdict);
  const std::size_t version = version_;
  try {
    if (trouble_.empty() && (is_last || doubted)) refine(engine, result, is_last ? all : all / 2, is_last);
  } catch (const Error& error) {  // whatever it is, the answer without it is kept
    trouble_ = not_verified(error.what());
  }
  if (is_last && trouble_.empty() && !settled_)
    trouble_ = fmt::format(
        "{} at the posterior did not settle it: the last refinement moved a mean by {:.2g} "
        "standard deviations and a standard deviation by {:.2g} %; {}make a finer model (more nodes under "
        "[offline])",
        counted(runs(), "full-order run"), last_move_.mean, 100 * last_move_.std,
        runs() < all ? "" : "raise method.verify_runs, or ");
  tell_what_was_asked(result.update.verdict, runs(), is_last ? trouble_ : std::string());
  return version_ != version;
}

}  // namespace knothe::project
