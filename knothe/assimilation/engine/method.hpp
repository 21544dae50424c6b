#pragma once
/// @file How the engine turns data into posteriors: by quadratic forms, in any order, or, where values are
/// judged by those before them, one after the other.
#include <memory>

#include "knothe/assimilation/update/problem.hpp"
#include "knothe/assimilation/update/robust_update.hpp"
#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/likelihood/data/data_set.hpp"

namespace knothe::assimilation {

/// A posterior as a function of a set of data: the order in which they were added never matters, to the bit.
class PosteriorMethod {
 public:
  virtual ~PosteriorMethod() = default;
  /// A datum that is not there yet, at a model time (index) of this method's model. DataError for one that
  /// cannot be assimilated: nothing has changed then.
  virtual void add(likelihood::DatumPointer datum, std::size_t time_index) = 0;
  /// The method need not keep all data: `recall` gives those of a step again, as of
  /// `SequentialUpdate`.
  virtual void set_recall(likelihood::StepStore::Recall, std::size_t /* kept */) {}
  /// Takes a datum out that is there.
  virtual void withdraw(std::size_t step, const likelihood::DatumKey& key) = 0;
  /// The posterior of all data of steps ≤ `step`, which has data, as `SequentialUpdate::follow` has it.
  virtual const UpdateResult& posterior_at(std::size_t step) = 0;
  /// The same, at once where that can be, without the monitor.
  virtual const UpdateResult& preview(std::size_t step) = 0;
  /// Of gating or a Student-t likelihood, else null.
  [[nodiscard]] virtual const SensorReport* sensors() const { return nullptr; }
  /// The form of that step's data given those before, as they were assimilated; null: not known.
  [[nodiscard]] virtual const likelihood::StepForm* form_of(std::size_t step) const = 0;
  /// The quadratic form of all data of steps ≤ `step`; none for a method without forms.
  [[nodiscard]] virtual std::optional<likelihood::StepForm> form_up_to(std::size_t step) = 0;
  /// Changes of the structure, known or found so far.
  [[nodiscard]] virtual const StructureChanges& changes() const = 0;
  /// The update behind it, where there is one: bias and discrepancy.
  [[nodiscard]] virtual const SequentialUpdate* update() const { return nullptr; }
};

/// UsageError for options that do not go together.
[[nodiscard]] std::unique_ptr<PosteriorMethod> make_method(const Problem& problem);

}  // namespace knothe::assimilation
