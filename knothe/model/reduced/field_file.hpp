#pragma once
/// @file Displacement fields of a model on its mesh, for ParaView.
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "knothe/files/vtu.hpp"
#include "knothe/model/reduced/model_file.hpp"

namespace knothe::model {

/// Scatters dof values to the points of the model's mesh. Made once, used for every field. `contents` must
/// outlive it.
class FieldOnMesh {
 public:
  /// Errors: DataError, prefixed by `where`, for a model without a mesh, or with a dof that is at none of its
  /// points.
  FieldOnMesh(const ModelContents& contents, const std::string& where);

  /// A vector field from dof values [n_dof]; components without a dof are 0.
  [[nodiscard]] files::VtuField vectors(const std::string& name, std::span<const double> values) const;
  /// Writes the mesh with these fields (.vtu), atomically. IoError.
  /// `time` is shown by ParaView as the file's time.
  void write(std::vector<files::VtuField> fields, const std::string& path,
             std::optional<double> time = {}) const;

 private:
  const ModelContents& contents_;
  std::vector<std::size_t> position_;  ///< of each dof in the [n, 3] array of a vector field
};

}  // namespace knothe::model
