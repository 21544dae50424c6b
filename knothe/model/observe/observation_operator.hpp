#pragma once
/// @file Where observations are in a model: rows of weights on the dofs.
#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/model/compress/snapshots.hpp"

namespace knothe::model {

/// The observation operator O of y = O u, one sparse row per observation.
class ObservationOperator {
 public:
  struct Entry {
    std::size_t dof;
    double weight;
  };

  /// Places against the dofs of `where` (docs/reference/formats.md): see `observe`.
  ObservationOperator(const Dofs& dofs, const std::optional<Mesh>& mesh, const std::string& where,
                      const Dofs& places);
  /// Rows of the identity.
  explicit ObservationOperator(std::span<const std::size_t> dofs);

  [[nodiscard]] Index rows() const { return std::ssize(rows_); }
  [[nodiscard]] std::span<const Entry> row(std::size_t i) const { return rows_[i]; }
  /// O · `fields`, where `fields` is n_dof × any.
  [[nodiscard]] Eigen::MatrixXd apply(const Eigen::Ref<const Eigen::MatrixXd>& fields) const;

 private:
  std::vector<std::vector<Entry>> rows_;
};

/// Which of `points` [n, 3] lie in a cell of the mesh; all, where there is no interpolation on its cells.
[[nodiscard]] std::vector<bool> are_inside(const Mesh& mesh, std::span<const double> points);

}  // namespace knothe::model
