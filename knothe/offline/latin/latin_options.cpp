#include <fmt/format.h>

#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/offline/latin/latin_pgd.hpp"

namespace knothe::offline {

using Eigen::VectorXd;

void LatinOptions::validate() const {
  const auto refuse = [](const std::string& why) { throw ProjectError("LATIN-PGD: " + why); };
  if (!(accuracy > 0) || !std::isfinite(accuracy))
    refuse(fmt::format("accuracy is {} m; it must be positive", accuracy));
  if (!(tolerance >= 0 && tolerance < 1))
    refuse(fmt::format("tolerance is {}; it must be at least 0 and below 1", tolerance));
  if (window < 1) refuse(fmt::format("window is {} steps; it must be at least 1", window));
  if (max_modes < 1 || modes_per_round < 1 || rounds < 1)
    refuse(fmt::format("max_modes, modes_per_round and rounds are {}, {} and {}; they must be at least 1",
                       max_modes, modes_per_round, rounds));
  if (!(recompression >= 0 && recompression <= 1))
    refuse(fmt::format("recompression is {}; it must be from 0 to 1", recompression));
  if (!(activation > 0 && activation < 1))
    refuse(fmt::format("activation is {}; it must be between 0 and 1", activation));
}

VectorXd LatinSolution::displacement(const Structure& structure, std::size_t step, Index point) const {
  const auto c = coordinates[step].col(point);
  return c[0] * Eigen::Map<const VectorXd>(structure.unit_lift().data(), structure.dof_count()) +
         space * c.tail(space.cols());
}

}  // namespace knothe::offline
