#pragma once
/// @file What adaptive importance sampling draws from: mixtures of Student's t fitted to weighted points.
#include <Eigen/Core>
#include <vector>

#include "knothe/posterior/draws/mixture_product.hpp"

namespace knothe::posterior {

/// Points that stand for a density.
struct WeightedPoints {
  Eigen::MatrixXd points;   ///< n × d
  Eigen::VectorXd weights;  ///< n, sum 1
};

/// Coordinates that depend on each other (`dependent_groups`).
using Groups = std::vector<std::vector<Eigen::Index>>;

/// For each group of coordinates that depend on each other a mixture, with heavy tails, a share of the
/// flattened target's (it reaches the ends of ridges, which a fit to the target thins out), and a little of
/// N(0, I): something everywhere (defensive sampling, Hesterberg 1995).
class ImportanceProposal {
 public:
  /// Of the draws of each group: from the flattened target, and from N(0, I).
  struct Shares {
    double flat, reference = 0.02;
  };
  /// `tails`: degrees of freedom, even.
  ImportanceProposal(double tails, Shares shares) : tails_(tails), shares_(shares) {}

  /// Fits to `target`, from the last fit on. The flattened target is fitted where the groups are others.
  void fit(Groups groups, const WeightedPoints& target, const WeightedPoints& flattened);

  [[nodiscard]] std::size_t components() const;  ///< of the target's mixtures
  [[nodiscard]] MixtureProduct mixtures(SupportEnds ends = {}) const;

 private:
  double tails_;
  Shares shares_;
  Groups groups_;
  std::vector<std::vector<MixtureComponent>> target_, flattened_;
};

}  // namespace knothe::posterior
