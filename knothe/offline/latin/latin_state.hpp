#pragma once
/// @file Where LATIN-PGD is between two windows, and its file: what a run that was interrupted goes on from.
#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "knothe/offline/latin/latin_basis.hpp"
#include "knothe/offline/latin/latin_pgd.hpp"
#include "knothe/offline/latin/latin_separated.hpp"

namespace knothe::offline {

inline constexpr double k_microseconds_between_saves = 30e6;

/// Everything the next window depends on.
struct LatinState {
  int next_step = 0;                ///< first step of the next window
  std::vector<std::int64_t> cells;  ///< active, in the order in which they joined
  LatinBasis::Modes modes;
  Eigen::MatrixXd history;   ///< P × n_g: damage
  Eigen::MatrixXd expanded;  ///< archived modes on all dofs, n_dof × (as many as have been expanded)
  LatinSolution solution;    ///< steps before `next_step`; without `space`
};

/// The same of the fully separated form, between two ranges of time: the terms say how far it is.
struct SeparatedState {
  std::vector<std::int64_t> cells;
  LatinBasis::Modes modes;
  LatinTerms terms;
  double relaxation = 1, indicator = 1;
  std::vector<SeparatedIteration> history;
  long local_points = 0;
  double cpu_seconds = 0;
};

/// Writes either atomically; `key` says what the run is of. IoError.
template <class State>
void write_state(const State& state, const std::string& key, const std::string& path);
/// Nothing if there is no file, or it is damaged, or of another run.
template <class State>
[[nodiscard]] std::optional<State> read_state(const std::string& key, const std::string& path);

}  // namespace knothe::offline
