#pragma once
/// @file A journal without its service: what it holds, and the posterior that it gives.
#include <functional>
#include <string>

#include "knothe/assimilation/engine/step_result.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/project/update_setup.hpp"
#include "knothe/service/journal/journal.hpp"

namespace knothe::service {

/// `FILE.toml` beside `FILE.journal`, unless `project` says otherwise.
[[nodiscard]] std::string project_of_journal(const std::string& journal, const std::string& project);

/// Calls `visit` for the posterior of every step of a journal, in order, by this setup. DataError where the
/// data are not of its sensors or times; Interrupted.
void for_each_result(const JournalReader& journal, const project::Project& project,
                     const project::UpdateSetup& setup,
                     const std::function<void(const assimilation::StepResult&)>& visit);

/// Verifies the journal; prints what it holds and, with the project, the posterior of every step (with `json`
/// as the lines of `knothe assimilate --json`).
void replay_journal(const std::string& journal, const std::string& project_path, bool json);

/// Writes a journal's measurements as CSV (`output` ends with .csv), or the results folder of `knothe
/// assimilate` (posterior.nc in ArviZ's layout, steps, fields for ParaView).
void export_journal(const std::string& journal, const std::string& project_path, const std::string& output);

}  // namespace knothe::service
