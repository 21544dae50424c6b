#include <fcntl.h>
#include <fmt/format.h>

#include <sqlite3.h>
#include <sys/resource.h>
#include <sys/statvfs.h>
#include <sys/timex.h>
#include <unistd.h>
#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <boost/version.hpp>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <thread>

#include "knothe/base/console.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/base/version.hpp"
#include "knothe/project/project_engine.hpp"
#include "knothe/project/update_setup.hpp"
#include "knothe/service/camera/aravis_camera.hpp"
#include "knothe/service/journal/journal.hpp"
#include "knothe/service/journal/step_matching.hpp"
#include "knothe/service/journal/test_journals.hpp"
#include "knothe/service/net/http_server.hpp"
#include "knothe/service/net/tokens.hpp"
#include "knothe/service/site/alarm_sender.hpp"
#include "knothe/service/site/doctor.hpp"

namespace knothe::service {
namespace {

void say(const std::string& line) {
  fmt::print("{}\n", for_people(line, stdout, 18));
}

class Report {
 public:
  void line(bool good, const std::string& what, const std::string& text, const std::string& advice = "") {
    say(fmt::format("{:4} {:12} {}", good ? "ok" : "!!", what, text));
    if (!good && !advice.empty()) say(fmt::format("     {:12} {}", "", advice));
    all_good_ = all_good_ && good;
  }
  [[nodiscard]] bool all_good() const { return all_good_; }

