#include "knothe/model/grid/registered_solutions.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace {

using namespace knothe;
using model::History;
using model::RegisteredSolutions;

/// A front that leaves at time `start` and takes `duration`: κ = 1 − (t − start) / duration, u = t (a + b κ).
struct Front {
  double start, duration, a, b;
  [[nodiscard]] double state(double t) const { return 1 - std::clamp((t - start) / duration, 0.0, 1.0); }
  [[nodiscard]] double value(double t) const { return t * (a + b * state(t)); }
};

/// Cubic in q, as the splines are.
Front front_at(double q) {
  return {0.2 + 0.1 * q * q, 0.3 + 0.05 * q * q * q, 1 + q, 2 - q * q};
}

History history_of(const Front& front) {
  History history;
  for (const double part : {0.25, 0.5, 1.0}) history.time.push_back(part * front.start);
  for (int i = 1; i < 8; ++i) history.time.push_back(front.start + front.duration * i / 8);
  history.values.resize(2, std::ssize(history.time));
  for (Index i = 0; i < std::ssize(history.time); ++i) {
    history.state.push_back(5 * front.state(history.time[i]));
    history.values.col(i) << front.value(history.time[i]), history.time[i];
  }
  return history;
}

TEST(RegisteredSolutions, AreExactForAFrontWhoseShapeAndClockAreCubic) {
  const std::vector<double> nodes = {0, 0.3, 0.5, 0.9, 1};
  std::vector<History> histories;
  for (const double q : nodes) histories.push_back(history_of(front_at(q)));
  const RegisteredSolutions registered(std::vector<std::vector<double>>{nodes}, histories);
  const std::vector<double> times = {0.05, 0.2, 0.22, 0.3, 0.41, 0.45};
  for (const double q : {0.0, 0.17, 0.5, 0.71, 1.0}) {
    const Eigen::MatrixXd found = registered.at(std::vector{q}, times);
    for (Index i = 0; i < std::ssize(times); ++i) {
      EXPECT_NEAR(found(0, i), front_at(q).value(times[i]), 1e-13) << q << ' ' << times[i];
      EXPECT_NEAR(found(1, i), times[i], 1e-13);
    }
  }
}

TEST(RegisteredSolutions, KeepTheirShapeBeforeTheFirstChangeAndAfterTheLast) {
  const RegisteredSolutions registered(std::vector<std::vector<double>>{}, {history_of({0.2, 0.4, 1, 2})});
  const Eigen::MatrixXd found = registered.at({}, std::vector{1e-6, 0.1, 5.0});
  EXPECT_NEAR(found(0, 0), 3e-6, 1e-18);
  EXPECT_NEAR(found(0, 1), 0.3, 1e-15);
  EXPECT_NEAR(found(0, 2), 5 * (1 + 2.0 / 8), 1e-13);  // κ = 1/8 at the last time of the history
}

TEST(RegisteredSolutions, TakeHistoriesLastAxisFastest) {
  const std::vector<std::vector<double>> nodes = {{0, 0.5, 1}, {0, 1}};
  std::vector<History> histories;
  const auto front = [](double q, double r) { return Front{0.2 + 0.1 * r, 0.4, 1 + q * q, r}; };
  for (const double q : nodes[0])
    for (const double r : nodes[1]) histories.push_back(history_of(front(q, r)));
  const RegisteredSolutions registered(nodes, histories);
  for (const double t : {0.1, 0.24, 0.4})
    EXPECT_NEAR(registered.at(std::vector{0.3, 0.6}, std::vector{t})(0, 0), front(0.3, 0.6).value(t), 1e-13);
}

// One solution jumps within a step where the other passes through: the clock stands still, and never goes
// back.
TEST(RegisteredSolutions, AJumpTakesOneStep) {
  History jump;
  jump.time = {0.1, 0.2, 0.3, 0.301, 0.4};
  jump.state = {1, 1, 0.9, 0.2, 0.1};
  jump.values = Eigen::MatrixXd::Zero(1, 5);
  for (Index i = 0; i < 5; ++i) jump.values(0, i) = jump.time[i] * jump.state[i];
  History slow = jump;
  slow.time = {0.1, 0.2, 0.3, 0.5, 0.6};
  for (Index i = 0; i < 5; ++i) slow.values(0, i) = slow.time[i] * slow.state[i];
  const RegisteredSolutions registered(std::vector<std::vector<double>>{{0, 1}}, {jump, slow});
  double before = 1;
  for (double t = 0.01; t < 0.7; t += 0.01) {
    const double shape = registered.at(std::vector{0.5}, std::vector{t})(0, 0) / t;
    EXPECT_LE(shape, before + 1e-12) << t;  // the state itself
    before = shape;
  }
  EXPECT_NEAR(before, 0.1, 1e-12);
}

TEST(RegisteredSolutions, WrongNumbersAreTold) {
  const std::vector<std::vector<double>> nodes = {{0, 1}};
  EXPECT_EQ(files::message_of<UsageError>([&] { RegisteredSolutions(nodes, {history_of(front_at(0))}); }),
            "a history is needed for each point of the grid");
  History broken = history_of(front_at(0));
  broken.state[0] = 0;
  EXPECT_EQ(files::message_of<UsageError>([&] {
              RegisteredSolutions(nodes, {broken, broken});
            }),
            "a history needs a state above zero and values at each of its times");
}

}  // namespace
