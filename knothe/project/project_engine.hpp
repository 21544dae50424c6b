#pragma once
/// @file The engine of a project, and the project's data one by one.
#include "knothe/assimilation/engine/engine.hpp"
#include "knothe/project/update_setup.hpp"

namespace knothe::project {

/// From what a project file and its data say. Reads the candidate models; errors: those of `set_up` for each,
/// and of `make_forecaster`.
[[nodiscard]] assimilation::EngineSetup engine_setup(const Project& project, const UpdateSetup& setup);

/// The data of a project in order: columns of its data file, or pictures, which are correlated one ahead.
class RecordedData {
 public:
  explicit RecordedData(UpdateSetup setup) : setup_(std::move(setup)) {}

  struct Item {
    likelihood::Datum datum;
    std::optional<PictureDatum> picture;  ///< where it comes from one
  };
  [[nodiscard]] std::size_t size() const { return setup_.time_indices.size(); }
  /// The next datum; nothing behind the last. `mean`: of the parameters after the datum before (may be
  /// empty), from which the correlation of the picture after this one starts.
  [[nodiscard]] std::optional<Item> next(const Eigen::VectorXd& mean);
  [[nodiscard]] const UpdateSetup& setup() const { return setup_; }

 private:
  UpdateSetup setup_;
  std::size_t next_ = 0;
};

}  // namespace knothe::project
