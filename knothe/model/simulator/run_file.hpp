#pragma once
/// @file Finished runs of a full-order model, each in a file of its own.
#include <map>
#include <string>
#include <vector>

#include "knothe/model/simulator/simulator.hpp"

namespace knothe::model {

/// How a run went, beside its solution.
struct RunRecord {
  std::map<std::string, double> numbers;  ///< what the solver counts: iterations, seconds
  /// Step numbers from 0 at which the solver itself does not trust its solution.
  std::vector<int> steps_without_equilibrium;
};

/// Writes the solution, a grid of one point, as a file of snapshots with key and record, atomically. IoError.
void write_run(const Run& run, const Snapshots& solution, const RunRecord& record);

/// Whether the file is there, readable, and of this very run.
[[nodiscard]] bool is_there(const Run& run);

/// How it went, without its solution. DataError if it is none.
[[nodiscard]] RunRecord read_record(const Run& run);

struct FinishedRun {
  Snapshots solution;
  RunRecord record;
};
/// DataError if it is none.
[[nodiscard]] FinishedRun read_run(const Run& run);

}  // namespace knothe::model
