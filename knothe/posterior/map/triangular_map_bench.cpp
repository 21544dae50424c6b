/// @file Speed of the kernel: value and log-determinant at 10,000 points, and the inverse, for every
/// rectifier. Prints machine, median and p99 of the time, points per second.
///
/// Usage: triangular_map_bench [repetitions]
/// Timed by processor time: other programs on the machine do not count.
#include <time.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "knothe/posterior/map/triangular_map.hpp"

namespace {

using namespace knothe::posterior;

std::string processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  return "unknown processor";
}

double processor_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

struct Timing {
  double median, p99;
};

template <class Body>
Timing time_of(int repetitions, const Body& body) {
  body();  // buffers are there from the second call on
  std::vector<double> seconds;
  for (int i = 0; i < repetitions; ++i) {
    const double start = processor_seconds();
    body();
    seconds.push_back(processor_seconds() - start);
  }
  std::sort(seconds.begin(), seconds.end());
  return {seconds[seconds.size() / 2], seconds[seconds.size() * 99 / 100]};
}

void print(const char* what, Eigen::Index points, const Timing& t) {
  std::printf("  %-34s %9.3g points/s   median %8.3f ms   p99 %8.3f ms\n", what,
              static_cast<double>(points) / t.median, 1e3 * t.median, 1e3 * t.p99);
}

void measure(Rectifier rectifier, Eigen::Index d, int order, int repetitions) {
  constexpr Eigen::Index k_points = 10'000;
  TriangularMap map(total_order_map(d, order, {rectifier, {}}));
  std::mt19937 generator(1);
  std::normal_distribution<double> normal;
  Eigen::VectorXd a = map.coefficients();
  for (Eigen::Index i = 0; i < a.size(); ++i) a[i] += 0.05 * normal(generator);
  map.set_coefficients(a);
  Eigen::MatrixXd x(k_points, d);
  for (Eigen::Index i = 0; i < x.size(); ++i) x.data()[i] = normal(generator);
  MapBatch plain;
  std::printf("%s, d = %ld, order %d, %ld coefficients\n", knothe::to_text(rectifier).c_str(),
              static_cast<long>(d), order, static_cast<long>(a.size()));
  print("value, log det", k_points, time_of(repetitions, [&] { map.evaluate(x, 0, plain); }));
  Eigen::MatrixXd back;
  print("inverse", k_points, time_of(repetitions, [&] { back = map.inverse(plain.value); }));
  std::printf("  largest error of the inverse %.1e\n", (back - x).cwiseAbs().maxCoeff());
}

}  // namespace

int main(int argc, char** argv) {
  const int repetitions = argc > 1 ? std::atoi(argv[1]) : 50;
  std::printf("%s, 10,000 points of N(0, I), %d repetitions\n", processor().c_str(), repetitions);
  for (const auto rectifier : {Rectifier::square, Rectifier::softplus, Rectifier::exponential})
    for (const auto& [d, order] : {std::pair{2, 3}, {5, 3}, {5, 5}, {10, 3}})
      measure(rectifier, d, order, repetitions);
}
