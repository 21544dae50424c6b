#pragma once
/// @file How uncertain measured displacements are: from the noise of the pictures to a covariance of the
/// nodes (Rubio et al. 2019, section 5.1).
///
/// With white noise of standard deviation γ in both pictures the error is e = M⁻¹ Σ (e_f − e_g) Nᵀ∇f, hence
/// Cov(e) = 2 γ² M⁻¹ and the precision M / (2 γ²). Pictures that share their reference share its half of the
/// noise: Cov(e_i, e_j) = γ² M⁻¹ (docs/explanation/imaging.md).
#include <Eigen/Core>
#include <Eigen/SparseCore>

#include "knothe/imaging/correlation/image_correlation.hpp"

namespace knothe::imaging {

/// Variance of white noise after quintic B-spline interpolation at fraction t between two pixels, relative to
/// before: Σ_k η(t − k)², η the cardinal spline: 1 at a pixel, 0.84 half-way.
[[nodiscard]] double interpolated_noise_variance(double t);

/// γ (grey levels of one picture, before any prefilter) from the residual of a correlation: its mean square
/// is γ² (1 + α² κ) with κ what the interpolation at the measured displacements leaves of the noise, less the
/// degrees of freedom fitted. What the model of the motion cannot follow counts as noise, so this errs on the
/// safe side. `reference_count`: the reference is the mean of so many pictures.
[[nodiscard]] double noise_from_residual(const ImageCorrelation& correlation, const CorrelationResult& result,
                                         double reference_count = 1);

/// γ from two pictures of a surface at rest: half the variance of their difference, brightness taken out.
/// Errors: UsageError for pictures of different sizes.
[[nodiscard]] double noise_from_repeat(const files::Picture& first, const files::Picture& second,
                                       const Region& region);

/// How much of the variance of the difference of two pictures, brightness taken out, is that of a motion of
/// each square of 32 px: for pictures of a surface at rest some 0.003. Sizes must be equal.
[[nodiscard]] double share_of_motion(const files::Picture& first, const files::Picture& second,
                                     const Region& region);

/// What a Gaussian prefilter leaves of the noise in Σ N ∇f e, relative to unfiltered white noise: Σ|G * ∇f|²
/// / Σ|∇f|². The precision is M / (2 γ² factor). 1 without a prefilter.
[[nodiscard]] double prefilter_noise_factor(const ReferenceRows& reference, const Region& region,
                                            double sigma);

/// Variance of one component of the gradient, at a pixel, of the interpolant of unit white noise, smoothed by
/// a Gaussian of `sigma` px (0: not).
[[nodiscard]] double gradient_noise_variance(double sigma);

/// What noise of `gamma` grey levels in each of the averaged reference pictures takes off the information of
/// an element, as a mean square of its gradient: one with less than that says nothing.
[[nodiscard]] double texture_of_noise(double gamma, double reference_count, double sigma);

/// Standard deviation of every nodal displacement from its precision: √(P⁻¹)_kk; 0 at nodes without a valid
/// element.
[[nodiscard]] Eigen::VectorXd displacement_std(const Eigen::SparseMatrix<double>& precision);
/// Mean over the nodes that are measured; 0 if none is.
[[nodiscard]] double mean_std(const Eigen::VectorXd& std);

/// How accurately displacements are known.
struct DisplacementPrecision {
  Eigen::SparseMatrix<double> matrix;  ///< 1/px², both triangles; empty rows at nodes without a valid element
  Eigen::VectorXd std;                 ///< px, one per displacement; 0 at those nodes
};

/// The `std` of displacement_precision alone, which costs nothing for the next picture with the same
/// elements.
[[nodiscard]] Eigen::VectorXd displacement_std(const ImageCorrelation& correlation,
                                               const std::vector<char>& element_valid, double gamma,
                                               double reference_count = 1, double gain = 1);
/// Of the displacements of a result, for noise γ. Where the noise is so strong against the texture that the
/// correction for the gradient's own noise has no meaning, without it.
[[nodiscard]] DisplacementPrecision displacement_precision(const ImageCorrelation& correlation,
                                                           const std::vector<char>& element_valid,
                                                           double gamma, double reference_count = 1,
                                                           double gain = 1);

}  // namespace knothe::imaging
