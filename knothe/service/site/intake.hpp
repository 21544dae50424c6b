#pragma once
/// @file The way into a site's journal of what nobody waits for an answer to: files of watched folders,
/// frames of a camera.
#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "knothe/files/picture.hpp"
#include "knothe/service/site/site.hpp"

namespace knothe::service {

/// For one thread.
class Intake {
 public:
  /// What became of a datum: stored, to be tried again, or refused for good, which is said.
  enum class StoreOutcome { done, again, refused };
  struct PictureStamp {
    likelihood::DatumKey key;
    double time = 0;   ///< of the model
    std::string name;  ///< in messages
  };
  /// A picture as a datum. Where `trouble` is not empty it says why its values are all missing.
  struct Measured {
    Measurement datum;
    std::string trouble;
  };

  /// `wait` sleeps so many seconds; false: it is time to end.
  Intake(std::shared_ptr<Site> site, std::function<bool(double)> wait);

  /// Measures as `knothe assimilate` does where pictures come in order: a picture starts from the last one,
  /// or where the model predicts it by the parameters known after the picture before the last.
  [[nodiscard]] Measured measure(const PictureStamp& stamp, const files::Picture& picture);
  /// A picture that cannot be read, or did not come.
  [[nodiscard]] Measurement missing(const PictureStamp& stamp);
  /// Waits until the datum is on disk, with what is noted of its file, or is refused. One that was withdrawn
  /// is not brought back.
  StoreOutcome store(Measurement measurement, const std::string& name, std::optional<JournalFile> file = {});
  /// Says why something was not taken, in the log and as an alarm.
  void refuse(const std::string& name, const std::string& reason);
  /// Step of the latest line, 0 where there is none.
  [[nodiscard]] std::size_t latest_step() const;

 private:
  [[nodiscard]] Measurement without_values(const PictureStamp& stamp) const;
  [[nodiscard]] std::optional<std::size_t> step_of(double time) const;
  [[nodiscard]] Eigen::VectorXd increment_to(std::optional<std::size_t> step);

  std::shared_ptr<Site> site_;
  std::function<bool(double)> wait_;
  std::array<std::optional<std::size_t>, 2> pictured_;  ///< steps of the last two pictures, missing or not
};

}  // namespace knothe::service
