/// @file What a verdict costs: tests of the residuals of all data so far, range, and the shift by eight known
/// errors of the model. Prints machine, threads, median and p99 of the last fifty of 100 steps.
///
/// Usage: verdict_bench [observations] [functions]
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <random>

#include "knothe/assimilation/update/sequential_update.hpp"
#include "knothe/assimilation/verdict/assessor.hpp"
#include "knothe/base/monotonic_time.hpp"
#include "knothe/likelihood/testing/bench_models.hpp"

int main(int count, char** arguments) {
  using namespace knothe;
  using namespace knothe::posterior;
  using namespace knothe::likelihood;
  using namespace knothe::assimilation;
  using Eigen::Index;
  using Eigen::MatrixXd;
  using Eigen::VectorXd;
  const Index n = count > 1 ? std::atol(arguments[1]) : 60, r = count > 2 ? std::atol(arguments[2]) : 30;
  constexpr Index k_times = 100;
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  const auto draws = [&](Index rows, Index columns) {
    return MatrixXd(MatrixXd::NullaryExpr(rows, columns, [&](Index, Index) { return normal(random); }));
  };
  auto model = std::make_shared<knothe::model::ObservedModel>();
  model->functions = std::make_shared<likelihood::bench::SmoothFunctions>(r);
  model->parameters = {"a", "b"};
  model->space = draws(n, r);
  model->lift = draws(n, k_times);
  for (Index t = 0; t < k_times; ++t) {
    model->time.push_back(static_cast<double>(t));
    model->core.emplace_back(draws(r, r));
  }
  knothe::model::Sensors sensors;
  for (Index i = 0; i < n; ++i) {
    const std::array<double, 3> at = {static_cast<double>(i / 2), 0, 0};
    sensors.add(at, i % 2);
  }
  const NoiseModel noise = NoiseModel::independent(VectorXd::Constant(n, 20));
  const std::vector<Prior> priors(2, Prior::normal(1, 0.3).truncated(0.5, 1.5, "p"));
  knothe::model::ObservedErrors errors;
  errors.space = draws(n, 20);
  for (Index t = 0; t < k_times; ++t) errors.coefficients.emplace_back(1e-3 * draws(20, 8));
  errors.points = (0.8 * MatrixXd::Random(8, 2).array() / 2 + 1).matrix();
  errors.reach = MatrixXd::Zero(8, 2);
  SequentialUpdate update(model, noise, priors);
  Assessor assessor(model, noise, priors, sensors, {}, errors, {});
  const VectorXd truth = VectorXd::Ones(2);
  std::vector<DatumPointer> data;
  std::vector<double> us;
  bool ok = true;
  for (std::size_t t = 0; t < k_times; ++t) {
    data.push_back(std::make_shared<const Datum>(
        Datum{{}, t, t, model->predict(truth, t) + 20 * draws(n, 1), std::nullopt}));
    update.update(t, t, data.back()->values);
    const auto start = knothe::monotonic_now();
    const Verdict verdict =
        assessor.assess({update.result(), update.functions(), &update.sums(), update.form_of(t), false, {}},
                        AssessedData(data));
    if (t >= k_times / 2) us.push_back(knothe::microseconds_since(start));
    ok = ok && verdict.level == VerdictLevel::ok;
  }
  std::sort(us.begin(), us.end());
  fmt::print(
      "{}, 1 thread\nverdict, {} observations, {} functions, 51 to 100 data: median {:.0f} µs, p99 {:.0f} "
      "µs{}\n",
      bench::processor(), n, r, us[us.size() / 2], us[us.size() * 99 / 100], ok ? "" : " (some not ok)");
}
