#include "knothe/mechanics/latin/latin_state.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/hdf5.hpp"

namespace knothe::mechanics {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

/// Sizes apart from values: a matrix may be empty.
void write_matrix(files::Hdf5Writer& file, const std::string& name, const MatrixXd& matrix) {
  const std::vector<std::int64_t> sizes = {matrix.rows(), matrix.cols()};
  file.write_integers(name + "/size", sizes, {2}, {"1", "rows, columns"});
  if (matrix.size() == 0) return;
  file.write(name + "/values", std::span(matrix.data(), static_cast<std::size_t>(matrix.size())),
             {static_cast<std::size_t>(matrix.cols()), static_cast<std::size_t>(matrix.rows())},
             {"1", "by columns"});
}

MatrixXd read_matrix(const files::Hdf5Reader& file, const std::string& name) {
  const std::vector<std::int64_t> sizes = file.read_integers(name + "/size");
  if (sizes.size() != 2 || sizes[0] < 0 || sizes[1] < 0) throw DataError(name + ": not a matrix");
  MatrixXd matrix(sizes[0], sizes[1]);
  if (matrix.size() == 0) return matrix;
  const std::vector<double> values =
      file.read(name + "/values", {static_cast<std::size_t>(sizes[1]), static_cast<std::size_t>(sizes[0])});
  std::copy(values.begin(), values.end(), matrix.data());
  return matrix;
}

/// Numbers of a global stage, in the order of LatinIteration.
MatrixXd history_matrix(const std::vector<LatinIteration>& history) {
  MatrixXd result(10, static_cast<Index>(history.size()));
  for (std::size_t k = 0; k < history.size(); ++k) {
    const LatinIteration& it = history[k];
    result.col(k) << it.first_step, it.last_step, it.round, it.working_modes, it.archived_modes, it.lanes,
        it.residual, it.correction, it.indicator, it.cpu_seconds;
  }
  return result;
}

std::vector<LatinIteration> history_from(const MatrixXd& matrix) {
  std::vector<LatinIteration> history;
  for (Index k = 0; k < matrix.cols(); ++k) {
    const auto c = matrix.col(k);
    const auto whole = [&](Index i) { return static_cast<int>(c[i]); };
    history.push_back({whole(0), whole(1), whole(2), whole(3), whole(4), whole(5), c[6], c[7], c[8], c[9]});
  }
  return history;
}

/// Numbers of a global stage, in the order of SeparatedIteration.
MatrixXd history_matrix(const std::vector<SeparatedIteration>& history) {
  MatrixXd result(10, static_cast<Index>(history.size()));
  for (std::size_t k = 0; k < history.size(); ++k) {
    const SeparatedIteration& it = history[k];
    result.col(k) << it.steps, it.round, it.terms, it.space_modes, it.energy_error, it.residual,
        it.correction, it.indicator, it.relaxation, it.cpu_seconds;
  }
  return result;
}

void write_modes(files::Hdf5Writer& file, const LatinBasis::Modes& modes) {
  write_matrix(file, "/modes/displacements", modes.displacements);
  write_matrix(file, "/modes/forces", modes.forces);
  write_matrix(file, "/modes/directions", modes.directions);
}

LatinBasis::Modes read_modes(const files::Hdf5Reader& file) {
  return {read_matrix(file, "/modes/displacements"), read_matrix(file, "/modes/forces"),
          read_matrix(file, "/modes/directions")};
}

void write_cells(files::Hdf5Writer& file, const std::vector<std::int64_t>& cells) {
  if (!cells.empty()) file.write_integers("/cells", cells, {cells.size()}, {"1", "active cells"});
}

}  // namespace

void write_latin_state(const LatinState& state, const std::string& key, const std::string& path) {
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    const LatinSolution& solution = state.solution;
    write_modes(file, state.modes);
    write_matrix(file, "/history", state.history);
    write_matrix(file, "/expanded", state.expanded);
    write_matrix(file, "/residual", solution.residual);
    write_matrix(file, "/reaction", solution.reaction);
    write_matrix(file, "/accepted", solution.accepted.cast<double>());
    write_matrix(file, "/stages", history_matrix(solution.history));
    for (std::size_t step = 0; step < solution.coordinates.size(); ++step)
      write_matrix(file, fmt::format("/coordinates/{}", step), solution.coordinates[step]);
    write_cells(file, state.cells);
    file.text_attribute("/", "key", key);
    file.integer_attribute("/", "next_step", state.next_step);
    file.integer_attribute("/", "steps", static_cast<std::int64_t>(solution.coordinates.size()));
    file.number_attribute("/", "local_points", static_cast<double>(solution.local_points));
    file.number_attribute("/", "cpu_seconds", solution.cpu_seconds);
    file.close();
  });
}

