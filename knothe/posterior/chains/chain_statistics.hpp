#pragma once
/// @file How good Markov chains are: split R-hat and effective sample size (Vehtari, Gelman, Simpson,
/// Carpenter, Bürkner 2021).
#include <Eigen/Core>

namespace knothe::posterior {

/// `draws`: n × chains of one scalar quantity. Errors: UsageError for fewer than 4 draws a chain or
/// values that are not finite. Rank-normalised split R-hat: the larger of that of the values and that of
/// their distance from the median. 1 if nothing varies at all; 1e6 where each half of a chain stands still at
/// a place of its own.
[[nodiscard]] double split_r_hat(const Eigen::Ref<const Eigen::MatrixXd>& draws);
/// Number of independent draws that give the mean as well, by the initial monotone sequence of Geyer, over
/// all chains, split in halves; more than there are draws where successive ones are anticorrelated, by at
/// most a factor log₁₀ of their number. 1 if nothing varies.
[[nodiscard]] double effective_sample_size(const Eigen::Ref<const Eigen::MatrixXd>& draws);
/// The smallest of the effective sizes for the mean, the ranks' normal scores (bulk), the 5 % and 95 %
/// quantiles (tail; Vehtari et al. 2021, section 4.3) and the variance. Errors: as above.
[[nodiscard]] double min_effective_size(const Eigen::Ref<const Eigen::MatrixXd>& draws);
/// Standard error of the standard deviation as a share of it: by the effective size of (x − mean)², or by how
/// far the halves of the chains differ in it, whichever is larger. Errors: as above.
[[nodiscard]] double relative_error_of_deviation(const Eigen::Ref<const Eigen::MatrixXd>& draws);

}  // namespace knothe::posterior
