#include "knothe/engine/method.hpp"

#include "knothe/assimilation/update/compatibility.hpp"
#include "knothe/engine/ordered_method.hpp"

namespace knothe::engine {
namespace {

/// By quadratic forms, in any order: a datum that comes late, or is withdrawn, costs the steps from it on.
class FormMethod final : public PosteriorMethod {
 public:
  explicit FormMethod(const assimilation::Problem& problem)
      : update_(problem.model, problem.noise, problem.priors, problem.update) {
    if (problem.corrected_steps) update_.redo((*problem.corrected_steps)[0], (*problem.corrected_steps)[1]);
  }

  void add(assimilation::DatumPointer datum, std::size_t time_index) override {
    update_.add(std::move(datum), time_index);
  }
  void withdraw(std::size_t step, const assimilation::DatumKey& key) override { update_.withdraw(step, key); }
  const assimilation::UpdateResult& conclude(std::size_t step) override { return update_.follow(step); }
  const assimilation::UpdateResult& preview(std::size_t step) override { return update_.preview(step); }
  [[nodiscard]] const assimilation::StepForm* form_of(std::size_t step) const override {
    return update_.form_of(step);
  }
  [[nodiscard]] std::optional<assimilation::StepForm> form_up_to(std::size_t step) override {
    return update_.form_up_to(step);
  }
  [[nodiscard]] const assimilation::SequentialUpdate* update() const override { return &update_; }

 private:
  assimilation::SequentialUpdate update_;
};

}  // namespace

std::unique_ptr<PosteriorMethod> make_method(const assimilation::Problem& problem) {
  assimilation::require_compatible(features_of(problem));
  if (!problem.robust.is_active()) return std::make_unique<FormMethod>(problem);
  return std::make_unique<OrderedMethod>(problem);
}

}  // namespace knothe::engine
