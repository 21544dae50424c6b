#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/imaging/correlation/correlation_stage.hpp"
#include "knothe/imaging/correlation/regularisation.hpp"
#include "knothe/numerics/statistics/order_statistics.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_rows_beside = 32;         // px of the reference that are kept above and below the mesh
constexpr double k_smallest_texture = 1e-4;  // of the median of the elements', for the weaker direction
constexpr int k_min_pixels = 9;              // of an element

/// Degrees in X and Y of the monomials 1, X, Y, XY.
constexpr std::array<std::array<int, 2>, 4> k_degrees{{{0, 0}, {1, 0}, {0, 1}, {1, 1}}};

/// Σ over the pixels of X^i Y^j times each of: fx², fx fy, fy², fx f, fy f, fx, fy, 1.
struct Moments {
  std::array<std::array<std::array<double, 8>, 3>, 3> sum{};
  double count = 0, f = 0, f_squared = 0;
};

Moments moments(const PixelTable& table, const ElementPixels& element, const ReferenceRows& field) {
  Moments m;
  using Along = std::array<std::array<double, 8>, 3>;  // Σ X^p q over pixels of one Y
  const auto add = [&m](Along& along, double y) {
    double power = 1;
    for (std::size_t j = 0; j < 3; ++j, power *= y)
      for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t c = 0; c < 8; ++c) m.sum[i][j][c] += power * along[i][c];
    along = {};
  };
  for (const auto& row : table.rows(element)) {
    Along along{};
    for (int k = 0; k < row.count; ++k) {
      const std::size_t i = field.index(row.x + k, row.y);
      if (!field.counts(i)) continue;
      const auto [x, y] = table.coordinates(element, row, k);
      const double f = field.value[i], fx = field.dx[i], fy = field.dy[i];
      const std::array<double, 8> q{fx * fx, fx * fy, fy * fy, fx * f, fy * f, fx, fy, 1};
      double power = 1;
      for (std::size_t p = 0; p < 3; ++p, power *= x)
        for (std::size_t c = 0; c < 8; ++c) along[p][c] += power * q[c];
      m.count += 1, m.f += f, m.f_squared += f * f;
      if (element.natural) add(along, y);  // Y is another at every pixel
    }
    if (!element.natural) add(along, row.y - element.y_origin);
  }
  return m;
}

}  // namespace

ReferenceField reference_field(const files::Picture& reference, const files::Picture& mask,
                               const Region& region, double prefilter_sigma, double saturation, int threads) {
  const double beside = k_rows_beside + std::ceil(4 * prefilter_sigma);  // as far as gaussian_taps reach
  ReferenceField field;
  field.width = reference.width, field.height = reference.height;
  const auto row = [&](double y) -> int { return std::clamp<double>(y, 0, field.height); };
  field.rows = {row(std::floor(region.y0) - beside), row(std::ceil(region.y1) + beside + 1)};
  field.pixels = pixel_gradients(reference, prefilter_sigma, field.rows, threads);
  const auto view = field.view();
  const auto leave_out = [&](int x, int y) {
    if (view.contains(x, y)) field.pixels.value[view.index(x, y)] = std::numeric_limits<float>::quiet_NaN();
  };
  const double limit = saturation > 0 ? saturation : reference.maximum;
  for (int y = std::max(0, field.rows.first - 1); y < std::min(field.height, field.rows.end + 1); ++y)
    for (int x = 0; x < field.width; ++x) {
      if (!mask.pixels.empty() && !(mask.at(x, y) > 0)) leave_out(x, y);
      if (reference.at(x, y) < limit) continue;
      for (int j = y - 1; j <= y + 1; ++j)
        for (int i = x - 1; i <= x + 1; ++i) leave_out(i, j);
    }
  return field;
}

