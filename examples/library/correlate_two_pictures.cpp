// Correlates two pictures of a speckled surface. Run: correlate_two_pictures REFERENCE.tif DEFORMED.tif
#include <cstdio>
#include <knothe/knothe.hpp>

int main(int, char** arguments) {
  knothe::Correlation correlation(knothe::read_grey_picture(arguments[1]), {.element_size = 24});
  const knothe::Displacements moved = correlation.correlate(knothe::read_grey_picture(arguments[2]));
  if (!moved.converged) return std::fprintf(stderr, "%s\n", moved.message.c_str()), 1;

  const std::vector<double> x = correlation.node_x(), y = correlation.node_y();
  for (std::size_t a = 0; a < x.size(); ++a)
    std::printf("%.1f %.1f  %.4f +- %.4f  %.4f +- %.4f\n", x[a], y[a], moved.u[a], moved.std_u[a], moved.v[a],
                moved.std_v[a]);
}
