#include "knothe/reproduction/bias.hpp"

#include <algorithm>

#include "knothe/assimilation/bias/model_bias.hpp"

namespace knothe::reproduction {

assimilation::UpdateOptions corrected_options(assimilation::BiasCorrectionMode mode,
                                              assimilation::BiasOptions::Way way, std::uint64_t seed) {
  assimilation::UpdateOptions options = default_options(seed);
  options.bias_correction = mode;
  options.bias.way = way;
  return options;
}

BiasRuns bias_runs(const reduction::SeparatedModel& paper, const reduction::SeparatedModel& few,
                   const Sensors& sensors, const assimilation::Measurements& data, std::uint64_t seed,
                   bool marginals, bool with_joint) {
  using assimilation::BiasCorrectionMode;
  using Way = assimilation::BiasOptions::Way;
  const auto model = observed(few, sensors);
  RunOptions options;
  options.update = default_options(seed);
  options.marginals = marginals;
  BiasRuns runs;
  options.label = marginals ? "m = 6" : "";
  runs.reference = assimilate(observed(paper, sensors), data, options);
  options.label = marginals ? "m = 3" : "";
  runs.biased = assimilate(model, data, options);
  const auto corrected = [&](Way way, const char* label) {
    options.update = corrected_options(BiasCorrectionMode::on, way, seed);
    options.label = marginals ? label : "";
    return assimilate(model, data, options);
  };
  runs.published = corrected(Way::published, "m = 3, corrected as published");
  runs.corrected = corrected(Way::modes, "m = 3, corrected");
  if (with_joint) runs.joint = corrected(Way::joint, "m = 3, joint correction");
  return runs;
}

assimilation::Measurements less_true_residual(const reduction::ObservedModel& model,
                                              const Eigen::VectorXd& truth, const Eigen::MatrixXd& exact,
                                              assimilation::Measurements data) {
  assimilation::BiasOptions options;
  options.way = assimilation::BiasOptions::Way::published;
  assimilation::ModelBias bias(data.noise.standard_deviations(), options);
  const Eigen::MatrixXd residual = exact - predicted(model, truth);
  for (Eigen::Index t = 0; t < exact.cols(); ++t) {
    const double time = model.time[static_cast<std::size_t>(t)];
    if (const auto correction = bias.extrapolate(time)) data.values.col(t) -= correction->mean;
    bias.add(time, residual.col(t), Eigen::VectorXd::Zero(exact.rows()));
  }
  return data;
}

std::vector<double> evidence_increments(const Run& run) {
  std::vector<double> values;
  for (const assimilation::UpdateResult& r : run.steps) values.push_back(r.log_evidence_increment);
  return values;
}

std::vector<double> smoothed(const std::vector<double>& values, std::size_t width) {
  std::vector<double> result;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t from = i >= width / 2 ? i - width / 2 : 0,
                      to = std::min(values.size(), i + (width + 1) / 2);
    double sum = 0;
    for (std::size_t j = from; j < to; ++j) sum += values[j];
    result.push_back(sum / static_cast<double>(to - from));
  }
  return result;
}

}  // namespace knothe::reproduction
