#pragma once
/// @file A later picture as the reference, once the first no longer explains what is seen: its pattern has
/// changed, or moved too far. Private to the room.
#include <memory>
#include <vector>

#include "knothe/imaging/correlation/image_correlation.hpp"

namespace knothe::imaging {

/// The mesh moves with the surface: its nodes are where the new reference picture shows them, so that natural
/// coordinates, hence material points, stay what they are, and displacements of a node add up exactly.
/// Results are of the first mesh: displacements since the first reference, elements by its numbers.
class MovedReference {
 public:
  /// `base`: what was measured in `picture`, which becomes the reference; `base_std` (px, one per dof) how
  /// exactly. Elements that were not valid there, or have left the picture, stay out. Errors: UsageError
  /// where nothing is left.
  MovedReference(const files::Picture& picture, const ImageMesh& mesh, const CorrelationResult& base,
                 Eigen::VectorXd base_std, const CorrelationOptions& options);

  /// `start`: displacement since the first reference, or empty.
  [[nodiscard]] CorrelationResult correlate(const files::Picture& deformed, const Eigen::VectorXd& start);
  /// γ from the residual of the last result.
  [[nodiscard]] double noise() const;
  /// Precision (1/px²) of what was measured since this reference, of noise γ, in the dofs of the first mesh;
  /// `std` of that, and of everything since the first reference: errors of the pictures before are taken as
  /// independent, though they share this picture's noise, with opposite signs: on the safe side.
  struct Noise {
    Eigen::SparseMatrix<double> increment;
    Eigen::VectorXd increment_std, std;
  };
  [[nodiscard]] Noise noise_of_last(double gamma) const;
  [[nodiscard]] const Eigen::VectorXd& base_std() const { return base_std_; }
  [[nodiscard]] double contrast() const { return correlation_->contrast(); }

 private:
  Eigen::VectorXd base_, base_unregularised_, base_std_;
  std::size_t elements_;             ///< of the first mesh
  std::vector<int> node_, element_;  ///< numbers in the first mesh
  std::unique_ptr<ImageCorrelation> correlation_;
  CorrelationResult last_;  ///< of the moved mesh, since this reference
};

}  // namespace knothe::imaging
