#include "knothe/assimilation/engine/method.hpp"

#include "knothe/assimilation/engine/ordered_method.hpp"
#include "knothe/assimilation/update/compatibility.hpp"

namespace knothe::assimilation {
namespace {

/// By quadratic forms, in any order: a datum that comes late, or is withdrawn, costs the steps from it on.
class FormMethod final : public PosteriorMethod {
 public:
  explicit FormMethod(const Problem& problem)
      : update_(problem.model, problem.noise, problem.priors, problem.update) {
    if (problem.corrected_steps)
      update_.correct_bias((*problem.corrected_steps)[0], (*problem.corrected_steps)[1]);
  }

  void add(likelihood::DatumPointer datum, std::size_t time_index) override {
    update_.add(std::move(datum), time_index);
  }
  void set_recall(likelihood::StepStore::Recall recall, std::size_t kept) override {
    update_.set_recall(std::move(recall), kept);
  }
  void withdraw(std::size_t step, const likelihood::DatumKey& key) override { update_.withdraw(step, key); }
  const UpdateResult& posterior_at(std::size_t step) override { return update_.posterior_at(step); }
  const UpdateResult& preview(std::size_t step) override { return update_.preview(step); }
  [[nodiscard]] const likelihood::StepForm* form_of(std::size_t step) const override {
    return update_.form_of(step);
  }
  [[nodiscard]] std::optional<likelihood::StepForm> form_up_to(std::size_t step) override {
    return update_.form_up_to(step);
  }
  [[nodiscard]] const StructureChanges& changes() const override { return update_.changes(); }
  [[nodiscard]] const SequentialUpdate* update() const override { return &update_; }

 private:
  SequentialUpdate update_;
};

}  // namespace

std::unique_ptr<PosteriorMethod> make_method(const Problem& problem) {
  require_compatible(features_of(problem));
  if (!problem.robust.is_active()) return std::make_unique<FormMethod>(problem);
  return std::make_unique<OrderedMethod>(problem);
}

}  // namespace knothe::assimilation
