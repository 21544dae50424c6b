#pragma once
/// @file Full-order solutions that are kept in a folder, so that none is made twice.
#include "knothe/model/simulator/simulator.hpp"

namespace knothe::model {

/// The file of the solution that has this key (Simulator::key).
[[nodiscard]] std::string solution_file(const std::string& folder, const std::string& key);

/// The solutions in a folder that this simulator would give, in the order of the files' names: those of
/// another mesh or loading have other keys. Files that cannot be read are passed over. None where there is no
/// such folder.
[[nodiscard]] std::vector<Snapshots> kept_solutions(const Simulator& simulator, const std::string& folder);

}  // namespace knothe::model
