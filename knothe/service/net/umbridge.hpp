#pragma once
/// @file The service as a UM-Bridge 1.0 server: models `forward`, `posterior`, `predict`. Private to this
/// room.
#include <memory>
#include <string>
#include <vector>

#include "knothe/assimilation/forecast/forecaster.hpp"
#include "knothe/likelihood/step/collapsed_posterior.hpp"
#include "knothe/service/net/http_server.hpp"
#include "knothe/service/site/served_site.hpp"

namespace knothe::service {

/// Use from one thread.
class UmBridge {
 public:
  explicit UmBridge(const std::vector<std::shared_ptr<ServedSite>>& sites);
  /// Whether the path is one of the protocol's eight.
  [[nodiscard]] static bool speaks(const std::string& path);
  /// The answer to a request of such a path; never an empty error, never null or NaN.
  [[nodiscard]] HttpResponse answer(const HttpRequest& request);

 private:
  struct SiteModels {
    std::shared_ptr<ServedSite> served;
    std::weak_ptr<Site> site;                  ///< the test that the others are of
    std::shared_ptr<const ServedModel> model;  ///< and its model
    void use(std::shared_ptr<const ServedModel> other);
    std::unique_ptr<likelihood::CollapsedLogDensity> density;
    std::unique_ptr<assimilation::Forecaster> forecaster;
  };
  struct Call;
  Json respond(const HttpRequest& request);
  Json evaluate(Call& call);
  Json gradient(Call& call);
  Json apply_jacobian(Call& call);
  Json apply_hessian(Call& call);
  SiteModels& models_of(const nlohmann::json& config);
  void evaluate_posterior(Call& call, int derivatives);
  void evaluate_forward(Call& call, int derivatives, const Eigen::VectorXd& sensitivity);
  void evaluate_predict(Call& call);

  std::vector<SiteModels> models_;
};

}  // namespace knothe::service
