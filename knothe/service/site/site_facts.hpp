#pragma once
/// @file What of a site stays as it is while its test runs.
#include <string>

#include "knothe/project/update_setup.hpp"
#include "knothe/service/journal/journal.hpp"

namespace knothe::service {

class SiteFacts {
 public:
  /// Reads model and sensors; errors as of `knothe assimilate`. `test`: its name; empty: the one without.
  SiteFacts(project::Project project, std::string test);

  [[nodiscard]] const std::string& name() const { return project_.serve.site; }
  [[nodiscard]] const std::string& test() const { return test_; }
  /// With what is the test's own: its journal, NAME.journal or NAME.TEST.journal, and the folder of frames.
  [[nodiscard]] const project::Project& project() const { return project_; }
  /// By the project's own model: sensors, times and priors are those of every refined one.
  [[nodiscard]] const project::UpdateSetup& setup() const { return setup_; }
  /// Standard deviation of each sensor's noise: of correlated noise it is costly.
  [[nodiscard]] const Eigen::VectorXd& noise_std() const { return noise_std_; }
  [[nodiscard]] const Identity& identity() const { return identity_; }

 protected:
  std::string test_;
  project::Project project_;
  project::UpdateSetup setup_;
  Eigen::VectorXd noise_std_;
  Identity identity_;
};

}  // namespace knothe::service
