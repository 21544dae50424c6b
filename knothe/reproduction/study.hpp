#pragma once
/// @file The published study (Rubio, Chamoin, Louf 2019, §6), figure by figure, beside its published values.
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "knothe/reproduction/beam_case.hpp"
#include "knothe/reproduction/experiment.hpp"
#include "knothe/reproduction/figure_record.hpp"

namespace knothe::reproduction {

struct StudyOptions {
  bool quick = false;         ///< fewer other choices and fewer repetitions; the figures are the same
  std::string models_folder;  ///< where built models are kept, and looked for
  std::uint64_t seed = 1;     ///< of nodes, noise, speckle and verification points
  int processes = 2;          ///< full-order runs at the same time
  int repetitions = 40;       ///< of the experiment with other nodes and noise
  BeamCase reference = reference_case();
  BeamCase soft = soft_coarse_case();
  std::vector<BeamCase> others = other_cases();

  /// What --quick leaves.
  [[nodiscard]] static StudyOptions quickly();
};

struct Study {
  std::vector<FigureRecord> figures;
  double elapsed_s = 0;
};

/// Computes all figures, in the order of the paper, then what the paper leaves open. `on_figure` is called
/// with each as it is done. Errors: as run_snapshots; Interrupted, the models that were built being kept.
[[nodiscard]] Study run_study(const StudyOptions& options,
                              const std::function<void(const FigureRecord&)>& on_figure = {});

/// One case, observed as in §6.3.1: data of its own m = 6 at the reference parameters.
struct Subject {
  BeamModels models;
  Eigen::VectorXd truth;  ///< (1, 1)
  Sensors sensors;        ///< 30 random nodes, 60 dofs
  assimilation::Measurements data;
};
[[nodiscard]] Subject subject_of(BeamModels models, std::uint64_t seed);

// The figures. `soft` is the case that comes near the paper's numbers.
[[nodiscard]] FigureRecord figure_5(const BeamCase& chosen);
[[nodiscard]] FigureRecord figures_6_7(const Subject& subject);
[[nodiscard]] FigureRecord figures_8_9(const Subject& subject, const Subject& soft,
                                       const StudyOptions& options);
[[nodiscard]] FigureRecord figures_10_12(const Subject& subject);
[[nodiscard]] FigureRecord figure_13(const Subject& subject, const Subject& soft,
                                     const StudyOptions& options);
[[nodiscard]] FigureRecord figures_14_15(const Subject& subject, const StudyOptions& options);
/// Beyond the paper: a bias that begins at some step, and what each correction makes of it.
[[nodiscard]] FigureRecord bias_onset(const Subject& subject, const StudyOptions& options);
[[nodiscard]] FigureRecord figures_16_17(const Subject& subject, const StudyOptions& options);
[[nodiscard]] FigureRecord figure_18(const Subject& subject, const StudyOptions& options);
/// Beyond the paper: data of the beam itself, at parameters on the grid and off it, assimilated with the
/// uncompressed snapshots and with several models of six modes.
[[nodiscard]] FigureRecord decompositions(const Subject& subject, const StudyOptions& options);
/// What the paper leaves open of supports and loading: a spring in series in place of a share of the
/// displacement, and loading that ends near the peak.
[[nodiscard]] FigureRecord supports_and_loading(const Subject& subject, const Subject& soft,
                                                const StudyOptions& options);
/// Every conclusion again under other choices of what the paper leaves open.
[[nodiscard]] FigureRecord other_choices(const Subject& subject, const Subject& soft,
                                         const StudyOptions& options);

}  // namespace knothe::reproduction
