#pragma once
/// @file The posterior of a set of data by their quadratic forms (docs/explanation/assimilation.md).
#include "knothe/engine/method.hpp"

namespace knothe::engine {

/// In any order: a datum that comes late, or is withdrawn, costs the steps from it on.
class FormMethod : public Method {
 public:
  explicit FormMethod(const MethodSetup& setup);

  void add(const assimilation::Datum& datum) override { update_.add(datum); }
  void withdraw(std::size_t step, const assimilation::DatumKey& key) override { update_.withdraw(step, key); }
  const assimilation::UpdateResult& conclude(std::size_t step) override { return update_.follow(step); }
  const assimilation::UpdateResult& preview(std::size_t step) override { return update_.preview(step); }
  [[nodiscard]] std::optional<assimilation::StepForm> form_up_to(std::size_t step) override {
    return update_.form_up_to(step);
  }
  [[nodiscard]] const assimilation::SequentialUpdate* update() const override { return &update_; }

 private:
  assimilation::SequentialUpdate update_;
};

}  // namespace knothe::engine
