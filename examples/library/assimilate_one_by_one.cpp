// Assimilates data one by one with a reduced model of two parameters. Run: assimilate_one_by_one MODEL.h5
#include <cmath>
#include <cstdio>
#include <knothe/knothe.hpp>

int main(int, char** arguments) {
  knothe::Sensors sensors;  // the vertical displacement at nine points of a face
  for (int i = 0; i < 9; ++i) {
    sensors.points.insert(sensors.points.end(), {0.03 * i - 0.12, 0.05, 0.05});
    sensors.components.push_back(1);
  }
  const knothe::Noise noise{.std = std::vector<double>(sensors.size(), 2e-6)};
  knothe::Assimilation beam(arguments[1], sensors, noise,
                            {knothe::Prior::normal("Y0", 0.9, 0.45), knothe::Prior::normal("Ad", 1.1, 0.45)});

  for (std::size_t step = 0; step < beam.times().size(); ++step) {
    std::vector<double> measured = beam.predict(std::vector{1.05, 0.9}, step);  // here from the model itself,
    for (std::size_t i = 0; i < 9; ++i)
      measured[i] += 2e-6 * std::sin(double(7 * i + 3 * step));  // with errors
    const knothe::Posterior posterior = beam.assimilate({step, measured});
    std::printf("%zu %.4f %.4f %.4f %.4f %s\n", step, posterior.mean[0], posterior.std(0), posterior.mean[1],
                posterior.std(1), posterior.trusted ? "trusted" : posterior.remark.c_str());
  }
}
