#pragma once
/// @file A matrix that is a Kronecker product, one factor per axis of a tensor grid. Private to this room.
#include <Eigen/Core>
#include <span>

#include "knothe/base/index.hpp"
#include "knothe/model/reduced/parameter_functions.hpp"

namespace knothe::model {

/// Multiplies tensors [n₁, …, n_d] in C order, which lie one after the other in `values`, along axis i by the
/// n_i × n_i matrix `factors(i)`: ⊗_i factors(i) times each, in Σ n_i operations per entry.
template <class Factors>
void multiply_along_axes(std::span<double> values, std::size_t axes, const Factors& factors) {
  Index after = 1;  // entries between neighbours along the axis
  for (std::size_t i = axes; i-- > 0;) {
    const Eigen::MatrixXd& factor = factors(i);
    const Index n = factor.rows(), size = std::ssize(values);
    if (after == 1) {
      Eigen::Map<Eigen::MatrixXd> lines(values.data(), n, size / n);
      lines = (factor * lines).eval();
    } else {
      for (Index block = 0; block < size; block += n * after) {
        Eigen::Map<RowMatrix> part(values.data() + block, n, after);
        part = (factor * part).eval();
      }
    }
    after *= n;
  }
}

}  // namespace knothe::model
