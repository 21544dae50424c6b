#pragma once
/// @file What to do next with the specimen, and why (docs/explanation/decisions.md).
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "knothe/base/enum_names.hpp"

namespace knothe::assimilation {

enum class Action {
  load,  ///< on to a later time of the model, and measure there
  hold,  ///< measure again where the specimen is
  stop   ///< no more load, no more measurement
};

constexpr auto names_of(Action /*action*/) {
  return std::to_array<Named<Action>>(
      {{Action::load, "load"}, {Action::hold, "hold"}, {Action::stop, "stop"}});
}

/// The table [decide] of a project file.
struct DecisionOptions {
  std::string failure;             ///< forecast whose quantity beyond its threshold is failure
  double risk = 0.05;              ///< largest probability that the whole test ends in failure
  std::vector<double> increments;  ///< of model time, to choose among; empty: any later time of the model
  std::optional<double> end;       ///< model time beyond which there is no load; absent: the model's last
  std::string about;               ///< parameter or forecast to learn about; empty: all parameters
  double cost = 0.05;              ///< of a measurement, nats: one that tells less is not worth making
};

struct Decision {
  Action action = Action::stop;
  double time = 0;             ///< model time to load to; of the others the present one
  std::optional<double> load;  ///< what is imposed then, where the model knows
  std::string load_units;
  std::string time_units;    ///< empty where the model states none
  double information = 0;    ///< expected of the next measurement, nats; 0 of `stop`
  std::vector<double> plan;  ///< model times of all measurements that are worth making now, increasing
  std::optional<double> failure_probability;  ///< that the specimen fails by `time`; absent: not known
  std::optional<double> allowed_probability;  ///< largest for this action; absent with the other
  double furthest = 0;                        ///< largest model time that the risk allows now
  std::string message = {};                   ///< why
};

}  // namespace knothe::assimilation
