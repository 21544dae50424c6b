#pragma once
/// @file The steps of a journal's data in the model of now.
#include <span>
#include <string>

#include "knothe/service/journal/journal.hpp"

namespace knothe::service {

/// Sets the step of a record from its time: the index that it was recorded with is that of the model of then.
/// DataError naming `journal` and the record where the model has no such time.
void match_step(JournalEntry& entry, std::span<const double> model_times, const std::string& journal);

}  // namespace knothe::service
