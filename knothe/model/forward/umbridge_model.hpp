#pragma once
/// @file A model behind a UM-Bridge 1.0 server (Seelinger et al. 2023, Journal of Open Source Software 8,
/// 4748).
#include <functional>
#include <string>
#include <vector>

#include "knothe/model/forward/forward_model.hpp"
#include "knothe/model/forward/http_connection.hpp"

namespace knothe::model {

struct UmbridgeSettings {
  std::string url;            ///< "http://HOST:PORT"
  std::string name;           ///< of the model; empty: the only one the server has
  std::string config = "{}";  ///< JSON, sent with every request
  double timeout = 30;        ///< s, per request
  int connections = 1;        ///< requests side by side
  /// What is used of the derivatives that the server says it has: 0 none, 1 Gradient and ApplyJacobian, 2
  /// ApplyHessian too.
  int derivatives = 2;
  bool density = false;                 ///< one output, a log-density, for which −∞ is a value
  std::string table = "[model]";        ///< of the project file, for messages
  std::vector<std::string> parameters;  ///< names, for messages; in the order in which the inputs are filled
};

/// Parameters fill the server's input vectors one after the other; its output vectors, one after the other,
/// are the outputs. Everything the server says is checked: version, names, sizes, numbers. All errors are
/// DataErrors that begin with the server's address and hold its own words.
class UmbridgeModel final : public ForwardModel {
 public:
  /// Asks the server for what it has.
  explicit UmbridgeModel(UmbridgeSettings settings);

  [[nodiscard]] Eigen::Index dimension() const override { return dimension_; }
  [[nodiscard]] Eigen::Index output_count() const override { return output_count_; }
  [[nodiscard]] std::string where() const override;
  [[nodiscard]] bool has_gradient() const override { return gradient_; }
  [[nodiscard]] bool has_jacobian() const override { return apply_jacobian_; }
  [[nodiscard]] bool has_hessian() const override { return apply_hessian_; }
  [[nodiscard]] const std::string& name() const { return settings_.name; }
  [[nodiscard]] const std::vector<std::size_t>& input_sizes() const { return input_sizes_; }
  [[nodiscard]] const std::vector<std::size_t>& output_sizes() const { return output_sizes_; }

  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& points, Eigen::Ref<Eigen::MatrixXd> values) override;
  void gradient(const Eigen::Ref<const Eigen::MatrixXd>& points,
                const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
                Eigen::Ref<Eigen::MatrixXd> gradients) override;
  void jacobian(const Eigen::Ref<const Eigen::MatrixXd>& points,
                Eigen::Ref<Eigen::MatrixXd> jacobians) override;
  void hessian(const Eigen::Ref<const Eigen::MatrixXd>& points,
               const Eigen::Ref<const Eigen::MatrixXd>& sensitivities,
               Eigen::Ref<Eigen::MatrixXd> hessians) override;

 private:
  using Point = Eigen::Ref<const Eigen::VectorXd>;
  struct Protocol;
  void ask_info();
  void ask_model_info();
  [[nodiscard]] std::vector<std::size_t> ask_sizes(const std::string& route, const std::string& key);
  [[nodiscard]] std::string describe(const Point& point) const;
  void each_point(Eigen::Index count, const std::function<void(HttpConnection&, Eigen::Index)>& body);
  void evaluate_one(HttpConnection& connection, const Point& point, Eigen::Ref<Eigen::VectorXd> out) const;

  UmbridgeSettings settings_;
  HttpAddress address_;
  std::vector<HttpConnection> connections_;
  std::vector<std::size_t> input_sizes_, output_sizes_;
  Eigen::Index dimension_ = 0, output_count_ = 0;
  bool gradient_ = false, apply_jacobian_ = false, apply_hessian_ = false;
};

}  // namespace knothe::model
