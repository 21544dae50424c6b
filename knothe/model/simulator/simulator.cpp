#include "knothe/model/simulator/simulator.hpp"

#include <fmt/format.h>

#include <utility>

#include "knothe/base/index.hpp"
#include "knothe/model/simulator/run_file.hpp"

namespace knothe::model {

std::vector<Snapshots> Simulator::solve_all(std::span<const std::vector<double>> points,
                                            const std::function<void(std::size_t)>& finished) {
  std::vector<Snapshots> solutions;
  for (const std::vector<double>& point : points) {
    solutions.push_back(solve(point));
    if (finished) finished(solutions.size());
  }
  return solutions;
}

void Simulator::check(std::span<const double> /*parameters*/) const {}

std::optional<Snapshots> Simulator::frame() const {
  return std::nullopt;
}

std::vector<RunFailure> Simulator::solve_to_files(std::span<const Run> runs, int /*processes*/,
                                                  const std::function<void(std::size_t)>& finished) {
  std::vector<RunFailure> failures;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    try {
      write_run(runs[i], solve(runs[i].parameters), {});
      finished(i + 1 - failures.size());
    } catch (const NumericalError& error) {
      failures.push_back({i, error.status(), error.what()});
    } catch (const DataError& error) {  // a solution that cannot be read, or a server that refuses
      failures.push_back({i, error.status(), error.what()});
    }
  }
  return failures;
}

std::vector<OffGridSolution> fields_of(std::vector<Snapshots> solutions) {
  std::vector<OffGridSolution> fields;
  for (Snapshots& solution : solutions)
    fields.push_back({solution.parameters_at(0), std::move(solution.values), std::move(solution.outputs)});
  return fields;
}

std::string describe(std::span<const std::string> names, std::span<const double> parameters) {
  std::string text;
  for (Index i = 0; i < std::ssize(names); ++i)
    text += fmt::format("{}{} = {:.6g}", i == 0 ? "" : ", ", names[i], parameters[i]);
  return text;
}

}  // namespace knothe::model
