#pragma once
/// @file Global finite-element digital image correlation (Rubio et al. 2019, Eq. 25–27).
///
/// min_u ∫ [f(x) − α g(x + u(x)) − β]² dx over u = Σ_a N_a u_a by Gauss–Newton with the gradient of the
/// reference picture, so that the matrix M = Σ_px (N ∇f)(N ∇f)ᵀ is constant and factorised once.
/// Displacements are in px, positive right and down; dof 2a is u, 2a + 1 is v of node a.
#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <memory>
#include <string>
#include <vector>

#include "knothe/files/picture.hpp"
#include "knothe/imaging/correlation/residual_kernel.hpp"
#include "knothe/imaging/mesh/image_mesh.hpp"

namespace knothe::imaging {

/// Which brightness changes between the pictures are allowed for.
enum class Brightness {
  none,
  global,      ///< one gain α and one offset β for the picture
  per_element  ///< one of each for every element: uneven light; costs accuracy
};

/// What is asked of the displacement beside fitting the pictures.
enum class DisplacementRegularisation {
  tikhonov,   ///< a small gradient
  mechanical  ///< forces in equilibrium, as in an elastic sheet: elastic fields are left alone
};

struct CorrelationOptions {
  int max_iterations = 50;
  double tolerance = 1e-3;  ///< on the largest change of a displacement, px
  Brightness brightness = Brightness::global;
  double prefilter_sigma = 0;  ///< Gaussian on both pictures, px; 1 for sharp, aliased speckle
  double saturation = 0;       ///< grey level from which a pixel is masked; 0: the pictures' maximum
  /// Mean square of the reference's gradient, in its weaker direction, that an element must have; what is
  /// below `texture_of_noise` is no texture.
  double least_texture = 0;
  double regularisation = 0;  ///< its cut-off wavelength in px (of shear waves), 0: none
  DisplacementRegularisation regularisation_kind = DisplacementRegularisation::tikhonov;
  double poisson_ratio = 0.2;   ///< of mechanical regularisation
  bool reject_elements = true;  ///< take out elements whose residual says that their kinematics do not hold
  double rejection_factor = 4;  ///< … when it is so many robust standard deviations above that of the others
  int threads = 1;
  bool interruptible = false;  ///< Ctrl-C ends it between two iterations, by Interrupted
};

struct CorrelationResult {
  Eigen::VectorXd
      displacement;  ///< 2 per node, px; without a meaning where no valid element is (measured_nodes)
  /// What the pictures say without the regularisation: the same, or less what that did. These are the data
  /// of a likelihood with `ImageCorrelation::precision`; empty without regularisation.
  Eigen::VectorXd unregularised;
  bool converged = false;
  bool searched = false;   ///< the start was looked for from coarse to fine pictures
  bool predicted = false;  ///< it was the prediction that was given beside the start, which fitted better
  int iterations = 0;
  double last_step = 0;                  ///< largest change in the last iteration, px
  double residual_rms = 0;               ///< grey levels, over the valid elements
  double pixels_used = 0;                ///< in the valid elements
  double gain = 1, offset = 0;           ///< of the deformed picture: f ≈ α g(x + u) + β
  std::vector<double> element_residual;  ///< rms, grey levels; 0 where no pixel was seen
  std::vector<char> element_valid;       ///< 0: rejected, masked, or out of the picture
  int elements_rejected = 0;
  std::string message;  ///< why it did not converge; empty if it did
};

/// One reference picture and mesh, many deformed pictures.
class ImageCorrelation {
 public:
  /// `mask` (may be empty): only pixels that are not 0 there are used. Errors: UsageError for a mesh outside
  /// the picture, a mask of another size, and for elements without texture (with the element's number and
  /// place).
  ImageCorrelation(files::Picture reference, ImageMesh mesh, CorrelationOptions options = {},
                   const files::Picture& mask = {});
  ~ImageCorrelation();
  ImageCorrelation(ImageCorrelation&&) noexcept;
  ImageCorrelation& operator=(ImageCorrelation&&) noexcept;

