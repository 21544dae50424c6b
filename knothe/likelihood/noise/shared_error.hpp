#pragma once
/// @file Errors of each dof that all steps share: the noise of the reference picture, constant offsets.
///
/// y_t = model_t + own_t + s with own_t ~ N(0, Q_t⁻¹) new at each step and s ~ N(0, K⁻¹) the same at all.
/// The likelihood of a datum given the data before it stays a quadratic form in v = w − w₀, so the forms of
/// the steps still add up to that of all data, and nothing about the collapsed posterior changes; but the
/// form of a step depends on the steps before it. With the same precision M/γ² of own errors at n complete
/// steps and k reference pictures the sum is
///   γ⁻² [Σ yᵀMy − (Σy)ᵀM(Σy)/(n + k)].
#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <memory>
#include <vector>

#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/likelihood/step/step_form.hpp"
#include "knothe/model/observe/observed_model.hpp"

namespace knothe::likelihood {

/// One noise matrix and one set of dofs, with what no datum changes.
struct NoiseGroup {
  std::size_t step = 0;            ///< where the noise is that of one step only
  bool of_one_step = false;        ///< noise/precision_steps
  std::vector<Eigen::Index> kept;  ///< dofs, increasing
  GaussianNoise noise;             ///< R_s⁻¹ of the dofs kept: own and shared part together
  Eigen::MatrixXd space;           ///< (OU)_s
  Eigen::MatrixXd weighted_space;  ///< R_s⁻¹ (OU)_s
  Eigen::MatrixXd gram;            ///< (OU)_sᵀ R_s⁻¹ (OU)_s

  /// The form of a datum with residual r, its covariance R_s / factor, in v, of which `core` says how the
  /// space modes depend on it, and in x, of which `extra` (n_s × m) says how the values depend on it.
  void project(const Eigen::MatrixXd& core, const Eigen::VectorXd& residual, double factor,
               const Eigen::MatrixXd& extra, StepForm& form) const;
};

/// A datum: r = (OU) `core` v + `extra` x + own + s, of the dofs that `group` keeps.
struct ProjectedDatum {
  const NoiseGroup& group;
  const Eigen::MatrixXd& core;  ///< l × r
  const Eigen::VectorXd& residual;
  Eigen::MatrixXd extra;  ///< n_s × m; x is that of the data before, and what is new behind
};

/// s as an information filter: its mean, affine in v and x, and its information matrix. K⁻¹ is the sum of
/// two parts, either of which may be absent: R/(k + 1), of k reference pictures (own_t: R_t k/(k + 1)), and
/// τ² of offsets. Three cases, of which the first two are the third one's fast paths:
/// - correlated noise, reference pictures alone, the same noise and dofs at all steps so far: given the data
///   before it a datum is Gaussian with residual r_n − Σ_{i<n} r_i/(k + n − 1) and precision
///   Q (k + n − 1)/(k + n): no factorisation, no cancellation;
/// - independent noise: sensors one by one;
/// - else the information matrix of the two parts of s is factorised again for each datum. It is sparse: the
///   own errors of missing dofs stay as variables, so that their Schur complements are never formed.
class SharedError {
 public:
  [[nodiscard]] static bool is_in(const NoiseModel& noise) {
    return noise.shared_reference() > 0 || noise.offset_std() > 0;
  }
  SharedError(std::shared_ptr<const model::ObservedModel> model, const NoiseModel& noise);
  void restart();
  void set_noise(const NoiseModel& noise) { noise_ = noise; }  ///< the same, with further steps

  /// The form of the next datum given those before it, in (v, x); takes the datum, if the form is finite.
  /// `moved` (may be null): the form in (v, u, z, x) too (`MovedForm`).
  [[nodiscard]] StepForm condition(const ProjectedDatum& datum, MovedForm* moved);

 private:
  using Sparse = Eigen::SparseMatrix<double>;
  enum class Path { uniform, diagonal, sparse };
  /// Noise and dofs with which data came.
  struct Kind {
    std::size_t step;
    bool of_one_step;
    std::vector<Eigen::Index> kept;
    GaussianNoise noise;
    Eigen::Index count = 0;    ///< data
    Eigen::Index border = -1;  ///< place of the missing dofs' own errors in the information matrix
  };
  /// A = K + Σ S_tᵀ Q_t S_t, bordered.
  struct Information {
    Sparse matrix;
    std::shared_ptr<const Eigen::SimplicialLDLT<Sparse>> factor;
    double log_border = 0;       ///< log det of the border
    double log_determinant = 0;  ///< log det A
  };
  /// Of one datum: what its columns become.
  struct Conditional {
    Eigen::MatrixXd product;  ///< columnsᵀ (covariance given the data before)⁻¹ columns
    Eigen::MatrixXd shift;    ///< n × columns: what the datum adds to the mean
    double log_determinant;   ///< of the covariance
    Information information;  ///< afterwards, where sparse
  };

  [[nodiscard]] Eigen::MatrixXd innovation(const ProjectedDatum& datum, bool moved,
                                           const std::vector<const Kind*>& standing) const;
  void add_uniform(const ProjectedDatum& datum);
  [[nodiscard]] StepForm project_uniform(const ProjectedDatum& datum, MovedForm* moved) const;
  void leave_uniform();
  [[nodiscard]] Conditional condition_diagonal(const NoiseGroup& group, const Eigen::MatrixXd& columns) const;
  [[nodiscard]] Conditional condition_sparse(Kind& kind, const Eigen::MatrixXd& columns) const;
  [[nodiscard]] Eigen::MatrixXd effect_of_kind(const Kind& kind) const;
  [[nodiscard]] Kind& kind_of(const NoiseGroup& group);
  void choose_moved(const Kind& mine, MovedForm& moved, std::vector<const Kind*>& standing) const;

  [[nodiscard]] Information prior_information();
  [[nodiscard]] Information with(Information information, Kind& kind, Eigen::Index count) const;
  void factorise(Information& information) const;
  [[nodiscard]] Eigen::MatrixXd gathered(const Kind& kind, const Eigen::MatrixXd& weighted) const;
  [[nodiscard]] Eigen::MatrixXd spread(const Eigen::MatrixXd& parts) const;

  std::shared_ptr<const model::ObservedModel> model_;
  NoiseModel noise_;     ///< of all steps but those with their own
  double pictures_;      ///< k
  Eigen::VectorXd own_;  ///< own precision over R⁻¹, per dof
  Path path_;
  std::vector<Kind> kinds_;
  // On the uniform path, of the dofs kept, Σ r_t, Σ C_t, Σ extra_t.
  Eigen::VectorXd sum_residual_;
  Eigen::MatrixXd sum_core_, sum_extra_;
  // On the others: E[s | v, x] = mean (1, −v, −x), n × (1 + r + m).
  Eigen::MatrixXd mean_;
  Eigen::VectorXd prior_precision_, precision_;  ///< diagonal: K, A
  Sparse parts_;                                 ///< sparse: s = parts_ᵀ · variables, number × n
  Information information_;
};

}  // namespace knothe::likelihood