 private:
  bool all_good_ = true;
};

std::string processor() {
  std::ifstream file("/proc/cpuinfo");
  std::string line;
  while (std::getline(file, line))
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown processor";
}

std::string vectors_built_for() {
#if defined(__AVX512F__)
  return "AVX-512";
#elif defined(__AVX2__)
  return "AVX2";
#else
  return "SSE2";
#endif
}

/// Median and largest time of small synced writes, s; negative where nothing can be written.
std::pair<double, double> sync_times(const std::string& folder) {
  const std::string path =
      (std::filesystem::path(folder) / fmt::format(".knothe-doctor-{}", ::getpid())).string();
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  if (file < 0) return {-1, -1};
  std::vector<double> times;
  const std::string block(4096, 'k');
  for (int i = 0; i < 20; ++i) {
    const auto start = std::chrono::steady_clock::now();
    const bool written =
        ::write(file, block.data(), block.size()) == std::ssize(block) && ::fdatasync(file) == 0;
    if (!written) times = {};
    if (!written) break;
    times.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  ::close(file);
  ::unlink(path.c_str());
  if (times.empty()) return {-1, -1};
  std::sort(times.begin(), times.end());
  return {times[times.size() / 2], times.back()};
}

void report_disk(Report& report, const std::string& folder) {
  struct statvfs disk {};
  const bool known = ::statvfs(folder.c_str(), &disk) == 0;
  const double room = known ? 1.0 * disk.f_bavail * disk.f_frsize : 0;
  report.line(room > 1e9, "disk", fmt::format("{:.1f} GB free in {}", room * 1e-9, folder),
              "a day of one picture every 5 s, 60 sensors, is 20 MB of journal");
  const auto [median, worst] = sync_times(folder);
  report.line(
      median >= 0, "permissions",
      median >= 0 ? fmt::format("{} can be written", folder) : fmt::format("{} cannot be written", folder),
      "journal and results need a folder of their own user");
  if (median >= 0)
    report.line(
        median < 0.05, "sync",
        fmt::format("{:.2f} ms median, {:.2f} ms at worst for a synced write", 1e3 * median, 1e3 * worst),
        "every measurement is synced before it is acknowledged: use a local disk");
}

/// A line of what `look` finds, or of what it throws.
void report_found(Report& report, const std::string& what, const std::function<std::string()>& look) {
  try {
    report.line(true, what, look());
  } catch (const std::exception& error) {
    report.line(false, what, error.what());
  }
}

std::string found_journal(const std::string& path, const std::vector<double>& model_times) {
  if (!std::filesystem::exists(path)) return fmt::format("{} will be created at the start", path);
  const JournalReader journal(path);
  if (!journal.lost().empty()) throw DataError(fmt::format("{}: {}", path, journal.lost()));
  journal.for_each([&](JournalEntry entry) {
    if (!entry.withdrawn) match_step(entry, model_times, path);
  });
  return fmt::format("{}: {} records, whole", path, journal.count());
}

std::string found_tokens(const project::Project& project) {
  const project::ServeOptions& options = project.serve;
  const Tokens tokens(project);
  for (const auto& [key, path] :
       {std::pair{"read_token", options.read_token}, {"ingest_token", options.ingest_token}}) {
    if (!tokens.needed(key == std::string("ingest_token")) && !is_loopback(options.address))
      throw DataError(fmt::format("{} is not a loopback address: [serve] {} must name a token file",
                                  options.address, key));
    using std::filesystem::perms;
    if (!path.empty() && (std::filesystem::status(path).permissions() &
                          (perms::others_read | perms::others_write)) != perms::none)
      throw DataError(fmt::format("{} can be read by everybody here: chmod o= {}", path, path));
  }
  return tokens.needed(false) || tokens.needed(true) ? "are there" : "none: for this machine alone";
}

std::string found_clock() {
  timex clock{};
  if (::adjtimex(&clock) == TIME_ERROR || (clock.status & STA_UNSYNC) != 0)
    throw DataError(
        "the clock is not synchronised: alarms and times of arrival may be off (data are not: their time is "
        "model time); install systemd-timesyncd or chrony");
  return fmt::format("synchronised, to {:.0f} ms at worst", 1e-3 * clock.maxerror);
}

std::string found_camera(const project::CameraOptions& options) {
  const auto camera = open_aravis_camera(options);
  for (double waited = 0; waited < 5; waited += 0.5)
    if (const auto frame = camera->next(0.5))
      return fmt::format("{} ({}): frames of {} × {} pixels, {} bits", camera->description(),
                         camera->serial(), frame->picture.width, frame->picture.height,
                         frame->picture.bit_depth);
  throw IoError(
      fmt::format("{} ({}): no whole frame came within 5 s", camera->description(), camera->serial()));
}

/// A message by each channel, as an alarm would go out.
void test_alarms(Report& report, const project::Project& project) {
  std::vector<std::unique_ptr<AlarmChannel>> channels;
  report_found(report, "alarms", [&] {
    channels = alarm_channels(project);
    if (channels.empty()) throw DataError("no channel is configured: [serve.notify] is missing or empty");
    return fmt::format("{} channels", channels.size());
  });
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  Alarm alarm;
  alarm.severity = "info", alarm.kind = "test", alarm.message = "a test: nothing has happened";
  alarm.raised_ms = std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
  const Json message = message_of({project.serve.site, {}}, alarm, true);
  const std::atomic<bool> stopping{false};
  for (const auto& channel : channels)
    report_found(report, channel->name(), [&] {
      (void)channel->send({&message, 1}, stopping);
      return std::string("a test message was sent");
    });
}

void report_service(Report& report, const std::string& path, bool sends_alarms) {
  std::optional<project::Project> project;
  report_found(report, "project", [&] {
    project = project::read_project(path);
    return path;
  });
  if (!project) return;
  std::vector<double> times;
  report_found(report, "model", [&] {
    const project::UpdateSetup setup = project::set_up_online(*project);
    times = setup.problem.model->time;
    return fmt::format("{}: {}, {}, {}", project->model, counted(setup.problem.priors.size(), "parameter"),
                       counted(times.size(), "step"),
                       counted(setup.measurements.observation_count(), "sensor"));
  });
  if (!times.empty())
    report_found(report, "journal", [&] {
      const std::string& journal = project->serve.journal;
      return found_journal(journal_of_test(journal, last_to_follow(journal, "")), times);
    });
  report_found(report, "tokens", [&] { return found_tokens(*project); });
  const std::string where = fmt::format("{}:{}", project->serve.address, project->serve.port);
  report_found(report, "address", [&] {
    try_to_listen(project->serve.address, project->serve.port);
    return where + " is free";
  });
  report_found(report, "clock", found_clock);
  if (project->serve.camera.wanted)
    report_found(report, "camera", [&] { return found_camera(project->serve.camera); });
  if (sends_alarms) test_alarms(report, *project);
}

}  // namespace

bool doctor(const std::string& folder, bool offline_installed, const std::string& project,
            bool sends_alarms) {
  Report report;
  report.line(true, "knothe",
              fmt::format("{} (g++ {}, vectors: {})", k_version, __VERSION__, vectors_built_for()));
  report.line(true, "libraries",
              fmt::format("Eigen {}.{}.{}, SQLite {}, Boost {}", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION,
                          EIGEN_MINOR_VERSION, sqlite3_libversion(), BOOST_LIB_VERSION));
  report.line(true, "processor",
              fmt::format("{}, {} cores, {} threads by default", processor(),
                          std::thread::hardware_concurrency(), default_threads()));
  const double memory = 1.0 * sysconf(_SC_PHYS_PAGES) * sysconf(_SC_PAGESIZE);
  report.line(memory > 5e8, "memory", fmt::format("{:.1f} GB", memory * 1e-9),
              "the online service takes some 100 MB");
  std::error_code error;
  std::string blas;
  for (const auto& entry : std::filesystem::directory_iterator("/usr/lib/x86_64-linux-gnu", error))
    if (entry.path().filename() == "libblas.so.3")
      blas = std::filesystem::canonical(entry.path(), error).string();
  const bool fast = blas.find("openblas") != std::string::npos || blas.find("mkl") != std::string::npos ||
                    blas.find("blis") != std::string::npos;
  report.line(fast || !offline_installed, "BLAS",
              blas.empty() ? "none (the online program needs none)" : blas,
              "the offline phase is five times slower with it: apt-get install libopenblas0-serial");
  report.line(true, "offline",
              offline_installed
                  ? "knothe-offline is installed"
                  : "knothe-offline is not installed: no full-order runs here, everything else works");
  const std::filesystem::path file(project);
  report_disk(report, project.empty() ? folder : file.has_parent_path() ? file.parent_path().string() : ".");
  rlimit files{};
  getrlimit(RLIMIT_NOFILE, &files);
  report.line(files.rlim_cur >= 1024, "descriptors", fmt::format("{} files may be open", files.rlim_cur),
              "ulimit -n 4096, for many viewers");
  if (!project.empty()) report_service(report, project, sends_alarms);
  return report.all_good();
}

}  // namespace knothe::service
