#pragma once
/// @file Tensors in separated (canonical) form as values: Σ_k ⊗_i a_i^k (Rubio et al. 2019, Eq. 12).
///
/// Sums and products are exact and add to, or multiply, the number of terms; `rounded` takes back what is not
/// needed. Source of the algebra: W. Hackbusch, Tensor Spaces and Numerical Tensor Calculus (2012), ch. 7.
#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace knothe::reduction {

/// A linear operator Σ_k ⊗_i M_i^k: `terms[k][i]` maps index i (rows: new size, columns: old size).
struct SeparatedOperator {
  std::vector<std::vector<Eigen::MatrixXd>> terms;
};

/// A tensor of any order ≥ 1; copies are independent. Two tensors that are combined must have the same shape:
/// otherwise UsageError, which tells both.
class SeparatedTensor {
 public:
  /// `factors[i]`: n_i × m, column k the i-th vector of term k. UsageError unless there is at least one
  /// factor and all have as many columns and finite entries.
  explicit SeparatedTensor(std::vector<Eigen::MatrixXd> factors);
  /// The zero tensor of this shape: no terms.
  [[nodiscard]] static SeparatedTensor zero(const std::vector<Eigen::Index>& shape);

  [[nodiscard]] std::size_t order() const { return factors_.size(); }
  [[nodiscard]] Eigen::Index terms() const { return factors_.front().cols(); }
  [[nodiscard]] std::vector<Eigen::Index> shape() const;
  [[nodiscard]] const std::vector<Eigen::MatrixXd>& factors() const { return factors_; }
  /// One entry. UsageError outside the shape.
  [[nodiscard]] double at(const std::vector<Eigen::Index>& index) const;
  /// All entries in C order (the last index fastest). For tests and small tensors.
  [[nodiscard]] Eigen::VectorXd dense() const;

  SeparatedTensor& operator+=(const SeparatedTensor& other);
  SeparatedTensor& operator-=(const SeparatedTensor& other);
  SeparatedTensor& operator*=(double factor);

  /// The same tensor with fewer terms: ‖this − result‖ ≤ tolerance ‖this‖ (Frobenius). Each index is first
  /// restricted to its dominant space (HOSVD), then a canonical form of the small core is grown term by term
  /// by alternating least squares. If that finds no shorter form the terms stay as they are. Deterministic
  /// for a `seed`. UsageError unless 0 ≤ tolerance < 1.
  [[nodiscard]] SeparatedTensor rounded(double tolerance, std::uint64_t seed = 1) const;

 private:
  std::vector<Eigen::MatrixXd> factors_;
};

[[nodiscard]] SeparatedTensor operator+(SeparatedTensor a, const SeparatedTensor& b);
[[nodiscard]] SeparatedTensor operator-(SeparatedTensor a, const SeparatedTensor& b);
[[nodiscard]] SeparatedTensor operator*(double factor, SeparatedTensor a);

/// Σ a b over all entries, without forming any of them: Σ_kl Π_i ⟨a_i^k, b_i^l⟩.
[[nodiscard]] double inner_product(const SeparatedTensor& a, const SeparatedTensor& b);
/// Frobenius norm. Terms that cancel cost half of the digits.
[[nodiscard]] double norm(const SeparatedTensor& a);
/// Product entry by entry: m_a m_b terms.
[[nodiscard]] SeparatedTensor hadamard_product(const SeparatedTensor& a, const SeparatedTensor& b);
/// The operator's image: as many terms as the product of both numbers. UsageError if the sizes do not fit.
[[nodiscard]] SeparatedTensor apply(const SeparatedOperator& op, const SeparatedTensor& a);

}  // namespace knothe::reduction