  [[nodiscard]] const ImageMesh& mesh() const;
  [[nodiscard]] const CorrelationOptions& options() const;
  /// M of Eq. 27 (grey levels² per px²), without brightness and regularisation; both triangles.
  [[nodiscard]] Eigen::SparseMatrix<double> matrix() const;
  /// The same of the elements that are valid in a result: what its displacements were measured with.
  [[nodiscard]] Eigen::SparseMatrix<double> matrix(const std::vector<char>& element_valid) const;
  /// Precision (inverse covariance, 1/px²) of the displacements of a result when the noise of both pictures
  /// is white with standard deviation `gamma` (grey levels, before any prefilter): (M − 2 γ² s Σ N Nᵀ) / (2
  /// γ² c). The paper's M/(2γ²) takes the gradient of the reference for exact; but the noise is in it too,
  /// twice: s is the variance of the gradient of unit white noise, c what a prefilter leaves of it
  /// (docs/explanation/imaging.md, correlation_noise.hpp). Both triangles; rows without valid element empty.
  /// `reference_count`: the reference is the mean of so many pictures, its noise γ²/k; `gain` multiplies the
  /// noise of the deformed picture: 2γ² is then γ² (1/k + α²). Errors: UsageError for gamma ≤ 0.
  [[nodiscard]] Eigen::SparseMatrix<double> precision(const std::vector<char>& element_valid, double gamma,
                                                      double reference_count = 1, double gain = 1) const;
  /// Standard deviation (px) of the displacements themselves, which a regularisation makes smaller: √diag of
  /// v A⁻¹ M A⁻¹, A = M + R, corrected for the gradient's noise; without regularisation that of `precision`.
  /// 0 where nothing was measured. Throws NumericalError where the texture is too weak for the correction.
  [[nodiscard]] Eigen::VectorXd displacement_std(const std::vector<char>& element_valid, double gamma,
                                                 double reference_count = 1, double gain = 1) const;
  /// Variance of f − α g as it counts in the normal equations, γ² (1/k + α²) times what a prefilter leaves of
  /// the noise there; grey levels². Covariances are this times M⁻¹, but for the gradient's own noise.
  [[nodiscard]] double difference_variance(double gamma, double reference_count = 1, double gain = 1) const;
  /// Reference (after any prefilter) and last deformed picture as they were compared; valid until the next
  /// one.
  [[nodiscard]] ReferenceRows reference_rows() const;
  [[nodiscard]] const SplineImage& deformed_image() const;
  /// Elements with enough texture and pixels to be measured at all.
  [[nodiscard]] const std::vector<char>& usable_elements() const;
  [[nodiscard]] const files::Picture& reference() const;
  /// Root mean square of the reference about its mean in each element, grey levels.
  [[nodiscard]] double contrast() const;
  /// The pixels of an element, and the shape functions there.
  [[nodiscard]] const PixelTable& pixels() const;
  /// Root of the mean squared gradient per element, grey levels per px.
  [[nodiscard]] const std::vector<double>& element_gradient() const;

  /// `start`: displacements to begin with (empty, or too far off: a search from coarse to fine pictures);
  /// `start_valid`: the elements to begin with (empty: all), so that a crack need not be found again in every
  /// picture: elements that are 0 come back where they can be measured. `prediction` (may be empty): another
  /// start; where it is more than 0.1 px from the first, the one with the smaller residual is taken. Errors:
  /// UsageError for a picture of another size or a start of another length.
  [[nodiscard]] CorrelationResult correlate(const files::Picture& deformed, const Eigen::VectorXd& start = {},
                                            const std::vector<char>& start_valid = {},
                                            const Eigen::VectorXd& prediction = {});

  /// The deformed picture that residual_picture looks at, where the result was found by other means.
  void set_deformed(const files::Picture& deformed);
  /// f(x) − α g(x + u) − β at the pixels of the mesh for a result of the last picture; NaN elsewhere.
  [[nodiscard]] std::vector<float> residual_picture(const CorrelationResult& result) const;

 private:
  /// The same without regularisation.
  [[nodiscard]] Eigen::VectorXd plain_std(const std::vector<char>& element_valid, double gamma,
                                          double reference_count, double gain) const;
  struct Work;
  std::unique_ptr<Work> work_;
};

/// Displacement at any points (n × 2, px) from nodal values; false in `inside` where the mesh does not reach,
/// NaN there. `element_valid` (may be empty): elements that are 0 do not belong to the mesh.
[[nodiscard]] Eigen::MatrixXd interpolate(const ImageMesh& mesh, const Eigen::VectorXd& displacement,
                                          const Eigen::Ref<const Eigen::MatrixXd>& points,
                                          std::vector<char>& inside,
                                          const std::vector<char>& element_valid = {});

/// Which nodes belong to a valid element: only their displacements are measured.
[[nodiscard]] std::vector<char> measured_nodes(const ImageMesh& mesh, const std::vector<char>& element_valid);

}  // namespace knothe::imaging
