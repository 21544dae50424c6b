#pragma once
/// @file Likelihoods that judge a value by those before it: gating, Student-t.
#include <map>

#include "knothe/assimilation/engine/method.hpp"

namespace knothe::assimilation {

/// A datum that comes late, or is withdrawn, makes the method begin again from the first: n updates.
class OrderedMethod : public PosteriorMethod {
 public:
  explicit OrderedMethod(const Problem& problem);

  void add(likelihood::DatumPointer datum, std::size_t time_index) override;
  void withdraw(std::size_t step, const likelihood::DatumKey& key) override;
  const UpdateResult& posterior_at(std::size_t step) override;
  const UpdateResult& preview(std::size_t step) override { return posterior_at(step); }
  [[nodiscard]] const SensorReport* sensors() const override;
  [[nodiscard]] const StructureChanges& changes() const override { return robust_->changes(); }
  [[nodiscard]] const SequentialUpdate* update() const override { return robust_->gaussian(); }
  [[nodiscard]] const likelihood::StepForm* form_of(std::size_t step) const override {
    return last_ && last_->first == step ? robust_->latest_form() : nullptr;
  }
  [[nodiscard]] std::optional<likelihood::StepForm> form_up_to(std::size_t) override { return {}; }

 private:
  struct Timed {
    likelihood::DatumPointer datum;
    std::size_t time_index;  ///< of this method's model
  };
  using Place = std::pair<std::size_t, likelihood::DatumKey>;
  void begin_anew();
  void assimilate(const Place& place, const Timed& timed);

  Problem problem_;
  std::unique_ptr<RobustUpdate> robust_;
  std::map<Place, Timed> data_;
  std::optional<Place> last_;  ///< assimilated
  UpdateResult result_;
};

}  // namespace knothe::assimilation
