#include "knothe/imaging/correlation_stage.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "knothe/base/error.hpp"
#include "knothe/base/threads.hpp"

namespace knothe::imaging {

namespace {

constexpr std::size_t k_padding = 16;        // floats that a vector may read beyond the last pixel
constexpr double k_smallest_texture = 1e-4;  // of the median of the elements', for the weaker direction
constexpr int k_fewest_pixels = 9;           // of an element
constexpr double k_least_share = 0.5;        // of an element's pixels that must count
constexpr int k_rejection_rounds = 8;
constexpr double k_share_of_worst =
    0.8;  // of the residual of the worst neighbour, to be taken out in the same round
constexpr int k_iterations_per_round = 12;  // elements on a crack may swing for ever: look at them in between

/// Degrees in X and Y of the monomials 1, X, Y, XY.
constexpr std::array<std::array<int, 2>, 4> k_degrees{{{0, 0}, {1, 0}, {0, 1}, {1, 1}}};

/// Σ over the pixels of X^i Y^j times each of: fx², fx fy, fy², fx f, fy f, fx, fy, 1.
struct Moments {
  std::array<std::array<std::array<double, 8>, 3>, 3> sum{};
  double count = 0, f = 0, f_squared = 0;
};

Moments moments(const PixelTable& table, const ElementPixels& element, const ReferenceField& field) {
  Moments m;
  for (const auto& row : table.rows(element)) {
    const double y = row.y - element.y_origin;
    std::array<std::array<double, 8>, 3> along{};
    for (int k = 0; k < row.count; ++k) {
      const std::size_t i = static_cast<std::size_t>(row.y) * static_cast<std::size_t>(field.width) +
                            static_cast<std::size_t>(row.x + k);
      if (!(field.use[i] > 0)) continue;
      const double x = row.x + k - element.x_origin, f = static_cast<double>(field.value[i]),
                   fx = static_cast<double>(field.dx[i]), fy = static_cast<double>(field.dy[i]);
      const std::array<double, 8> q{fx * fx, fx * fy, fy * fy, fx * f, fy * f, fx, fy, 1};
      double power = 1;
      for (std::size_t p = 0; p < 3; ++p, power *= x)
        for (std::size_t c = 0; c < 8; ++c) along[p][c] += power * q[c];
      m.count += 1, m.f += f, m.f_squared += f * f;
    }
    double power = 1;
    for (std::size_t j = 0; j < 3; ++j, power *= y)
      for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t c = 0; c < 8; ++c) m.sum[i][j][c] += power * along[i][c];
  }
  return m;
}

/// ∫ ∇N_a·∇N_b over an element by the 2 × 2 Gauss rule (rectangles) or its constant value (triangles).
Eigen::Matrix4d laplacian_of(const ImageMesh& mesh, const std::array<int, 4>& nodes,
                             const ElementPixels& element) {
  Eigen::Matrix4d result = Eigen::Matrix4d::Zero();
  const int n = ImageMesh::nodes_of(nodes);
  const auto x = [&](int a) {
    return mesh.x[static_cast<std::size_t>(nodes[static_cast<std::size_t>(a)])] - element.x_origin;
  };
  const auto y = [&](int a) {
    return mesh.y[static_cast<std::size_t>(nodes[static_cast<std::size_t>(a)])] - element.y_origin;
  };
  double area = 0, x0 = x(0), x1 = x(0), y0 = y(0), y1 = y(0);
  for (int a = 0; a < n; ++a) {
    area += 0.5 * (x(a) * y((a + 1) % n) - x((a + 1) % n) * y(a));
    x0 = std::min(x0, x(a)), x1 = std::max(x1, x(a)), y0 = std::min(y0, y(a)), y1 = std::max(y1, y(a));
  }
  for (const double s : {-1.0, 1.0})
    for (const double t : {-1.0, 1.0}) {
      const double px = 0.5 * (x0 + x1) + s * 0.5 * (x1 - x0) / std::numbers::sqrt3,
                   py = 0.5 * (y0 + y1) + t * 0.5 * (y1 - y0) / std::numbers::sqrt3;
      for (int a = 0; a < n; ++a)
        for (int b = 0; b < n; ++b) {
          const auto &ca = element.coefficients[static_cast<std::size_t>(a)],
                     &cb = element.coefficients[static_cast<std::size_t>(b)];
          result(a, b) +=
              std::abs(area) / 4 *
              ((ca[1] + ca[3] * py) * (cb[1] + cb[3] * py) + (ca[2] + ca[3] * px) * (cb[2] + cb[3] * px));
        }
    }
  return result;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

ReferenceField reference_field(const files::Picture& reference, const files::Picture& mask,
                               double prefilter_sigma, double saturation, int threads) {
  ReferenceField field;
  field.width = reference.width, field.height = reference.height;
  SplineImage(reference, prefilter_sigma, threads).at_pixels(field.value, field.dx, field.dy);
  field.use.assign(reference.pixels.size(), 1.0F);
  const double limit = saturation > 0 ? saturation : static_cast<double>(reference.maximum);
  for (int y = 0; y < reference.height; ++y)
    for (int x = 0; x < reference.width; ++x) {
      if (static_cast<double>(reference.at(x, y)) < limit) continue;
      for (int j = std::max(0, y - 1); j <= std::min(reference.height - 1, y + 1); ++j)
        for (int i = std::max(0, x - 1); i <= std::min(reference.width - 1, x + 1); ++i)
          field.use[reference.index(i, j)] = 0;
    }
  if (!mask.pixels.empty())
    for (std::size_t i = 0; i < field.use.size(); ++i)
      if (!(mask.pixels[i] > 0)) field.use[i] = 0;
  for (auto* values : {&field.value, &field.dx, &field.dy, &field.use})
    values->resize(reference.pixels.size() + k_padding, 0.0F);
  return field;
}

CorrelationStage::CorrelationStage(ReferenceField reference, ImageMesh mesh,
                                   const CorrelationOptions& options)
    : reference_(std::move(reference)),
      mesh_(std::move(mesh)),
      pixels_(mesh_, reference_.width, reference_.height),
      options_(options) {
  make_constants();
  sums_.resize(mesh_.elements.size());
  element_brightness_.assign(mesh_.elements.size(), {1.0F, 0.0F});
}

void CorrelationStage::make_constants() {
  const std::size_t count = mesh_.elements.size();
  constants_.resize(count), gradient_.assign(count, 0), usable_.assign(count, 1);
  std::vector<double> weakest(count, 0);
  double squares = 0, pixels = 0;
  for (std::size_t e = 0; e < count; ++e) {
    const ElementPixels& element = pixels_.elements()[e];
    const Moments m = moments(pixels_, element, reference_);
    Constants& c = constants_[e];
    c.matrix.setZero(), c.brightness.setZero(), c.mass.setZero();
    for (int a = 0; a < 4; ++a)
      for (std::size_t p = 0; p < 4; ++p) {
        const double ca = element.coefficients[static_cast<std::size_t>(a)][p];
        if (ca == 0) continue;
        const auto& one =
            m.sum[static_cast<std::size_t>(k_degrees[p][0])][static_cast<std::size_t>(k_degrees[p][1])];
        c.brightness(2 * a, 0) += ca * one[3], c.brightness(2 * a + 1, 0) += ca * one[4];
        c.brightness(2 * a, 1) += ca * one[5], c.brightness(2 * a + 1, 1) += ca * one[6];
        for (int b = 0; b < 4; ++b)
          for (std::size_t q = 0; q < 4; ++q) {
            const double f = ca * element.coefficients[static_cast<std::size_t>(b)][q];
            if (f == 0) continue;
            const auto& s = m.sum[static_cast<std::size_t>(k_degrees[p][0] + k_degrees[q][0])]
                                 [static_cast<std::size_t>(k_degrees[p][1] + k_degrees[q][1])];
            c.matrix(2 * a, 2 * b) += f * s[0], c.matrix(2 * a + 1, 2 * b + 1) += f * s[2];
            c.matrix(2 * a, 2 * b + 1) += f * s[1], c.matrix(2 * a + 1, 2 * b) += f * s[1];
            c.mass(a, b) += f * s[7];
          }
      }
    c.brightness_matrix << m.f_squared, m.f, m.f, m.count;
    c.laplacian = laplacian_of(mesh_, mesh_.elements[e], element);
    const auto& g = m.sum[0][0];
    squares += g[0] + g[2], pixels += m.count;
    if (m.count < std::max<double>(k_fewest_pixels, k_least_share * element.pixel_count)) {
      usable_[e] = 0;
      continue;
    }
    gradient_[e] = std::sqrt((g[0] + g[2]) / m.count);
    Eigen::Matrix2d texture;
    texture << g[0], g[1], g[1], g[2];
    weakest[e] = texture.selfadjointView<Eigen::Lower>().eigenvalues()[0] / m.count;
  }
  const double usual = median(weakest);
  std::size_t without = 0, example = 0;
  for (std::size_t e = 0; e < count; ++e)
    if (!(weakest[e] > k_smallest_texture * usual) || !(usual > 1e-12))
      usable_[e] = 0, ++without, example = e;
  if (2 * without > count) {
    const ElementPixels& element = pixels_.elements()[example];
    throw UsageError(
        fmt::format("{} of {} elements have no texture (or are masked or saturated), e.g. the one around "
                    "pixel ({:.0f}, {:.0f}): image "
                    "correlation needs a speckle with several dots per element; look at the picture, choose "
                    "larger elements or another region",
                    without, count, element.x_origin, element.y_origin));
  }
  if (options_.regularisation > 0) {
    const double cut_off = options_.regularisation / (2 * std::numbers::pi);
    penalty_ = squares / std::max(1.0, pixels) * 0.5 * cut_off * cut_off;
  }
}

Eigen::SparseMatrix<double> CorrelationStage::assemble(const std::vector<char>& valid, bool for_solving,
                                                       double mass) const {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(64 * mesh_.elements.size() + mesh_.x.size());
  std::vector<char> touched(mesh_.x.size(), 0);
  for (std::size_t e = 0; e < mesh_.elements.size(); ++e) {
    const bool is_valid = valid[e] != 0;
    if (!is_valid && !(for_solving && penalty_ > 0)) continue;
    const auto& nodes = mesh_.elements[e];
    const Constants& c = constants_[e];
    Eigen::Matrix<double, 8, 8> matrix = Eigen::Matrix<double, 8, 8>::Zero();
    if (is_valid) matrix = c.matrix;
    if (is_valid && for_solving && per_element())
      matrix -= c.brightness * c.brightness_matrix.inverse() * c.brightness.transpose();
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < 4; ++b)
        for (int i = 0; i < 2; ++i)
          matrix(2 * a + i, 2 * b + i) +=
              (for_solving ? penalty_ * c.laplacian(a, b) : 0) + mass * c.mass(a, b);
    for (int a = 0; a < ImageMesh::nodes_of(nodes); ++a) {
      touched[static_cast<std::size_t>(nodes[static_cast<std::size_t>(a)])] = 1;
      for (int b = 0; b < ImageMesh::nodes_of(nodes); ++b)
        for (int i = 0; i < 2; ++i)
          for (int j = 0; j < 2; ++j)
            entries.emplace_back(2 * nodes[static_cast<std::size_t>(a)] + i,
                                 2 * nodes[static_cast<std::size_t>(b)] + j, matrix(2 * a + i, 2 * b + j));
    }
  }
  if (for_solving)
    for (int n = 0; n < mesh_.node_count(); ++n)
      if (touched[static_cast<std::size_t>(n)] == 0)
        entries.emplace_back(2 * n, 2 * n, 1.0), entries.emplace_back(2 * n + 1, 2 * n + 1, 1.0);
  Eigen::SparseMatrix<double> result(2 * mesh_.node_count(), 2 * mesh_.node_count());
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

Eigen::SparseMatrix<double> CorrelationStage::matrix(const std::vector<char>& valid, double mass) const {
  return assemble(valid, false, mass);
}

void CorrelationStage::factorise(const std::vector<char>& valid) {
  if (factorised_for_ == valid) return;
  Eigen::SparseMatrix<double> matrix = assemble(valid, true, 0);
  solver_.compute(matrix);
  if (solver_.info() != Eigen::Success) {  // a node held by too little texture
    const double shift = 1e-9 * matrix.diagonal().maxCoeff();
    for (int i = 0; i < matrix.rows(); ++i) matrix.coeffRef(i, i) += shift;
    solver_.compute(matrix);
    if (solver_.info() != Eigen::Success)
      throw NumericalError(
          "image correlation: the matrix of the mesh is singular; choose larger elements, or regularisation");
  }
  factorised_for_ = valid;
  if (options_.brightness != Brightness::global) return;
  coupling_.setZero(2 * mesh_.node_count(), 2);
  Eigen::Matrix2d brightness = Eigen::Matrix2d::Zero();
  for (std::size_t e = 0; e < mesh_.elements.size(); ++e) {
    if (valid[e] == 0) continue;
    brightness += constants_[e].brightness_matrix;
    for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a)
      coupling_.middleRows(2 * mesh_.elements[e][static_cast<std::size_t>(a)], 2) +=
          constants_[e].brightness.middleRows(2 * a, 2);
  }
  solved_coupling_ = solver_.solve(coupling_);
  brightness_schur_ = brightness - coupling_.transpose() * solved_coupling_;
}

ElementMotion CorrelationStage::motion(std::size_t e, const CorrelationResult& result) const {
  const auto& nodes = mesh_.elements[e];
  const auto& coefficients = pixels_.elements()[e].coefficients;
  ElementMotion m;
  for (std::size_t a = 0; a < static_cast<std::size_t>(ImageMesh::nodes_of(nodes)); ++a)
    for (std::size_t k = 0; k < 4; ++k) {
      m.u[k] += coefficients[a][k] * result.displacement[2 * nodes[a]];
      m.v[k] += coefficients[a][k] * result.displacement[2 * nodes[a] + 1];
    }
  m.gain = per_element() ? element_brightness_[e][0] : static_cast<float>(result.gain);
  m.offset = per_element() ? element_brightness_[e][1] : static_cast<float>(result.offset);
  return m;
}

void CorrelationStage::sum_residuals(const SplineImage& deformed, const CorrelationResult& result) {
  constexpr std::size_t k_chunk = 32;  // elements per task
  const std::size_t count = mesh_.elements.size();
  parallel_for((count + k_chunk - 1) / k_chunk, static_cast<std::size_t>(options_.threads),
               [&](std::size_t chunk) {
                 for (std::size_t e = chunk * k_chunk; e < std::min(count, (chunk + 1) * k_chunk); ++e)
                   sums_[e] = usable_[e] != 0 ? residual_sums(pixels_, pixels_.elements()[e],
                                                              reference_.rows(), deformed, motion(e, result))
                                              : ResidualSums{};
               });
}

double CorrelationStage::step(CorrelationResult& result) {
  right_.setZero(2 * mesh_.node_count());
  Eigen::Vector2d brightness = Eigen::Vector2d::Zero();
  const auto element_right = [&](std::size_t e) {
    Eigen::Matrix<double, 8, 1> b;
    const auto& c = pixels_.elements()[e].coefficients;
    for (int a = 0; a < 4; ++a) {
      b[2 * a] = b[2 * a + 1] = 0;
      for (std::size_t m = 0; m < 4; ++m) {
        b[2 * a] += c[static_cast<std::size_t>(a)][m] * sums_[e].x[m];
        b[2 * a + 1] += c[static_cast<std::size_t>(a)][m] * sums_[e].y[m];
      }
    }
    return b;
  };
  for (std::size_t e = 0; e < mesh_.elements.size(); ++e) {
    const bool is_valid = result.element_valid[e] != 0;
    const auto& nodes = mesh_.elements[e];
    Eigen::Matrix<double, 8, 1> b = Eigen::Matrix<double, 8, 1>::Zero();
    if (is_valid) {
      b = element_right(e);
      const Eigen::Vector2d s(sums_[e].r_reference, sums_[e].r);
      brightness += s;
      if (per_element()) b -= constants_[e].brightness * (constants_[e].brightness_matrix.inverse() * s);
    }
    for (int a = 0; a < ImageMesh::nodes_of(nodes); ++a) {
      const int node = nodes[static_cast<std::size_t>(a)];
      right_.segment<2>(2 * node) += b.segment<2>(2 * a);
      if (penalty_ > 0)
        for (int c = 0; c < ImageMesh::nodes_of(nodes); ++c)
          right_.segment<2>(2 * node) -=
              penalty_ * constants_[e].laplacian(a, c) *
              result.displacement.segment<2>(2 * nodes[static_cast<std::size_t>(c)]);
    }
  }
  step_ = solver_.solve(right_);
  const auto add = [](double change_f, double change_1, double& gain, double& offset) {
    gain += gain * change_f, offset += change_1 + offset * change_f;
  };
  if (options_.brightness == Brightness::global) {
    const Eigen::Vector2d change = brightness_schur_.inverse() * (brightness - coupling_.transpose() * step_);
    step_ -= solved_coupling_ * change;
    add(change[0], change[1], result.gain, result.offset);
  } else if (per_element()) {
    for (std::size_t e = 0; e < mesh_.elements.size(); ++e) {
      if (result.element_valid[e] == 0) continue;
      Eigen::Matrix<double, 8, 1> du = Eigen::Matrix<double, 8, 1>::Zero();
      for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a)
        du.segment<2>(2 * a) = step_.segment<2>(2 * mesh_.elements[e][static_cast<std::size_t>(a)]);
      const Eigen::Vector2d change =
          constants_[e].brightness_matrix.inverse() *
          (Eigen::Vector2d(sums_[e].r_reference, sums_[e].r) - constants_[e].brightness.transpose() * du);
      double gain = static_cast<double>(element_brightness_[e][0]),
             offset = static_cast<double>(element_brightness_[e][1]);
      add(change[0], change[1], gain, offset);
      element_brightness_[e] = {static_cast<float>(gain), static_cast<float>(offset)};
    }
  }
  result.displacement += step_;
  return step_.cwiseAbs().maxCoeff();
}

