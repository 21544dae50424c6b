#include "knothe/service/site/site_facts.hpp"

#include <filesystem>

#include "knothe/base/sha256.hpp"
#include "knothe/service/journal/test_journals.hpp"

namespace knothe::service {
namespace {

/// What the data mean: where the sensors are, and their noise as the likelihood sees it.
std::string sensors_hash(const project::UpdateSetup& setup, const Eigen::VectorXd& noise_std) {
  Sha256 sum;
  for (const double x : setup.measurements.sensors.points) sum.add_number(x);
  for (const std::int64_t c : setup.measurements.sensors.components) sum.add_number(c);
  for (const std::string& name : setup.measurements.sensors.scalars) sum.add_text(name);
  for (const double s : noise_std) sum.add_number(s);
  sum.add_number(setup.measurements.noise.measurement().log_determinant());
  return to_hex(sum.finish());
}

/// The project with what is a test's own: its journal, and the folder of the frames that are kept.
project::Project of_test(project::Project project, const std::string& test) {
  project.serve.journal = journal_of_test(project.serve.journal, test);
  std::string& keep = project.serve.camera.keep;
  if (!keep.empty() && !test.empty()) keep = (std::filesystem::path(keep) / test).string();
  return project;
}

Identity identity_of(const project::Project& project, const project::UpdateSetup& setup,
                     const Eigen::VectorXd& noise_std) {
  return {sensors_hash(setup, noise_std), to_hex(sha256_of_file(project.model)),
          to_hex(sha256_of(project.text)), project.text};
}

}  // namespace

SiteFacts::SiteFacts(project::Project project, std::string test)
    : test_(std::move(test)),
      project_(of_test(std::move(project), test_)),
      setup_(project::set_up_online(project_)),
      noise_std_(setup_.measurements.noise.measurement().standard_deviations()),
      identity_(identity_of(project_, setup_, noise_std_)) {}

}  // namespace knothe::service
