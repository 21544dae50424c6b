#include "knothe/offline/latin/latin_state.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <tuple>
#include <type_traits>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/hdf5.hpp"

namespace knothe::offline {
namespace {

using Eigen::MatrixXd;

/// Numbers of a global stage, in the order of the file.
auto numbers_of(LatinIteration& it) {
  return std::tie(it.first_step, it.last_step, it.round, it.working_modes, it.archived_modes, it.lanes,
                  it.residual, it.correction, it.indicator, it.cpu_seconds);
}

struct Saver {
  files::Hdf5Writer& file;

  void number(const char* name, auto value) const { file.number_attribute("/", name, value); }
  /// Sizes apart from values: a matrix may be empty.
  void matrix(const std::string& name, const MatrixXd& matrix) const {
    const std::vector<std::int64_t> sizes = {matrix.rows(), matrix.cols()};
    file.write_integers(name + "/size", sizes, {2}, {"1", "rows, columns"});
    if (matrix.size() == 0) return;
    file.write(name + "/values", std::span(matrix.data(), matrix.size()),
               {static_cast<std::size_t>(matrix.cols()), static_cast<std::size_t>(matrix.rows())},
               {"1", "by columns"});
  }
  void matrices(const std::string& name, const char* count, const std::vector<MatrixXd>& all) const {
    number(count, all.size());
    for (Index k = 0; k < std::ssize(all); ++k) matrix(fmt::format("{}/{}", name, k), all[k]);
  }
  void whole(const std::string& name, const Eigen::MatrixXi& numbers) const {
    matrix(name, numbers.cast<double>());
  }
  void cells(const std::vector<std::int64_t>& cells) const {
    if (!cells.empty()) file.write_integers("/cells", cells, {cells.size()}, {"1", "active cells"});
  }
  void history(std::vector<LatinIteration> history) const {
    MatrixXd table(10, std::ssize(history));
    double* to = table.data();
    for (LatinIteration& it : history)
      std::apply([&](auto... number) { ((*to++ = number), ...); }, numbers_of(it));
    matrix("/stages", table);
  }
};

struct Loader {
  const files::Hdf5Reader& file;

  void number(const char* name, auto& value) const {
    value = static_cast<std::decay_t<decltype(value)>>(file.number_attribute("/", name));
  }
  void matrix(const std::string& name, MatrixXd& matrix) const {
    const std::vector<std::int64_t> sizes = file.read_integers(name + "/size");
    if (sizes.size() != 2 || sizes[0] < 0 || sizes[1] < 0) throw DataError(name + ": not a matrix");
    matrix.resize(sizes[0], sizes[1]);
    if (matrix.size() == 0) return;
    const std::vector<double> values =
        file.read(name + "/values", {static_cast<std::size_t>(sizes[1]), static_cast<std::size_t>(sizes[0])});
    std::copy(values.begin(), values.end(), matrix.data());
  }
  void matrices(const std::string& name, const char* count, std::vector<MatrixXd>& all) const {
    all.resize(file.number_attribute("/", count));
    for (Index k = 0; k < std::ssize(all); ++k) matrix(fmt::format("{}/{}", name, k), all[k]);
  }
  void whole(const std::string& name, Eigen::MatrixXi& numbers) const {
    MatrixXd values;
    matrix(name, values);
    numbers = values.cast<int>();
  }
  void cells(std::vector<std::int64_t>& cells) const {
    if (file.has("/cells")) cells = file.read_integers("/cells");
  }
  void history(std::vector<LatinIteration>& history) const {
    MatrixXd table;
    matrix("/stages", table);
    if (table.rows() != 10) throw DataError("/stages: not ten numbers each");
    history.resize(table.cols());
    const double* from = table.data();
    for (LatinIteration& it : history)
      std::apply([&](auto&... n) { ((n = static_cast<std::decay_t<decltype(n)>>(*from++)), ...); },
                 numbers_of(it));
  }
};

/// Every member, for both ways.
void transfer(const auto& archive, auto& state) {
  archive.matrix("/modes/displacements", state.modes.displacements);
  archive.matrix("/modes/forces", state.modes.forces);
  archive.matrix("/modes/directions", state.modes.directions);
  archive.cells(state.cells);
  archive.history(state.solution.history);
  archive.number("local_points", state.solution.local_points);
  archive.number("cpu_seconds", state.solution.cpu_seconds);
  archive.number("next_step", state.next_step);
  archive.matrix("/history", state.history);
  archive.matrix("/expanded", state.expanded);
  archive.matrix("/residual", state.solution.residual);
  archive.matrix("/reaction", state.solution.reaction);
  archive.whole("/accepted", state.solution.accepted);
  archive.matrices("/coordinates", "steps", state.solution.coordinates);
}

}  // namespace

void write_state(const LatinState& state, const std::string& key, const std::string& path) {
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    transfer(Saver{file}, state);
    file.text_attribute("/", "key", key);
    file.close();
  });
}

std::optional<LatinState> read_state(const std::string& key, const std::string& path) {
  if (!std::filesystem::exists(path)) return std::nullopt;
  try {
    const files::Hdf5Reader file(path);
    if (file.text_attribute("/", "key") != key) return std::nullopt;
    LatinState state;
    transfer(Loader{file}, state);
    return state;
  } catch (const DataError&) {
    return std::nullopt;  // computed again and replaced
  }
}

}  // namespace knothe::offline
