#pragma once
/// @file One mesh on one reference picture: matrices, and Gauss–Newton on a deformed picture. Private to the
/// room; ImageCorrelation has one for the measurement and some on coarse pictures for its start.
#include <Eigen/SparseCholesky>
#include <array>
#include <optional>
#include <vector>

#include "knothe/imaging/correlation/affine_motion.hpp"
#include "knothe/imaging/correlation/image_correlation.hpp"
#include "knothe/imaging/correlation/residual_kernel.hpp"

namespace knothe::imaging {

/// The reference picture where it is looked at, and its gradient; values that do not count are NaN.
struct ReferenceField {
  PixelGradients pixels;
  PixelRows rows;
  int width = 0, height = 0;  ///< of the picture
  [[nodiscard]] ReferenceRows view() const {
    return {pixels.value.data(), pixels.dx.data(), pixels.dy.data(), static_cast<std::size_t>(width), rows};
  }
};
/// The rows of `region` and those near it, where the side of a crack or a filter may reach. `mask` may be
/// empty. Pixels at or above `saturation` and their neighbours (which the interpolation mixes with them) do
/// not count.
[[nodiscard]] ReferenceField reference_field(const files::Picture& reference, const files::Picture& mask,
                                             const Region& region, double prefilter_sigma, double saturation,
                                             int threads);

/// Share of an element's pixels that must be seen and not masked.
inline constexpr double k_min_pixel_share = 0.5;

/// Elements on a crack may swing for ever: they are looked at after so many iterations.
inline constexpr int k_iterations_per_round = 12;

class CorrelationStage {
 public:
  CorrelationStage(ReferenceField reference, ImageMesh mesh, const CorrelationOptions& options);

  [[nodiscard]] const ImageMesh& mesh() const { return mesh_; }
  [[nodiscard]] const PixelTable& pixels() const { return pixels_; }
  [[nodiscard]] const ReferenceField& reference() const { return reference_; }
  [[nodiscard]] const std::vector<double>& element_gradient() const { return gradient_; }
  /// Mean square of the gradient in its weaker direction, of each element.
  [[nodiscard]] const std::vector<double>& element_texture() const { return texture_; }
  /// Elements with texture.
  [[nodiscard]] const std::vector<char>& usable() const { return usable_; }
  /// M of the elements that are valid, plus `mass` times Σ N Nᵀ over their pixels.
  [[nodiscard]] Eigen::SparseMatrix<double> matrix(const std::vector<char>& valid, double mass = 0) const;

  /// Gauss–Newton from result.displacement, gain and offset on, with the elements that result.element_valid
  /// begins with (empty: all usable); rejects and readmits elements as the options say. Fills the result.
  /// False, at once, where the start leaves a residual of more than `far` times the contrast (0: of
  /// anything).
  bool correlate(const SplineImage& deformed, CorrelationResult& result, double far = 0);
  /// The elements that the deformed picture shows at the displacement for which `misfit` was asked last.
  [[nodiscard]] std::vector<char> seen() const;
  /// Mean square of the residual over the elements that are valid in a result (all usable where it does not
  /// say) at its displacement; infinity where nothing is seen.
  [[nodiscard]] double misfit(const SplineImage& deformed, const CorrelationResult& result);
  /// R of the regularisation with its weight, both triangles; empty without one.
  [[nodiscard]] Eigen::SparseMatrix<double> penalty(const std::vector<char>& valid) const;
  /// Fills result.unregularised if there is a regularisation.
  void remove_regularisation(const SplineImage& deformed, CorrelationResult& result);
  /// Root mean square of f about its mean, element by element: what a residual of nothing explained is.
  [[nodiscard]] double contrast() const;
  /// α and β where they are per element, as of the last call.
  [[nodiscard]] ElementMotion motion(std::size_t element, const CorrelationResult& result) const;

 private:
  /// What does not change with the deformed picture, per element.
  struct Constants {
    Eigen::Matrix<double, 8, 8> matrix;      ///< Σ (N ∇f)(N ∇f)ᵀ
    Eigen::Matrix<double, 8, 2> brightness;  ///< Σ (N ∇f) (f, 1)
    Eigen::Matrix2d brightness_matrix;       ///< Σ (f, 1)(f, 1)ᵀ
    Eigen::Matrix<double, 4, 4> mass;        ///< Σ N Nᵀ
  };
  using Solver = Eigen::SimplicialLLT<Eigen::SparseMatrix<double>>;

