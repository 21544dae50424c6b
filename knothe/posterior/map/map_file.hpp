#pragma once
/// @file Composed maps on disk: HDF5, self-describing, bit-identical when read back.
///
/// Root attributes: schema_version, created_by, kind = "transport map", dimension, parts (their number, in
/// the order of ComposedMap), and metadata texts as attributes of /metadata. Part i is the group /parts/i
/// with an attribute kind:
///   "affine":      shift [d], lower [d, d], rotation [d, d] (absent if there is none)
///   "triangular":  attributes rectifier, basis, tails; radii [3] (level, bend, tangent); coefficients [N];
///                  terms [N, 2]: component and set (0: Φ_c, 1: Φ_e) of each coefficient;
///                  factors [F, 3]: coefficient, variable, degree (absent if there are none)
#include <map>
#include <string>

#include "knothe/posterior/map/composed_map.hpp"

namespace knothe::posterior {

/// Texts that travel with a map: what it was made for, by which command, with which result.
using MapMetadata = std::map<std::string, std::string>;

struct StoredMap {
  ComposedMap map;
  MapMetadata metadata;
  std::string created_by;
};

/// Writes the file whole or not at all. Errors: UsageError for an empty name in `metadata`; IoError.
void save_map(const std::string& path, const ComposedMap& map, const MapMetadata& metadata = {});

/// Errors: DataError, naming file and data set, for a file that is missing, damaged, of another kind or of a
/// newer schema, for sizes and indices that do not fit together, and for numbers that are not finite.
[[nodiscard]] StoredMap load_map(const std::string& path);

}  // namespace knothe::posterior
