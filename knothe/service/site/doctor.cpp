#include <fcntl.h>
#include <fmt/format.h>
#include <sqlite3.h>
#include <sys/resource.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include <Eigen/Core>

#include <algorithm>
#include <boost/version.hpp>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "knothe/base/threads.hpp"
#include "knothe/base/version.hpp"
#include "knothe/service/journal/replay.hpp"

namespace knothe::service {
namespace {

class Report {
 public:
  void line(bool good, const std::string& what, const std::string& text, const std::string& advice = "") {
    fmt::print("{:4} {:12} {}\n", good ? "ok" : "!!", what, text);
    if (!good && !advice.empty()) fmt::print("     {:12} {}\n", "", advice);
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
    const bool written = ::write(file, block.data(), block.size()) == static_cast<ssize_t>(block.size()) &&
                         ::fdatasync(file) == 0;
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

}  // namespace

bool doctor(const std::string& folder, bool offline_installed) {
  Report report;
  report.line(true, "knothe",
              fmt::format("{} (g++ {}, vectors: {})", k_version, __VERSION__, vectors_built_for()));
  report.line(true, "libraries",
              fmt::format("Eigen {}.{}.{}, SQLite {}, Boost {}", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION,
                          EIGEN_MINOR_VERSION, sqlite3_libversion(), BOOST_LIB_VERSION));
  report.line(true, "processor",
              fmt::format("{}, {} cores, {} threads by default", processor(),
                          std::thread::hardware_concurrency(), default_threads()));
  const double memory =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
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
  struct statvfs disk {};
  const bool known = ::statvfs(folder.c_str(), &disk) == 0;
  const double room = known ? static_cast<double>(disk.f_bavail) * static_cast<double>(disk.f_frsize) : 0;
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
  rlimit files{};
  getrlimit(RLIMIT_NOFILE, &files);
  report.line(files.rlim_cur >= 1024, "descriptors", fmt::format("{} files may be open", files.rlim_cur),
              "ulimit -n 4096, for many viewers");
  return report.all_good();
}

}  // namespace knothe::service
