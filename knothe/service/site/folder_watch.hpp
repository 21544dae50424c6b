#pragma once
/// @file Pictures and CSV files that are left in folders, taken in as if they had been sent: measured, then
/// journal first. The file in the folder is what is kept until its datum is in the journal.
#include <array>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "knothe/service/site/intake.hpp"
#include "knothe/service/site/settled_files.hpp"
#include "knothe/service/site/site.hpp"

namespace knothe::service {

/// One site's folders, with a thread of its own. A picture's key is (pictures, NAME OF THE FOLDER, n), n its
/// line in the folder's `pictures.csv` or the number in its name; a CSV file's are (csv, NAME OF THE FILE,
/// step of the model) for each of its times. So what is in the journal already, after a restart or for a file
/// that comes twice, is known without being read. A picture that cannot be used is a datum whose values are
/// all missing, with the reason in the log and as an alarm.
class FolderWatch {
 public:
  [[nodiscard]] static bool is_wanted(const project::Project& project);
  explicit FolderWatch(std::shared_ptr<Site> site);
  ~FolderWatch();
  FolderWatch(const FolderWatch&) = delete;
  FolderWatch& operator=(const FolderWatch&) = delete;

 private:
  struct Place {
    std::int64_t seq = 0;
    double time = 0;
  };
  using StoreOutcome = Intake::StoreOutcome;  ///< of a file

  void run();
  void ingest_pictures();
  void ingest_tables();
  [[nodiscard]] Place place_of(const std::string& name) const;
  StoreOutcome ingest_picture(const std::string& name);
  StoreOutcome ingest_table(const std::string& name);
  [[nodiscard]] bool is_of_another_test(const SettledFiles& files, const std::string& name);
  [[nodiscard]] bool patient(const SettledFiles& files, const std::string& name) const;
  /// False when it is time to end.
  bool wait(double seconds);

  std::shared_ptr<Site> site_;
  Intake intake_;
  std::optional<SettledFiles> pictures_, tables_;
  std::map<std::array<double, 4>, std::size_t> sensor_at_;  ///< x, y, z, component → index
  bool told_of_others_ = false;
  std::mutex mutex_;
  std::condition_variable end_;
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace knothe::service
