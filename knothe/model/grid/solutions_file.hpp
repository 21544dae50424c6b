#pragma once
/// @file Files of snapshots that do not fit in memory: read block by block into coordinates in space.
#include <cstddef>
#include <string>

#include "knothe/model/grid/grid_solutions.hpp"

namespace knothe::model {

struct SolutionsReading {
  std::size_t whole_bytes = std::size_t{2} << 30;  ///< a field up to this size (as doubles) is kept as it is
  std::size_t block_bytes = std::size_t{64}
                            << 20;  ///< what is read of a larger one at a time (a point at least)
  std::size_t threads = 0;          ///< 0: all
};

/// The solutions of a file of snapshots. A larger field is held in an orthonormal basis of space, grown while
/// the file is read once, that leaves out at most 3e-7 of the norm of any block. DataError as in
/// `read_snapshots`, and if even the coordinates would take more than half of the machine's memory.
[[nodiscard]] GridSolutions read_solutions(const std::string& path, const SolutionsReading& reading = {});

}  // namespace knothe::model