void CorrelationStage::iterate(const SplineImage& deformed, CorrelationResult& result) {
  factorise(result.element_valid);
  result.converged = false;
  const double far = 2.0 * (reference_.width + reference_.height);
  for (int k = 0;
       k < k_iterations_per_round && result.iterations < options_.max_iterations && !result.converged; ++k) {
    sum_residuals(deformed, result);
    result.last_step = step(result);
    ++result.iterations;
    if (!std::isfinite(result.last_step) || result.displacement.cwiseAbs().maxCoeff() > far) {
      result.displacement.setZero();
      result.message =
          "the iteration diverged: the pictures do not show the same surface, or moved too far between them";
      return;
    }
    result.converged = result.last_step < options_.tolerance;
  }
  sum_residuals(deformed, result);
  result.message.clear();
  if (!result.converged)
    result.message = fmt::format(
        "after {} iterations displacements still change by {:.2g} px, more than the tolerance of {:.2g} px",
        result.iterations, result.last_step, options_.tolerance);
}

int CorrelationStage::reject(CorrelationResult& result) const {
  std::vector<double> rms(sums_.size(), 0), valid, around(mesh_.x.size(), 0);
  for (std::size_t e = 0; e < sums_.size(); ++e) {
    if (result.element_valid[e] == 0 || !(sums_[e].count > 0)) continue;
    rms[e] = std::sqrt(sums_[e].r_squared / sums_[e].count);
    valid.push_back(rms[e]);
    for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a) {
      double& largest = around[static_cast<std::size_t>(mesh_.elements[e][static_cast<std::size_t>(a)])];
      largest = std::max(largest, rms[e]);
    }
  }
  const double limit = options_.rejection_factor * median(valid);
  int rejected = 0;
  for (std::size_t e = 0; e < sums_.size(); ++e) {
    if (result.element_valid[e] == 0) continue;
    // An element on a crack pulls at the nodes of its neighbours: only the worst go at once, the others get
    // another chance.
    double worst_neighbour = 0;
    for (int a = 0; a < ImageMesh::nodes_of(mesh_.elements[e]); ++a)
      worst_neighbour = std::max(
          worst_neighbour, around[static_cast<std::size_t>(mesh_.elements[e][static_cast<std::size_t>(a)])]);
    const bool unseen = sums_[e].count < k_least_share * pixels_.elements()[e].pixel_count;
    const bool bad =
        options_.reject_elements && rms[e] > limit && rms[e] > k_share_of_worst * worst_neighbour;
    if (unseen || bad) result.element_valid[e] = 0, ++rejected;
  }
  return rejected;
}

