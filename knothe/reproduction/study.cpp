#include "knothe/reproduction/study.hpp"

#include <chrono>

#include "knothe/base/cancellation.hpp"

namespace knothe::reproduction {

StudyOptions StudyOptions::quickly() {
  StudyOptions options;
  options.quick = true;
  options.repetitions = 10;
  options.others.resize(1);
  return options;
}

Subject subject_of(BeamModels models, std::uint64_t seed) {
  Subject subject{std::move(models), Eigen::VectorXd::Ones(2), {}, {}};
  subject.sensors = random_nodes(subject.models.paper, seed);
  const auto seen = observed(subject.models.paper, subject.sensors);
  subject.data = measure(predicted(*seen, subject.truth), subject.sensors, seen->time, seed);
  return subject;
}

Study run_study(const StudyOptions& options, const std::function<void(const FigureRecord&)>& on_figure) {
  const auto start = std::chrono::steady_clock::now();
  Study study;
  const auto add = [&](FigureRecord record) {
    check_cancellation("the models that were built are kept: the same command goes on from there");
    study.figures.push_back(std::move(record));
    if (on_figure) on_figure(study.figures.back());
  };
  add(figure_5(options.reference));
  const Subject subject =
      subject_of(prepare(options.reference, options.models_folder, options.processes), options.seed);
  const Subject soft =
      subject_of(prepare(options.soft, options.models_folder, options.processes), options.seed);
  add(figures_6_7(subject));
  add(figures_8_9(subject, soft, options));
  add(figures_10_12(subject));
  add(figure_13(subject, soft, options));
  add(figures_14_15(subject, options));
  add(bias_onset(subject, options));
  add(figures_16_17(subject, options));
  add(figure_18(subject, options));
  add(decompositions(subject, options));
  add(supports_and_loading(subject, soft, options));
  add(other_choices(subject, soft, options));
  study.elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return study;
}

}  // namespace knothe::reproduction