  void make_constants();
  void factorise(const std::vector<char>& valid);
  /// Of the elements that moved since they were last looked at.
  void sum_residuals(const SplineImage& deformed, const CorrelationResult& result);
  void look_at_all_anew();
  void start_brightness(const CorrelationResult& result);
  /// What the sums become by the last step, to first order of it: no pass over the pixels.
  void continue_sums(const CorrelationResult& result);
  /// Σ N ∇f r into right_, the brightness's right-hand side into the result.
  [[nodiscard]] Eigen::Vector2d assemble_right(const CorrelationResult& result);
  /// One step of Gauss and Newton; `last` is the one before (empty: none), `lengthening` what steps are
  /// multiplied by.
  double step(CorrelationResult& result, Eigen::VectorXd& last, double& lengthening);
  /// Nodal vectors of the reference's coordinates in those of the moved body, F w.
  [[nodiscard]] Eigen::VectorXd carried(const Eigen::VectorXd& nodal) const;
  /// R (u − that of the large motion), its derivative by a step in the reference's coordinates.
  [[nodiscard]] Eigen::VectorXd penalty_slope(const Eigen::VectorXd& displacement) const;
  /// Of a matrix with the pattern that the solver has analysed.
  static void factorise_or_shift(Eigen::SparseMatrix<double>& matrix, Solver& solver);
  /// At most `most` steps.
  void iterate(const SplineImage& deformed, CorrelationResult& result, int most);
  void begin_again(const SplineImage& deformed, CorrelationResult& result);
  int reject(const SplineImage& deformed, CorrelationResult& result, bool restless) const;
  [[nodiscard]] bool is_a_spot(const SplineImage& deformed, const CorrelationResult& result,
                               std::size_t element, double usual) const;
  void reject_restless(CorrelationResult& result, const std::vector<double>& rms) const;
  int readmit(const SplineImage& deformed, CorrelationResult& result, std::vector<char>& tried);
  void extrapolate(CorrelationResult& result) const;
  [[nodiscard]] std::vector<double> element_rms() const;
  /// Median over the valid elements.
  [[nodiscard]] double usual_residual(const CorrelationResult& result, const std::vector<double>& rms) const;
  void make_pattern();
  /// Of all elements' pattern, with zeros where only elements that are not valid would be.
  [[nodiscard]] Eigen::SparseMatrix<double> assemble(const std::vector<char>& valid, bool for_solving,
                                                     double mass) const;
  [[nodiscard]] bool per_element() const { return options_.brightness == Brightness::per_element; }

  ReferenceField reference_;
  ImageMesh mesh_;
  PixelTable pixels_;
  CorrelationOptions options_;
  std::vector<Constants> constants_;
  std::vector<double> gradient_, texture_;
  std::vector<char> usable_;
  std::optional<AffineMotion> large_;  ///< what the motion begins with, where that is not small
  double penalty_ = 0;                 ///< weight of the regularisation, from its wavelength; 0: none

  Eigen::SparseMatrix<double> pattern_;      ///< of M with all elements; zeros
  std::vector<std::array<int, 16>> places_;  ///< entry (2a, 2b) of each element in its values, 4 a + b
  std::vector<char> factorised_for_;
  Solver solver_;
  Eigen::SparseMatrix<double> penalty_matrix_;  ///< R, of the elements factorised for
  std::vector<char> plain_for_;
  Solver plain_;                                ///< M without R
  Eigen::MatrixXd coupling_, solved_coupling_;  ///< 2n × 2: C and M⁻¹ C of a global brightness
  Eigen::Matrix2d brightness_schur_;
  std::vector<ResidualSums> sums_;
  std::vector<Eigen::Matrix<double, 8, 1>> rights_;            ///< Σ N ∇f r of each element
  std::vector<double> moved_;                                  ///< px, since its pixels were looked at
  Eigen::Vector2d brightness_step_ = Eigen::Vector2d::Zero();  ///< of the last step, where global
  std::vector<std::array<float, 2>> element_brightness_;       ///< α, β
  std::vector<std::array<double, 2>> element_step_;            ///< and what the last step changed of them
  Eigen::VectorXd right_, step_;
};

}  // namespace knothe::imaging
