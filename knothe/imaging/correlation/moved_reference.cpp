#include "knothe/imaging/correlation/moved_reference.hpp"

#include <algorithm>
#include <cmath>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/imaging/correlation/correlation_noise.hpp"

namespace knothe::imaging {

namespace {

constexpr double k_min_area = 9;  // px² of an element

}  // namespace

MovedReference::MovedReference(const files::Picture& picture, const ImageMesh& mesh,
                               const CorrelationResult& base, Eigen::VectorXd base_std,
                               const CorrelationOptions& options)
    : base_(base.displacement),
      base_unregularised_(base.unregularised.size() > 0 ? base.unregularised : base.displacement),
      base_std_(std::move(base_std)),
      elements_(mesh.elements.size()) {
  ImageMesh whole = mesh, moved;
  for (Index a = 0; a < std::ssize(mesh.x); ++a) {
    const Index dof = 2 * a;
    whole.x[a] += base_[dof], whole.y[a] += base_[dof + 1];
  }
  std::vector<int> number(mesh.x.size(), -1);
  for (Index e = 0; e < std::ssize(mesh.elements); ++e) {
    const auto& nodes = mesh.elements[e];
    const std::size_t n = ImageMesh::nodes_of(nodes);
    const bool inside = std::all_of(nodes.begin(), nodes.begin() + n, [&](int node) {
      const std::size_t i = node;
      return whole.x[i] >= 0 && whole.y[i] >= 0 && whole.x[i] <= picture.width - 1 &&
             whole.y[i] <= picture.height - 1;
    });
    if (base.element_valid[e] == 0 || !inside) continue;
    const auto shape = whole.shape_functions(nodes, 0, 0);
    if (!shape.is_valid() || shape.area() < k_min_area) continue;
    std::array<int, 4> mine{-1, -1, -1, -1};
    for (std::size_t a = 0; a < n; ++a) {
      const std::size_t i = nodes[a];
      if (number[i] < 0) {
        number[i] = moved.node_count();
        moved.x.push_back(whole.x[i]), moved.y.push_back(whole.y[i]), node_.push_back(nodes[a]);
      }
      mine[a] = number[i];
    }
    moved.elements.push_back(mine), element_.push_back(e);
  }
  if (moved.elements.empty()) throw UsageError("no element is left for another reference picture");
  correlation_ = std::make_unique<ImageCorrelation>(picture, std::move(moved), options);
}

CorrelationResult MovedReference::correlate(const files::Picture& deformed, const Eigen::VectorXd& start) {
  Eigen::VectorXd own;
  if (start.size() != 0) {
    own.resize(2 * std::ssize(node_));
    for (Index a = 0; a < std::ssize(node_); ++a)
      own.segment<2>(2 * a) = start.segment<2>(2 * node_[a]) - base_.segment<2>(2 * node_[a]);
  }
  last_ =
      correlation_->correlate(deformed, own, start.size() != 0 ? last_.element_valid : std::vector<char>{});
  CorrelationResult result = last_;
  result.displacement = base_;
  if (last_.unregularised.size() > 0) result.unregularised = base_unregularised_;
  for (Index a = 0; a < std::ssize(node_); ++a) {
    const Index mine = 2 * a;
    result.displacement.segment<2>(2 * node_[a]) += last_.displacement.segment<2>(mine);
    if (last_.unregularised.size() > 0)
      result.unregularised.segment<2>(2 * node_[a]) += last_.unregularised.segment<2>(mine);
  }
  result.element_valid.assign(elements_, 0);
  result.element_residual.assign(elements_, 0);
  for (Index e = 0; e < std::ssize(element_); ++e) {
    result.element_valid[element_[e]] = last_.element_valid[e];
    result.element_residual[element_[e]] = last_.element_residual[e];
  }
  result.elements_rejected = std::count(result.element_valid.begin(), result.element_valid.end(), 0);
  return result;
}

double MovedReference::noise() const {
  return noise_from_residual(*correlation_, last_);
}

MovedReference::Noise MovedReference::noise_of_last(double gamma) const {
  Noise noise;
  const auto [own, own_std] =
      displacement_precision(*correlation_, last_.element_valid, gamma, 1, last_.gain);
  const auto dof = [this](Index i) -> int { return 2 * node_[i / 2] + i % 2; };
  std::vector<Eigen::Triplet<double>> entries;
  for (int column = 0; column < own.outerSize(); ++column)
    for (Eigen::SparseMatrix<double>::InnerIterator it(own, column); it; ++it)
      entries.emplace_back(dof(it.row()), dof(it.col()), it.value());
  noise.increment.resize(base_.size(), base_.size());
  noise.increment.setFromTriplets(entries.begin(), entries.end());
  noise.increment_std.setZero(base_.size());
  noise.std.setZero(base_.size());
  for (Index i = 0; i < own_std.size(); ++i) {
    if (!(own_std[i] > 0)) continue;
    noise.increment_std[dof(i)] = own_std[i];
    noise.std[dof(i)] = std::hypot(own_std[i], base_std_[dof(i)]);
  }
  return noise;
}

}  // namespace knothe::imaging