void CorrelationStage::make_constants() {
  const std::size_t count = mesh_.elements.size();
  constants_.resize(count), gradient_.assign(count, 0), texture_.assign(count, 0), usable_.assign(count, 1);
  double squares = 0, pixels = 0;
  for (std::size_t e = 0; e < count; ++e) {
    const ElementPixels& element = pixels_.elements()[e];
    const Moments m = moments(pixels_, element, reference_.view());
    Constants& c = constants_[e];
    c.matrix.setZero(), c.brightness.setZero(), c.mass.setZero();
    for (int a = 0; a < 4; ++a)
      for (std::size_t p = 0; p < 4; ++p) {
        const double ca = element.coefficients[a][p];
        if (ca == 0) continue;
        const auto& one = m.sum[k_degrees[p][0]][k_degrees[p][1]];
        c.brightness(2 * a, 0) += ca * one[3], c.brightness(2 * a + 1, 0) += ca * one[4];
        c.brightness(2 * a, 1) += ca * one[5], c.brightness(2 * a + 1, 1) += ca * one[6];
        for (int b = 0; b < 4; ++b)
          for (std::size_t q = 0; q < 4; ++q) {
            const double f = ca * element.coefficients[b][q];
            if (f == 0) continue;
            const auto& s = m.sum[k_degrees[p][0] + k_degrees[q][0]][k_degrees[p][1] + k_degrees[q][1]];
            c.matrix(2 * a, 2 * b) += f * s[0], c.matrix(2 * a + 1, 2 * b + 1) += f * s[2];
            c.matrix(2 * a, 2 * b + 1) += f * s[1], c.matrix(2 * a + 1, 2 * b) += f * s[1];
            c.mass(a, b) += f * s[7];
          }
      }
    c.brightness_matrix << m.f_squared, m.f, m.f, m.count;
    const auto& g = m.sum[0][0];
    squares += g[0] + g[2], pixels += m.count;
    if (m.count < std::max<double>(k_min_pixels, k_min_pixel_share * element.pixel_count)) {
      usable_[e] = 0;
      continue;
    }
    gradient_[e] = std::sqrt((g[0] + g[2]) / m.count);
    Eigen::Matrix2d texture;
    texture << g[0], g[1], g[1], g[2];
    texture_[e] = texture.selfadjointView<Eigen::Lower>().eigenvalues()[0] / m.count;
  }
  const double usual = numerics::upper_median(texture_);
  const std::size_t hidden = std::count(usable_.begin(), usable_.end(), 0);
  // Where most elements show noise alone, that is for whoever judges the pattern to say.
  const auto is_noise = [&](double texture) { return !(texture > options_.least_texture); };
  const bool by_noise = 2 * std::count_if(texture_.begin(), texture_.end(), is_noise) <= std::ssize(texture_);
  const double least = std::max(k_smallest_texture * usual, by_noise ? options_.least_texture : 0.0);
  std::size_t without = 0, example = 0;
  for (std::size_t e = 0; e < count; ++e)
    if (!(texture_[e] > least) || !(usual > 1e-12)) usable_[e] = 0, ++without, example = e;
  if (2 * without > count) {
    const ElementPixels& element = pixels_.elements()[example];
    if (2 * hidden > count)
      throw UsageError(fmt::format(
          "{} of {} elements have hardly a pixel that can be used: pixels at the highest grey level, and "
          "their neighbours, count as saturated; where white belongs to the pattern set another level "
          "(--saturation, dic.saturation), else less light; or see the mask",
          hidden, count));
    throw UsageError(
        fmt::format("{} of {} elements have no texture (or are masked or saturated), e.g. the one around "
                    "pixel ({:.0f}, {:.0f}): image correlation needs a speckle with several dots per "
                    "element; look at the picture, choose larger elements or another region",
                    without, count, element.x_origin, element.y_origin));
  }
  if (options_.regularisation > 0) {
    const double cut_off = options_.regularisation / (2 * std::numbers::pi);
    const double power = options_.regularisation_kind == DisplacementRegularisation::tikhonov ? 2 : 4;
    penalty_ = squares / std::max(1.0, pixels) * 0.5 * std::pow(cut_off, power);
  }
}

Eigen::SparseMatrix<double> CorrelationStage::penalty(const std::vector<char>& valid) const {
  const Index dofs = 2 * mesh_.node_count();
  if (!(penalty_ > 0)) return {dofs, dofs};
  if (options_.regularisation_kind == DisplacementRegularisation::tikhonov)
    return penalty_ * gradient_penalty(mesh_);
  // Where there is no texture the penalty stands in for it; what was taken out is a crack, as a rule.
  std::vector<char> carries = valid;
  for (Index e = 0; e < std::ssize(carries); ++e)
    if (usable_[e] == 0) carries[e] = 1;
  return penalty_ * equilibrium_gap_penalty(mesh_, carries, options_.poisson_ratio);
}

double CorrelationStage::contrast() const {
  double squares = 0, count = 0;
  for (Index e = 0; e < std::ssize(constants_); ++e) {
    const Eigen::Matrix2d& m = constants_[e].brightness_matrix;  // Σ (f, 1)(f, 1)ᵀ
    if (usable_[e] == 0 || !(m(1, 1) > 0)) continue;
    squares += m(0, 0) - m(0, 1) * m(0, 1) / m(1, 1), count += m(1, 1);
  }
  return count > 0 ? std::sqrt(std::max(0.0, squares) / count) : 0;
}

}  // namespace knothe::imaging
