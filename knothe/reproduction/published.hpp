#pragma once
/// @file The numbers of Rubio, Chamoin, Louf (2019), section 6, that the study is compared with.
namespace knothe::reproduction::published {

inline constexpr double k_prior_mean[2] = {0.9, 1.1};  ///< of (Y₀, A_d) over their references, §6.3.1
inline constexpr double k_prior_variance = 0.2;
inline constexpr double k_noise_std = 1e-6;            ///< m
inline constexpr int k_nodes = 30;                     ///< measurement points, 60 dofs (§6.4)
inline constexpr double k_estimate[2] = {1.04, 1.00};  ///< maxima of the last marginals
inline constexpr double k_estimate_std[2] = {0.041, 0.022};
inline constexpr double k_tolerance = 1e-3;                 ///< on the variance diagnostic
inline constexpr double k_length_prior[2] = {0.04, 0.013};  ///< mean and std of the prior on l_T, m
inline constexpr double k_length_mean = 0.0372;             ///< m, §6.3.2
inline constexpr double k_length_mode = 0.0376;             ///< m
inline constexpr double k_seconds_per_step = 5;             ///< between two pictures
inline constexpr int k_modes = 6;                           ///< m of the accurate model
inline constexpr int k_few_modes = 3;                       ///< m of the biased one, §6.4
inline constexpr int k_first_high_order = 30,
                     k_last_high_order = 40;  ///< steps of maps of higher order, Fig. 9
inline constexpr int k_picture_count = 27;    ///< 3·10⁻³ mm/s, a picture every 5 s, up to 0.4 mm

}  // namespace knothe::reproduction::published
