#include "knothe/imaging/correlation/correlation_noise.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/imaging/correlation/spline_image.hpp"
#include "knothe/numerics/linear/selected_inverse.hpp"

namespace knothe::imaging {

namespace {

constexpr int k_reach = 60;  // px, where nothing is left of spline_response

/// Σ_k c_k c_{k+m}, m = 0 … 5, c = spline_response.
const std::array<double, 6>& response_correlation() {
  static const std::array<double, 6> made = [] {
    std::array<double, 6> r{};
    for (int k = -k_reach; k <= k_reach; ++k)
      for (int m = 0; m < 6; ++m) r[m] += spline_response(k) * spline_response(k + m);
    return r;
  }();
  return made;
}

}  // namespace

double interpolated_noise_variance(double t) {
  // η(t − k) = Σ_a w_a c_{a−k} with the spline's weights w, hence Σ_k η² = Σ_ab w_a w_b Σ_k c_k c_{k+b−a}.
  const auto weight = spline_weights(t - std::floor(t));
  double sum = 0;
  for (std::size_t a = 0; a < 6; ++a)
    for (std::size_t b = 0; b < 6; ++b)
      sum += weight[a] * weight[b] * response_correlation()[a < b ? b - a : a - b];
  return sum;
}

double noise_from_residual(const ImageCorrelation& correlation, const CorrelationResult& result,
                           double reference_count) {
  const ImageMesh& mesh = correlation.mesh();
  double kappa = 0, elements = 0;
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    if (result.element_valid[e] == 0) continue;
    double u = 0, v = 0;
    const int n = ImageMesh::nodes_of(mesh.elements[e]);
    for (int a = 0; a < n; ++a) {
      const int node = mesh.elements[e][a];
      u += result.displacement[2 * node] / n, v += result.displacement[2 * node + 1] / n;
    }
    kappa += interpolated_noise_variance(u) * interpolated_noise_variance(v), elements += 1;
  }
  if (elements == 0) return 0;
  const double left = 1 - 2 * mesh.node_count() / std::max(1.0, result.pixels_used);
  const double prefiltered = correlation.options().prefilter_sigma > 0
                                 ? [&] {
                                     const auto taps = gaussian_taps(correlation.options().prefilter_sigma);
                                     double sum = taps[0] * taps[0];
                                     for (Index k = 1; k < std::ssize(taps); ++k) sum += 2.0 * (taps[k] * taps[k]);
                                     return sum * sum;
                                   }()
                                 : 1.0;
  return result.residual_rms /
         std::sqrt((1 / reference_count + result.gain * result.gain * kappa / elements) *
                   std::max(0.1, left) * prefiltered);
}

double noise_from_repeat(const files::Picture& first, const files::Picture& second, const Region& region) {
  if (first.width != second.width || first.height != second.height)
    throw UsageError(fmt::format("noise from repeat pictures: they have {} × {} and {} × {} pixels",
                                 first.width, first.height, second.width, second.height));
  const int x0 = std::max<int>(0, std::ceil(region.x0)),
            x1 = std::min<int>(first.width - 1, std::floor(region.x1));
  const int y0 = std::max<int>(0, std::ceil(region.y0)),
            y1 = std::min<int>(first.height - 1, std::floor(region.y1));
  double n = 0, f = 0, g = 0, ff = 0, fg = 0, gg = 0;
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) {
      const double a = first.at(x, y), b = second.at(x, y);
      n += 1, f += a, g += b, ff += a * a, fg += a * b, gg += b * b;
    }
  if (n < 3) throw UsageError("noise from repeat pictures: the region holds no pixels");
  // Total least squares would be exact for equal noise; with a gain near 1 the difference of the standardised
  // pictures is as good.
  const double variance_f = ff / n - f * f / (n * n), variance_g = gg / n - g * g / (n * n),
               covariance = fg / n - f * g / (n * n);
  const double gain = variance_g > 0 ? std::sqrt(variance_f / variance_g) : 1;
  const double difference = variance_f + gain * gain * variance_g - 2 * gain * covariance;
  return std::sqrt(std::max(0.0, difference) / (1 + gain * gain));
}

double share_of_motion(const files::Picture& first, const files::Picture& second, const Region& region) {
  constexpr int k_square = 32;
  double all = 0, moved = 0;
  const auto level = [](const files::Picture& picture, int x, int y) -> double { return picture.at(x, y); };
  for (int top = std::max<int>(1, std::ceil(region.y0));
       top + k_square < std::min<int>(first.height, region.y1); top += k_square)
    for (int left = std::max<int>(1, std::ceil(region.x0));
         left + k_square < std::min<int>(first.width, region.x1); left += k_square) {
      // The difference by the gradient and the brightness (gain and offset), least squares.
      Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
      Eigen::Vector4d right = Eigen::Vector4d::Zero();
      double squares = 0;
      for (int y = top; y < top + k_square; ++y)
        for (int x = left; x < left + k_square; ++x) {
          // Of both pictures: a difference of one alone would be correlated with its own noise.
          const auto slope = [&](int dx, int dy) {
            return 0.25 * (level(first, x + dx, y + dy) - level(first, x - dx, y - dy) +
                           level(second, x + dx, y + dy) - level(second, x - dx, y - dy));
          };
          const double d = level(second, x, y) - level(first, x, y);
          const Eigen::Vector4d g(1, level(first, x, y) + level(second, x, y), slope(1, 0), slope(0, 1));
          normal += g * g.transpose(), right += d * g, squares += d * d;
        }
      const auto left_over = [&](Index unknowns) {
        const Eigen::VectorXd fit =
            normal.topLeftCorner(unknowns, unknowns).ldlt().solve(right.head(unknowns));
        return squares - fit.dot(right.head(unknowns));
      };
      const double at_rest = left_over(2);
      all += at_rest, moved += at_rest - left_over(4);
    }
  return all > 0 ? moved / all : 0;
}

