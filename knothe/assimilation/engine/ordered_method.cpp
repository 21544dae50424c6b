#include "knothe/assimilation/engine/ordered_method.hpp"

namespace knothe::assimilation {

using likelihood::DatumKey;

OrderedMethod::OrderedMethod(const Problem& problem) : problem_(problem) {
  begin_anew();
}

void OrderedMethod::begin_anew() {
  last_.reset();
  robust_ = std::make_unique<RobustUpdate>(problem_.model, problem_.noise, problem_.priors, problem_.update,
                                           problem_.robust);
}

void OrderedMethod::add(likelihood::DatumPointer datum, std::size_t time_index) {
  const Place place(datum->step, datum->key);
  data_.insert_or_assign(place, Timed{std::move(datum), time_index});
  if (last_ && place <= *last_) begin_anew();
}

void OrderedMethod::withdraw(std::size_t step, const DatumKey& key) {
  const Place place(step, key);
  data_.erase(place);
  if (last_ && place <= *last_) begin_anew();
}

void OrderedMethod::assimilate(const Place& place, const Timed& timed) {
  result_ = robust_->update(*timed.datum, timed.time_index);
  last_ = place;
}

const UpdateResult& OrderedMethod::posterior_at(std::size_t step) {
  if (last_ && last_->first > step) begin_anew();
  try {
    for (auto it = last_ ? data_.upper_bound(*last_) : data_.begin();
         it != data_.end() && it->first.first <= step; ++it)
      assimilate(it->first, it->second);
  } catch (...) {
    begin_anew();  // discard the partial update
    throw;
  }
  return result_;
}

const SensorReport* OrderedMethod::sensors() const {
  return &robust_->sensors();
}

}  // namespace knothe::assimilation
