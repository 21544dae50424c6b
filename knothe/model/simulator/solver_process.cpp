#include "knothe/model/simulator/solver_process.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <mutex>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/program.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/model/simulator/kept_solutions.hpp"

namespace knothe::model {
namespace {

/// NAME=V,… with every digit.
std::string point_argument(std::span<const std::string> names, std::span<const double> parameters) {
  std::string text;
  for (Index i = 0; i < std::ssize(names); ++i)
    text += fmt::format("{}{}={}", i == 0 ? "" : ",", names[i], parameters[i]);
  return text;
}

std::string make_folder() {
  std::string name = (std::filesystem::temp_directory_path() / "knothe-solve-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw system_error("cannot make a folder for solutions", name);
  return name;
}

}  // namespace

SolverProcess::SolverProcess(SolverProcessOptions options)
    : options_(std::move(options)), folder_(make_folder()) {
  if (!options_.keep.empty()) std::filesystem::create_directories(options_.keep);
}

SolverProcess::~SolverProcess() {
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

std::string SolverProcess::key(std::span<const double> parameters) const {
  return options_.identity + " | " + point_argument(options_.names, parameters);
}

Snapshots SolverProcess::solve(std::span<const double> parameters, const std::string& file) const {
  const std::string kept =
      options_.keep.empty() ? std::string() : solution_file(options_.keep, key(parameters));
  if (!kept.empty() && std::filesystem::exists(kept)) try {
      return read(parameters, kept);
    } catch (const DataError&) {  // damaged: it is made again
    }
  run(parameters, file);
  Snapshots solution = read(parameters, file);
  std::filesystem::remove(file);
  if (!kept.empty()) write_snapshots(solution, kept);
  return solution;
}

void SolverProcess::run(std::span<const double> parameters, const std::string& file) const {
  ProgramCall call{options_.words, {}, file + ".log", options_.time_limit_s, options_.stop};
  call.words.insert(call.words.end(), {"--at", point_argument(options_.names, parameters), "-o", file});
  const ProgramEnd end = run_program(call);
  if (end.status == 0) return;
  const std::string said = last_lines(call.log);
  throw NumericalError(fmt::format(
      "the full-order model at {} {}{}{}", describe(options_.names, parameters),
      end.timed_out
          ? fmt::format("was not solved within {:g} s", options_.time_limit_s)
          : fmt::format("was not solved ({} ended with status {})", options_.words.front(), end.status),
      said.empty() ? "" : ": ", said));
}

Snapshots SolverProcess::read(std::span<const double> parameters, const std::string& file) const {
  Snapshots solution = read_solution(file);
  if (solution.grid_size() != 1 || solution.axes.size() != parameters.size())
    throw DataError(fmt::format(
        "the full-order model at {}: its file holds a grid of {} points of {} parameters, "
        "not one solution of {}",
        describe(options_.names, parameters), solution.grid_size(), solution.axes.size(), parameters.size()));
  // The file's parameters may stand in another order; of one point that is the axes' alone.
  std::vector<Axis> axes;
  for (const std::string& name : options_.names) {
    const auto found = std::find_if(solution.axes.begin(), solution.axes.end(),
                                    [&](const Axis& axis) { return axis.name == name; });
    if (found == solution.axes.end())
      throw DataError(fmt::format("the full-order model at {}: its file does not say what {} is",
                                  describe(options_.names, parameters), name));
    axes.push_back(*found);
  }
  solution.axes = std::move(axes);
  return solution;
}

Snapshots SolverProcess::solve(std::span<const double> parameters) {
  return solve(parameters, folder_ + "/solution.h5");
}

std::vector<Snapshots> SolverProcess::solve_all(std::span<const std::vector<double>> points,
                                                const std::function<void(std::size_t)>& finished) {
  std::vector<Snapshots> solutions(points.size());
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(points.size(), options_.processes, [&](std::size_t i) {
    solutions[i] = solve(points[i], fmt::format("{}/solution-{}.h5", folder_, i));
    if (!finished) return;
    const std::lock_guard lock(mutex);
    finished(++done);
  });
  return solutions;
}

}  // namespace knothe::model