void CorrelationStage::correlate(const SplineImage& deformed, CorrelationResult& result) {
  result.element_valid = usable_;
  result.iterations = 0;
  result.message.clear();
  std::fill(element_brightness_.begin(), element_brightness_.end(),
            std::array<float, 2>{static_cast<float>(result.gain), static_cast<float>(result.offset)});
  for (int round = 0;; ++round) {
    iterate(deformed, result);
    if (!std::isfinite(result.last_step) || result.displacement.isZero(0)) break;  // diverged
    const bool rejected = round < k_rejection_rounds && reject(result) > 0;
    if (std::count(result.element_valid.begin(), result.element_valid.end(), 1) == 0) {
      result.message = "no element is left: the deformed picture does not show the surface of the reference";
      result.converged = false;
      break;
    }
    if (!rejected && (result.converged || result.iterations >= options_.max_iterations)) break;
  }
  result.elements_rejected =
      static_cast<int>(std::count(result.element_valid.begin(), result.element_valid.end(), 0));
  result.element_residual.assign(sums_.size(), 0);
  double squares = 0, pixels = 0;
  for (std::size_t e = 0; e < sums_.size(); ++e) {
    if (sums_[e].count > 0) result.element_residual[e] = std::sqrt(sums_[e].r_squared / sums_[e].count);
    if (result.element_valid[e] != 0) squares += sums_[e].r_squared, pixels += sums_[e].count;
  }
  result.pixels_used = pixels;
  result.residual_rms = pixels > 0 ? std::sqrt(squares / pixels) : 0;
}

}  // namespace knothe::imaging