double prefilter_noise_factor(const ReferenceRows& reference, const Region& region, double sigma) {
  if (!(sigma > 0)) return 1;
  const auto [first, end] = reference.rows;
  const int width = reference.stride, height = end - first;
  std::vector<float> smooth(reference.stride * height);
  double before = 0, after = 0;
  for (const float* slope : {reference.dx, reference.dy}) {
    filter_picture(slope, width, height, gaussian_taps(sigma), smooth.data(), reference.stride, 1);
    for (int y = std::max<int>(first, region.y0); y <= std::min<int>(end - 1, region.y1); ++y)
      for (int x = std::max<int>(0, region.x0); x <= std::min<int>(width - 1, region.x1); ++x) {
        const std::size_t i = reference.index(x, y);
        before += slope[i] * slope[i];
        after += smooth[i] * smooth[i];
      }
  }
  return before > 0 ? after / before : 1;
}

double gradient_noise_variance(double sigma) {
  // At a pixel the derivative is a filter along x, η'(k), and nothing along y; the prefilter acts along both.
  std::vector<double> smooth{1};
  if (sigma > 0) {
    const auto taps = gaussian_taps(sigma);
    smooth.clear();
    for (std::size_t k = taps.size(); k-- > 1;) smooth.push_back(taps[k]);
    for (const float tap : taps) smooth.push_back(tap);
  }
  const int radius = smooth.size() / 2, reach = radius + k_reach / 2;
  std::vector<double> slopes;
  for (int k = -reach - radius; k <= reach + radius; ++k) slopes.push_back(slope_response(k));
  double along = 0, across = 0;
  for (int k = -reach; k <= reach; ++k) {
    double sum = 0;
    for (int j = -radius; j <= radius; ++j) sum += smooth[j + radius] * slopes[k - j + reach + radius];
    along += sum * sum;
  }
  for (const double tap : smooth) across += tap * tap;
  return along * across;
}

double texture_of_noise(double gamma, double reference_count, double sigma) {
  return 2 * gamma * gamma / reference_count * gradient_noise_variance(sigma);
}

double mean_std(const Eigen::VectorXd& std) {
  const auto count = (std.array() > 0).count();
  return count > 0 ? std.sum() / count : 0;
}

namespace {

/// `of` the noise, or of next to none, for which the correction for the gradient's noise is nothing, where it
/// has no meaning.
template <class Of>
auto corrected_if_possible(double gamma, const Of& of) {
  try {
    return of(gamma);
  } catch (const NumericalError&) {
    return of(1e-6 * gamma);
  }
}

}  // namespace

Eigen::VectorXd displacement_std(const ImageCorrelation& correlation, const std::vector<char>& element_valid,
                                 double gamma, double reference_count, double gain) {
  return corrected_if_possible(gamma, [&](double noise) -> Eigen::VectorXd {
    return correlation.displacement_std(element_valid, noise, reference_count, gain) * (gamma / noise);
  });
}

DisplacementPrecision displacement_precision(const ImageCorrelation& correlation,
                                             const std::vector<char>& element_valid, double gamma,
                                             double reference_count, double gain) {
  return corrected_if_possible(gamma, [&](double noise) {
    const double ratio = gamma / noise;
    DisplacementPrecision made{
        correlation.precision(element_valid, noise, reference_count, gain),
        correlation.displacement_std(element_valid, noise, reference_count, gain) * ratio};
    made.matrix /= ratio * ratio;
    return made;
  });
}

Eigen::VectorXd displacement_std(const Eigen::SparseMatrix<double>& matrix) {
  // Nodes that no valid element touches have empty rows: they are left out of the inverse.
  std::vector<int> number(matrix.rows(), -1);
  int count = 0;
  for (int i = 0; i < matrix.rows(); ++i) {
    if (matrix.coeff(i, i) < 0) throw NumericalError("a node has less texture than noise");
    if (matrix.coeff(i, i) > 0) number[i] = count++;
  }
  std::vector<Eigen::Triplet<double>> entries;
  for (int column = 0; column < matrix.outerSize(); ++column)
    for (Eigen::SparseMatrix<double>::InnerIterator it(matrix, column); it; ++it) {
      const int i = number[it.row()], j = number[it.col()];
      if (i >= 0 && j >= 0) entries.emplace_back(i, j, it.value());
    }
  Eigen::VectorXd result = Eigen::VectorXd::Zero(matrix.rows());
  if (count == 0) return result;
  Eigen::SparseMatrix<double> active(count, count);
  active.setFromTriplets(entries.begin(), entries.end());
  const numerics::SelectedInverse inverse(active);
  for (int i = 0; i < matrix.rows(); ++i)
    if (const int at = number[i]; at >= 0) result[i] = std::sqrt(inverse.diagonal()[at]);
  return result;
}

}  // namespace knothe::imaging
