// Time of one picture: 1 Mpx region, 1,690 nodes, warm start, and its parts.
#include <benchmark/benchmark.h>

#include <map>
#include <thread>

#include "knothe/imaging/correlation_stage.hpp"
#include "knothe/imaging/image_correlation.hpp"
#include "knothe/imaging/speckle.hpp"

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
  const CorrelationStage stage(reference_field(scene().reference, {}, 0, 0, 1), scene().mesh, {});
  const SplineImage image(scene().after);
  CorrelationResult result;
  result.displacement.setConstant(2 * scene().mesh.node_count(), 0.45);
  for (auto _ : state)
    for (std::size_t e = 0; e < scene().mesh.elements.size(); ++e)
      benchmark::DoNotOptimize(residual_sums(stage.pixels(), stage.pixels().elements()[e],
                                             stage.reference().rows(), image, stage.motion(e, result)));
}
BENCHMARK(one_pass_over_the_residual)->Unit(benchmark::kMillisecond)->Repetitions(3);

}  // namespace

BENCHMARK_MAIN();
