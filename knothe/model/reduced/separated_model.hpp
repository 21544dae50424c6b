#pragma once
/// @file Evaluation of a reduced model in either form: u(t, p) = lift(t) + U C_t w(p). No Eigen types here.
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "knothe/model/reduced/model_file.hpp"

namespace knothe::model {

class ParameterFunctions;

/// Values and derivatives with respect to the parameters of several quantities at one parameter point.
struct FieldDerivatives {
  std::size_t count = 0;         ///< n quantities
  std::size_t dimension = 0;     ///< d parameters
  std::vector<double> value;     ///< [n]
  std::vector<double> gradient;  ///< [n, d], empty if not asked for
  std::vector<double> hessian;   ///< [n, d, d], empty if not asked for
};

/// A reduced model, ready to evaluate. Immutable; safe to use from several threads; copies share the data.
class SeparatedModel {
 public:
  /// Takes validated contents; DataError prefixed by `where` if they are not. Its quantities (dofs with
  /// names) are outputs too.
  explicit SeparatedModel(ModelContents contents, const std::string& where = "model");
  [[nodiscard]] static SeparatedModel load(const std::string& path);
  void save(const std::string& path) const;

  [[nodiscard]] const ModelContents& contents() const;
  [[nodiscard]] const std::string& where() const;  ///< what messages call the model: its file
  [[nodiscard]] std::size_t dimension() const;     ///< d
  [[nodiscard]] std::size_t step_count() const;    ///< n_t
  [[nodiscard]] std::size_t dof_count() const;     ///< n_dof
  [[nodiscard]] std::vector<std::string> parameter_names() const;
  /// w(p) of y = lift + U C_t w(p).
  [[nodiscard]] const std::shared_ptr<const ParameterFunctions>& functions() const;

  /// The field at parameters `p` (d, inside the box, else UsageError), time step `step`, at the dofs `dofs`
  /// (all if empty), with derivatives up to order `derivatives` (0, 1, 2).
  [[nodiscard]] FieldDerivatives evaluate(std::span<const double> p, std::size_t step,
                                          std::span<const std::size_t> dofs = {}, int derivatives = 0) const;

  /// Output `name` at parameters `p` and all time steps. The quantities are the
  /// values at the n_t times. Unknown name: UsageError.
  [[nodiscard]] FieldDerivatives evaluate_output(const std::string& name, std::span<const double> p,
                                                 int derivatives = 0) const;
  [[nodiscard]] std::vector<std::string> output_names() const;
  /// The dof of that name; nothing where it is no quantity of the model.
  [[nodiscard]] std::optional<std::size_t> quantity(const std::string& name) const;

 private:
  struct Implementation;
  std::shared_ptr<const Implementation> implementation_;
};

}  // namespace knothe::model
