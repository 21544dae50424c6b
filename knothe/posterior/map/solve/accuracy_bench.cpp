/// @file The accuracy table of docs/explanation/transport.md: problems with known answers, how far the
/// answers are from them.
///
/// Usage: accuracy_bench [chain length, default 50000] [calibration data sets, default 1000]
#include <fmt/format.h>

#include <chrono>
#include <cstdlib>

#include "knothe/posterior/draws/nested_laplace.hpp"
#include "knothe/posterior/map/testing/accuracy_calibration.hpp"
#include "knothe/posterior/map/testing/accuracy_support.hpp"

namespace {

using namespace knothe;
using namespace knothe::posterior;
using namespace knothe::posterior::accuracy;

void print_header() {
  fmt::print(
      "| problem | d | reference | order | verified diagnostic | ess | mean / std | std | log-evidence | "
      "evaluations | s | trusted |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n");
}

void print_row(const std::string& name, posterior::LogDensity& target, const Reference& reference,
               const MapSolverOptions& options = {}) {
  const Accuracy a = measure(target, reference, options);
  fmt::print(
      "| {} | {} | {}{} | {} | {:.1e} | {:.4f} | {:.1e} | {:.1e} | {} | {} | {:.3f} | {} |\n", name,
      target.dimension(), reference.source,
      reference.mean_error > 0
          ? fmt::format(" (mean ± {:.1e} std, std ± {:.1e})", reference.mean_error, reference.std_error)
          : "",
      a.result.order, a.result.verified_diagnostic, a.correction.ess, a.mean, a.standard_deviation,
      std::isnan(a.log_evidence) ? "–"
                                 : fmt::format("{:.1e}{}", a.log_evidence,
                                               reference.log_evidence_error > 0
                                                   ? fmt::format(" (± {:.1e})", reference.log_evidence_error)
                                                   : ""),
      a.result.density_evaluations + a.correction.density_evaluations, a.seconds,
      a.correction.trust.trusted ? "yes" : "no");
}

/// The same by `nested_laplace`, without a map.
void print_row_without_map(const std::string& name, posterior::LogDensity& target,
                           const Reference& reference) {
  const auto start = std::chrono::steady_clock::now();
  const posterior::NestedLaplaceResult result = posterior::nested_laplace(target);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const Eigen::ArrayXd std = posterior::covariance_of(result.sample).diagonal().cwiseSqrt();
  const Eigen::ArrayXd off = posterior::mean_of(result.sample) - reference.mean;
  const Eigen::ArrayXd exact = reference.standard_deviation;
  fmt::print("| {} | {} | {} | – | – | {:.4f} | {:.1e} | {:.1e} | {} | {} | {:.3f} | {} |\n", name,
             target.dimension(), reference.source,
             result.sample.effective_size / static_cast<double>(result.sample.weights.size()),
             (off / exact).abs().maxCoeff(), (std / exact - 1).abs().maxCoeff(),
             std::isnan(reference.log_evidence)
                 ? "–"
                 : fmt::format("{:.1e}", std::abs(result.sample.log_evidence - reference.log_evidence)),
             result.sample.density_evaluations, seconds, result.converged ? "yes" : "no");
}

Reference chains_with_evidence(posterior::LogDensity& target, Eigen::Index draws) {
  Reference reference = reference_by_chains(target, draws, 101);
  add_evidence(target, 102, reference);
  return reference;
}

template <class Make>
void print_calibration(const std::string& name, int data_sets, Eigen::Index d, std::uint64_t seed,
                       const Make& make) {
  const Calibration c = calibrate(data_sets, d, seed, make);
  fmt::print("| {} | {} | {} | {} | {:.3f} | {:+.3f} | {:+.3f} |\n", name, d, data_sets, c.trusted,
             c.lowest_ess, worst_excess(c.ranks), worst_excess(c.wrong_ranks));
}

}  // namespace

int main(int argc, char** argv) {
  const Eigen::Index samples = argc > 1 ? std::atol(argv[1]) : 50000;
  const int data_sets = argc > 2 ? std::atoi(argv[2]) : 1000;
  print_header();
  for (Eigen::Index d : {2, 10, 50}) {
    auto target = linear_gaussian(d);
    print_row("linear-Gaussian", target, reference_of(target));
  }
  auto logistic = logistic_regression();
  print_row("logistic regression", logistic, chains_with_evidence(logistic, samples),
            logistic_regression_options());
  auto schools = eight_schools();
  print_row("eight schools, not centred", schools, reference_of(schools), eight_schools_options());
  auto volatility = stochastic_volatility();
  const Reference chains = reference_by_chains(volatility, samples, 103);
  print_row("stochastic volatility, sparse map", volatility, chains, stochastic_volatility_options());
  print_row_without_map("eight schools, a few variables first", schools, reference_of(schools));
  print_row_without_map("stochastic volatility, a few variables first", volatility, chains);
  fmt::print(
      "\n| calibration | d | data sets | trusted | lowest ess | excess over the 95 % band | the same, std × "
      "1.3 "
      "|\n|---|---|---|---|---|---|---|\n");
  print_calibration("oxygen demand", data_sets, 2, 77, simulated_oxygen_demand);
  print_calibration("logistic regression", data_sets, 3, 78, simulated_logistic_regression);
}
