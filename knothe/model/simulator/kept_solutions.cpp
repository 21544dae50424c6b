#include "knothe/model/simulator/kept_solutions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "knothe/base/text.hpp"

namespace knothe::model {

std::string solution_file(const std::string& folder, const std::string& key) {
  return (std::filesystem::path(folder) / fmt::format("solution-{:016x}.h5", fnv1a(key))).string();
}

std::vector<Snapshots> kept_solutions(const Simulator& simulator, const std::string& folder) {
  std::vector<std::filesystem::path> files;
  std::error_code absent;
  for (const auto& entry : std::filesystem::directory_iterator(folder, absent))
    if (entry.path().extension() == ".h5" && entry.path().filename().string().starts_with("solution-"))
      files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<Snapshots> solutions;
  for (const auto& file : files) {
    try {
      Snapshots solution = read_solution(file);
      if (file == solution_file(folder, simulator.key(solution.parameters_at(0))))
        solutions.push_back(std::move(solution));
    } catch (const DataError&) {
    }
  }
  return solutions;
}

}  // namespace knothe::model
