#pragma once
/// @file Maps without coefficients, by order, with all that is tabulated for them. Private to the room.
#include <Eigen/Core>
#include <map>
#include <memory>
#include <tuple>
#include <utility>
#include <vector>

#include "knothe/base/index.hpp"
#include "knothe/posterior/map/solve/kl_objective.hpp"
#include "knothe/posterior/map/solve/map_solver.hpp"

namespace knothe::posterior {

/// Independent points with their tables for maps of one shape. Tables are never enlarged in place: a result
/// must not depend, not even in its last bit, on what was solved before.
struct VerificationTables {
  Eigen::MatrixXd reference;  ///< the points
  PointTables points;         ///< square only: a map with another rectifier is evaluated by its own code
  Eigen::VectorXd log_reference;
};

/// Spread of the defensive half of the points of an importance correction.
inline constexpr double k_broad = 1.5;

/// A map without coefficients, with all that is tabulated for it.
struct MapShape {
  TriangularMap identity;
  MapLayout layout;
  std::unique_ptr<TrainingTables> training;
  std::map<std::pair<Index, bool>, std::unique_ptr<VerificationTables>> verification;  ///< (n, is_broad)

  explicit MapShape(MapSpecification specification) : identity(std::move(specification)), layout(identity) {}
};

/// What a solver has made so far; a shape stays where it is.
class MapShapes {
 public:
  explicit MapShapes(const MapSolverOptions& options) : options_(options) {}

  /// Errors: UsageError where the options' family gives a map in other dimensions.
  MapShape& of_order(Index d, int order, const Parametrisation& parametrisation);
  /// A map of that order whose first variable has a far higher one.
  MapShape& long_of_order(Index d, int order);
  /// The shape of a map: one of those here, or made for it.
  MapShape& of(const TriangularMap& map);

  const TrainingTables& training_tables(MapShape& shape);
  /// `is_broad`: half of the points are spread by k_broad, and log_reference is that of the mixture ½ N(0, I)
  /// + ½ N(0, k_broad² I).
  const VerificationTables& verification_tables(MapShape& shape, Index n, bool is_broad = false);
  /// Makes the tables of a shape; `with_broad`: those of the importance correction's further points too.
  void prepare(MapShape& shape, bool with_broad);

 private:
  using Key = std::tuple<Index, int, Parametrisation>;  ///< d, order, parametrisation
  struct Less {
    bool operator()(const Key& a, const Key& b) const;
  };
  const MapSolverOptions& options_;
  std::map<Key, std::unique_ptr<MapShape>, Less> shapes_;
  std::map<std::pair<Index, int>, std::unique_ptr<MapShape>> long_shapes_;  ///< d, order of the others
  std::unique_ptr<MapShape> foreign_;  ///< of a map that this solver did not make
};

}  // namespace knothe::posterior
