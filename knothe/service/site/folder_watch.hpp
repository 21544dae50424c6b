#pragma once
/// @file Pictures and CSV files that are left in folders, taken in as if they had been sent: measured, then
/// journal first. The file in the folder is what is kept until its datum is in the journal.
#include <array>
#include <map>
#include <memory>
#include <vector>

#include "knothe/service/site/intake.hpp"
#include "knothe/service/site/settled_files.hpp"
#include "knothe/service/site/site.hpp"
#include "knothe/service/site/watch_thread.hpp"

namespace knothe::service {

class RegularFile;

/// The files that are in a project's watched folders now: of another specimen, for a test that begins now.
/// Those that `known` has seen are not read again.
[[nodiscard]] std::vector<JournalFile> files_there(const project::Project& project,
                                                   const FileRegister& known);

/// One site's folders, with a thread of its own. A picture's key is (pictures, NAME OF THE FOLDER, n), n its
/// line in the folder's `pictures.csv` or the number in its name; a CSV file's are (csv, NAME OF THE FILE,
/// step of the model) for each of its times. What became of a file, by its content, is kept in the journal:
/// so it is done with after a restart, or in another test. A picture that cannot be used is a datum whose
/// values are all missing, with the reason in the log and as an alarm; so is said of each file that gives no
/// datum.
class FolderWatch {
 public:
  [[nodiscard]] static bool is_wanted(const project::Project& project);
  explicit FolderWatch(std::shared_ptr<Site> site);

 private:
  struct Place {
    std::int64_t seq = 0;
    double time = 0;
  };
  using StoreOutcome = Intake::StoreOutcome;  ///< of a file

  struct Folder {
    std::string source;  ///< of its data
    SettledFiles files;
  };

  void run();
  void ingest(Folder& folder);
  StoreOutcome ingest(Folder& folder, JournalFile& file);
  StoreOutcome ingest_picture(const Folder& folder, const RegularFile& opened, JournalFile& file);
  StoreOutcome ingest_table(const RegularFile& opened, const JournalFile& file);
  [[nodiscard]] bool is_known(const JournalFile& file) const;
  [[nodiscard]] files::Picture read(const RegularFile& file) const;
  [[nodiscard]] std::string complaint(const std::string& name, const std::string& holder,
                                      std::int64_t seq) const;
  [[nodiscard]] Place place_of(const Folder& folder, const std::string& name) const;
  void show(const Folder& folder, const std::string& name);
  void tell_of_what_is_left(const Folder& folder);
  void tell_of_others(const Folder& folder, const std::string& name);
  [[nodiscard]] bool patient(const Folder& folder, const std::string& name) const;

  std::shared_ptr<Site> site_;
  Intake intake_;
  std::vector<Folder> folders_;
  std::map<std::array<double, 4>, std::size_t> sensor_at_;  ///< x, y, z, component → index
  bool told_of_others_ = false;
  WatchThread thread_;
};

}  // namespace knothe::service
