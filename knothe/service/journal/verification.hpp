#pragma once
/// @file What the full-order model said of a test when it was asked
/// (docs/explanation/verdict.md, "In the service"): an entry of the logbook.
#include <optional>
#include <span>
#include <string>

#include "knothe/service/journal/logbook.hpp"

namespace knothe::service {

/// The model that all data are assimilated with from then on, and how it came about.
struct Verification {
  std::size_t version = 0;  ///< how often the project's model has been refined; 0: it is used as it is
  std::string base;         ///< SHA-256 of the project's model
  std::string model;        ///< SHA-256 of the refined model; empty while there is none
  std::size_t runs = 0;     ///< of the full-order model, all so far
  double moved_std = 0;     ///< how far this moved the posterior's means at most, in standard deviations
  bool thorough = false;    ///< with all runs that the project allows, as at the end of a test
  std::string trouble;      ///< why the full-order model could not be asked; empty: it could
  double time = 0;          ///< model time of the posterior that it was asked for
};

/// The entry that says so.
[[nodiscard]] LogbookEntry entry_of(const Verification& verification);
/// Nothing for entries of other kinds.
[[nodiscard]] std::optional<Verification> verification_of(const LogbookEntry& entry);
/// In words.
[[nodiscard]] std::string text_of(const Verification& verification);

/// The last of a model (`base`, its SHA-256); without one, that it is used as it is.
[[nodiscard]] Verification last_verification(std::span<const LogbookEntry> entries, const std::string& base);

/// Whether the full-order model is still to be asked thoroughly: a request or the end of the test that came
/// after the last time that it was.
[[nodiscard]] bool awaits_verification(std::span<const LogbookEntry> entries);

/// Where the solutions and refined models of a journal are: a folder in NAME.refinement beside NAME.journal,
/// one for each model (`base`, its SHA-256) that was refined.
[[nodiscard]] std::string refinement_folder(const std::string& journal, const std::string& base);

/// Before a journal is copied to a new name. UsageError if there is a NAME.refinement of another journal.
void require_no_refinement(const std::string& from, const std::string& to);
/// Copies what is in the NAME.refinement of a journal, if it has one, to that of its copy, also while it is
/// written: what the copy names is there. IoError.
void copy_refinement(const std::string& from, const std::string& to);

}  // namespace knothe::service