std::optional<LatinState> read_latin_state(const std::string& key, const std::string& path) {
  if (!std::filesystem::exists(path)) return std::nullopt;
  try {
    const files::Hdf5Reader file(path);
    if (file.text_attribute("/", "key") != key) return std::nullopt;
    LatinState state;
    LatinSolution& solution = state.solution;
    state.next_step = static_cast<int>(file.number_attribute("/", "next_step"));
    state.modes = read_modes(file);
    state.history = read_matrix(file, "/history");
    state.expanded = read_matrix(file, "/expanded");
    solution.residual = read_matrix(file, "/residual");
    solution.reaction = read_matrix(file, "/reaction");
    solution.accepted = read_matrix(file, "/accepted").cast<int>();
    solution.history = history_from(read_matrix(file, "/stages"));
    const int steps = static_cast<int>(file.number_attribute("/", "steps"));
    for (int step = 0; step < steps; ++step)
      solution.coordinates.push_back(read_matrix(file, fmt::format("/coordinates/{}", step)));
    if (file.has("/cells")) state.cells = file.read_integers("/cells");
    solution.local_points = static_cast<long>(file.number_attribute("/", "local_points"));
    solution.cpu_seconds = file.number_attribute("/", "cpu_seconds");
    return state;
  } catch (const DataError&) {
    return std::nullopt;  // computed again and replaced
  }
}

void write_separated_state(const SeparatedState& state, const std::string& key, const std::string& path) {
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    write_modes(file, state.modes);
    write_matrix(file, "/terms/space", state.terms.space);
    write_matrix(file, "/terms/time", state.terms.time);
    for (std::size_t axis = 0; axis < state.terms.parameters.size(); ++axis)
      write_matrix(file, fmt::format("/terms/parameters/{}", axis), state.terms.parameters[axis]);
    write_matrix(file, "/stages", history_matrix(state.history));
    write_cells(file, state.cells);
    file.text_attribute("/", "key", key);
    file.integer_attribute("/", "axes", static_cast<std::int64_t>(state.terms.parameters.size()));
    file.number_attribute("/", "relaxation", state.relaxation);
    file.number_attribute("/", "indicator", state.indicator);
    file.number_attribute("/", "local_points", static_cast<double>(state.local_points));
    file.number_attribute("/", "cpu_seconds", state.cpu_seconds);
    file.close();
  });
}

std::optional<SeparatedState> read_separated_state(const std::string& key, const std::string& path) {
  if (!std::filesystem::exists(path)) return std::nullopt;
  try {
    const files::Hdf5Reader file(path);
    if (file.text_attribute("/", "key") != key) return std::nullopt;
    SeparatedState state;
    state.modes = read_modes(file);
    state.terms.space = read_matrix(file, "/terms/space");
    state.terms.time = read_matrix(file, "/terms/time");
    const int axes = static_cast<int>(file.number_attribute("/", "axes"));
    for (int axis = 0; axis < axes; ++axis)
      state.terms.parameters.push_back(read_matrix(file, fmt::format("/terms/parameters/{}", axis)));
    const MatrixXd stages = read_matrix(file, "/stages");
    for (Index k = 0; k < stages.cols(); ++k) {
      const auto c = stages.col(k);
      const auto whole = [&](Index i) { return static_cast<int>(c[i]); };
      state.history.push_back({whole(0), whole(1), whole(2), whole(3), c[4], c[5], c[6], c[7], c[8], c[9]});
    }
    if (file.has("/cells")) state.cells = file.read_integers("/cells");
    state.relaxation = file.number_attribute("/", "relaxation");
    state.indicator = file.number_attribute("/", "indicator");
    state.local_points = static_cast<long>(file.number_attribute("/", "local_points"));
    state.cpu_seconds = file.number_attribute("/", "cpu_seconds");
    return state;
  } catch (const DataError&) {
    return std::nullopt;  // computed again and replaced
  }
}

}  // namespace knothe::mechanics
