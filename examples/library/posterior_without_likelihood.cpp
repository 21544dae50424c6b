// A posterior from joint samples of data and parameter alone. Run: posterior_without_likelihood
#include <cstdio>
#include <knothe/knothe.hpp>
#include <random>

int main() {
  // A simulator draws a parameter p ~ N(0, 1) and answers with data y = p + 0.2 p³ + 0.4 e, e ~ N(0, 1).
  std::mt19937 generator(1);
  std::normal_distribution<double> normal;
  std::vector<double> pairs;  // (y, p): what will be given comes first
  for (int i = 0; i < 5000; ++i) {
    const double p = normal(generator);
    pairs.insert(pairs.end(), {p + 0.2 * p * p * p + 0.4 * normal(generator), p});
  }
  const auto map = knothe::TransportMap::from_samples(pairs, 2);

  for (const double measured : {-1.5, 0.3, 2.0}) {
    const std::vector<double> draws = map.conditional_sample(std::vector{measured}, 20000, 2);
    double mean = 0;
    for (std::size_t i = 1; i < draws.size(); i += 2) mean += draws[i] / 20000;
    std::printf("y = %.1f: p = %.3f\n", measured, mean);
  }
}
