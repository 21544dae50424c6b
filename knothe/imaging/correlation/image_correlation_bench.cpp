// Time of one picture: 1 Mpx region, 1,690 nodes, warm start, and its parts.
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <functional>
#include <vector>

#include "knothe/imaging/correlation/correlation_stage.hpp"
#include "knothe/imaging/correlation/image_correlation.hpp"
#include "knothe/imaging/series/speckle.hpp"

namespace {

using namespace knothe::imaging;

struct Scene {
  knothe::files::Picture reference, before, after;
  ImageMesh mesh = structured_mesh({20, 20, 1270, 845}, 25.6);  // 49 × 32 elements, 50 × 33 nodes + …
  Scene() {
    const SpecklePattern pattern({.width = 1290, .height = 866});
    const auto field = [](double scale) {
      return [scale](double x, double y) {
        const double a = 2e-6 * scale, dx = x - 645, dy = y - 433;
        return Displacement{0.4 * scale - 2 * a * dx * dy,
                            0.3 * scale + a * dx * dx,
                            {-2 * a * dy, -2 * a * dx, 2 * a * dx, 0}};
      };
    };
    reference = pattern.render({}, {.noise = 2, .seed = 1}, 2);
    before = pattern.render(field(1), {.noise = 2, .seed = 2}, 2);
    after = pattern.render(field(1.3), {.noise = 2, .seed = 3}, 2);
  }
};
const Scene& scene() {
  static const Scene made;
  return made;
}

void warm_picture(benchmark::State& state) {
  ImageCorrelation correlation(scene().reference, scene().mesh,
                               {.threads = static_cast<int>(state.range(0))});
  const auto start = correlation.correlate(scene().before);
  int iterations = 0;
  for (auto _ : state) iterations = correlation.correlate(scene().after, start.displacement).iterations;
  state.counters["nodes"] = correlation.mesh().node_count();
  state.counters["iterations"] = iterations;
}
BENCHMARK(warm_picture)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->Repetitions(5)->UseRealTime();

void cold_picture(benchmark::State& state) {
  ImageCorrelation correlation(scene().reference, scene().mesh, {.threads = 1});
  for (auto _ : state) benchmark::DoNotOptimize(correlation.correlate(scene().after).iterations);
}
BENCHMARK(cold_picture)->Unit(benchmark::kMillisecond)->Repetitions(3);

void spline_coefficients(benchmark::State& state) {
  SplineImage image;
  for (auto _ : state) image.assign(scene().after), benchmark::DoNotOptimize(image.coefficient(0, 0));
}
BENCHMARK(spline_coefficients)->Unit(benchmark::kMillisecond)->Repetitions(3);

void one_pass_over_the_residual(benchmark::State& state) {
  const CorrelationStage stage(reference_field(scene().reference, {}, scene().mesh.bounds(), 0, 0, 1),
                               scene().mesh, {});
  const SplineImage image(scene().after);
  CorrelationResult result;
  result.displacement.setConstant(2 * scene().mesh.node_count(), 0.45);
  for (auto _ : state)
    for (std::size_t e = 0; e < scene().mesh.elements.size(); ++e)
      benchmark::DoNotOptimize(residual_sums(stage.pixels(), stage.pixels().elements()[e],
                                             stage.reference().view(), image, stage.motion(e, result)));
}
BENCHMARK(one_pass_over_the_residual)->Unit(benchmark::kMillisecond)->Repetitions(3);

/// Processor time of this process, ms: other programs on the machine do not count (their use of its memory
/// does).
double processor_ms() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}
double best_of(int runs, const std::function<void()>& body) {
  double best = 1e300;
  for (int i = 0; i < runs; ++i) {
    const double begin = processor_ms();
    body();
    best = std::min(best, processor_ms() - begin);
  }
  return best;
}

/// Bytes per ms that one core moves, by a = b + s c over arrays of the size of what a pass reads.
double bandwidth() {
  constexpr std::size_t k_size = std::size_t{1} << 21U;
  std::vector<float> a(k_size, 0.0F), b(k_size, 1.0F), c(k_size, 2.0F);
  const double ms = best_of(20, [&] {
    for (std::size_t i = 0; i < k_size; ++i) a[i] = b[i] + 3.0F * c[i];
    benchmark::DoNotOptimize(a.data());
    benchmark::ClobberMemory();
  });
  return 3.0 * sizeof(float) * static_cast<double>(k_size) / ms;
}

/// The table of docs/explanation/imaging.md: processor time of the best of several runs beside the limits of
/// issue 6.
void print_summary() {
  const auto& bounds = scene().mesh.bounds();
  const double megapixels = bounds.width() * bounds.height() * 1e-6;
  const double triad = bandwidth();
  ImageCorrelation correlation(scene().reference, scene().mesh, {.threads = 1});
  CorrelationResult start, last;
  const double cold = best_of(5, [&] { start = correlation.correlate(scene().before); });
  const double warm = best_of(20, [&] { last = correlation.correlate(scene().after, start.displacement); });
  const CorrelationStage stage(reference_field(scene().reference, {}, scene().mesh.bounds(), 0, 0, 1),
                               scene().mesh, {});
  SplineImage image;
  const double spline = best_of(20, [&] { image.assign(scene().after); });
  const double pass = best_of(20, [&] {
    for (std::size_t e = 0; e < scene().mesh.elements.size(); ++e)
      benchmark::DoNotOptimize(residual_sums(stage.pixels(), stage.pixels().elements()[e],
                                             stage.reference().view(), image, stage.motion(e, last)));
  });
  constexpr double k_bytes = 16;  // a pixel: value and gradient of the reference, one coefficient
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::printf("%.2f Mpx, %d nodes, one thread, processor time of the best of several runs\n", megapixels,
              correlation.mesh().node_count());
  std::printf("warm picture          %6.1f ms   (limit 60, goal 30), %d iterations\n", warm, last.iterations);
  std::printf("  per iteration, Mpx  %6.2f ms\n", warm / last.iterations / megapixels);
  std::printf("  spline coefficients %6.2f ms\n", spline);
  std::printf(
      "  pass, per Mpx       %6.2f ms   memory alone: %.2f ms at the %.1f GB/s of a triad (issue: 1.2 ms)\n",
      pass / megapixels, 1e6 * k_bytes / triad, 1e-6 * triad);
  std::printf("cold picture          %6.1f ms   (limit 300)\n", cold);
  std::printf("largest memory        %6.0f MB   (limit 150; two pictures rendered in it included)\n",
              static_cast<double>(usage.ru_maxrss) / 1024);
}

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  print_summary();
  benchmark::RunSpecifiedBenchmarks();
}
