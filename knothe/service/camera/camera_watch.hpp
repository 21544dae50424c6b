#pragma once
/// @file The frames of a camera, taken in as the pictures of a watched folder are: measured, then journal
/// first.
#include <functional>
#include <memory>

#include "knothe/service/camera/frame_numbers.hpp"
#include "knothe/service/site/intake.hpp"
#include "knothe/service/site/watch_thread.hpp"

namespace knothe::service {

/// One site's camera, kept connected by a thread of its own. A frame's key is (camera, its session, its time
/// by the camera's clock in µs), so the journal knows after a restart which frame was the last; the model
/// time is the one of the frame's number, as of a watched picture's. A frame that came with packets missing,
/// or not at all though the camera was connected, is a datum whose values are all missing. What was not seen
/// because the camera or the service was away is said, once, and is no datum.
class CameraWatch {
 public:
  using Open = std::function<std::unique_ptr<FrameSource>(const project::CameraOptions&)>;

  /// `open` connects, IoError where it cannot; it is retried.
  CameraWatch(std::shared_ptr<Site> site, Metrics& metrics, Open open);

 private:
  void run();
  void connect();
  void receive();
  void lose(const std::string& reason);
  void ingest(const Frame& frame);
  void report_gap(const FrameNumbers::Place& place, const FrameNumbers::Numbered& before);
  void record_missing(const FrameNumbers::Place& place, const FrameNumbers::Numbered& before);
  void ingest_picture(const FrameNumbers::Numbered& frame, const files::Picture& picture);
  void store(Measurement datum, const Intake::PictureStamp& stamp);
  [[nodiscard]] std::optional<FrameNumbers::Numbered> last_in_journal() const;
  [[nodiscard]] const std::vector<double>& times() const;
  /// Nothing for a frame before the first or behind the last time, or when the test is finished.
  [[nodiscard]] std::optional<Intake::PictureStamp> stamp_of(const FrameNumbers::Numbered& frame);
  void prepare_folder();
  void save_picture(const Intake::PictureStamp& stamp, const files::Picture& picture);
  void note_kept(const Intake::PictureStamp& stamp);
  void count(const std::string& what, double by = 1);

  std::shared_ptr<Site> site_;
  const project::CameraOptions& options_;
  Metrics& metrics_;
  Open open_;
  Intake intake_;
  std::unique_ptr<FrameSource> source_;
  FrameNumbers numbers_{std::nullopt};
  bool was_connected_ = false, is_over_ = false;
  std::string said_;        ///< why it is away
  std::string incomplete_;  ///< what was wrong with the last incomplete frame since a whole one
  WatchThread thread_;
};

}  // namespace knothe::service
