#include "knothe/service/site/metrics.hpp"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "knothe/base/version.hpp"

namespace knothe::service {
namespace {

/// What each metric means; a name that is not here is a mistake of ours.
const std::map<std::string, std::string>& meanings() {
  static const std::map<std::string, std::string> k_meanings = {
      {"knothe_measurements_total", "Measurements by outcome."},
      {"knothe_requests_total", "HTTP requests by status."},
      {"knothe_connections", "Open HTTP connections."},
      {"knothe_event_streams", "Open event streams."},
      {"knothe_phase_seconds",
       "Time of each phase: commit, projection, map, correction, forecast; visible: from receipt to "
       "published."},
      {"knothe_deadline_misses_total", "Updates that were later than their deadline."},
      {"knothe_data_age_seconds", "Age of the last accepted datum."},
      {"knothe_state", "1 for the state that holds."},
      {"knothe_data_flow",
       "1 for waiting (for the first datum), arriving, silent or finished, whatever the state."},
      {"knothe_structure", "1 for the level of the verdict on the latest published step."},
      {"knothe_pending_measurements", "Accepted measurements that are not in the published line yet."},
      {"knothe_step", "Latest published step."},
      {"knothe_log_evidence", "Log-evidence of the latest published step."},
      {"knothe_effective_sample_size_ratio", "Effective sample size of the latest map."},
      {"knothe_journal_records", "Records in the journal."},
      {"knothe_quarantined_measurements", "Measurements in quarantine."},
      {"knothe_unacknowledged_alarms", "Warnings and alarms that nobody has acknowledged."},
      {"knothe_full_order_runs", "Runs of the full-order model at the posterior."},
      {"knothe_model_version", "How often the reduced model has been refined; 0: never."},
      {"knothe_alarms_sent_total", "Alarms by channel and outcome: sent, failed (retried), lost."},
      {"knothe_alarms_unsent", "Alarms that wait for their channel."},
      {"knothe_camera_connected", "1 while the camera is connected."},
      {"knothe_camera_frames_total", "Whole frames that came from the camera."},
      {"knothe_camera_incomplete_frames_total", "Frames that came with packets missing."},
      {"knothe_camera_lost_frames_total",
       "Frames that did not come whole though the camera was connected: missing pictures."},
      {"knothe_camera_reconnects_total", "How often the camera was connected again."},
      {"knothe_build_info", "1 for the version that runs."},
      {"process_cpu_seconds_total", "Processor time used, user and system."},
      {"process_resident_memory_bytes", "Resident memory."},
      {"process_open_fds", "Open file descriptors."},
  };
  return k_meanings;
}

void head(std::string& out, const std::string& name, const char* type) {
  const auto it = meanings().find(name);
  out += fmt::format("# HELP {} {}\n# TYPE {} {}\n", name, it == meanings().end() ? name : it->second, name,
                     type);
}

std::string braces(const std::string& labels) {
  return labels.empty() ? "" : "{" + labels + "}";
}

void write_process(std::string& out) {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) { return t.tv_sec + 1e-6 * t.tv_usec; };
  head(out, "process_cpu_seconds_total", "counter");
  out += fmt::format("process_cpu_seconds_total {}\n", seconds(usage.ru_utime) + seconds(usage.ru_stime));
  long pages = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> pages >> resident;
  head(out, "process_resident_memory_bytes", "gauge");
  out += fmt::format("process_resident_memory_bytes {}\n", resident * sysconf(_SC_PAGESIZE));
  std::error_code error;
  const auto descriptors = std::distance(std::filesystem::directory_iterator("/proc/self/fd", error),
                                         std::filesystem::directory_iterator());
  head(out, "process_open_fds", "gauge");
  out += fmt::format("process_open_fds {}\n", descriptors);
  head(out, "knothe_build_info", "gauge");
  out += fmt::format("knothe_build_info{{version=\"{}\"}} 1\n", k_version);
}

}  // namespace

void Histogram::observe(double seconds) {
  const auto place = std::lower_bound(k_bounds.begin(), k_bounds.end(), seconds) - k_bounds.begin();
  ++counts_[place];
  sum_ += seconds;
}

void Histogram::write(std::string& out, const std::string& name, const std::string& labels) const {
  std::uint64_t total = 0;
  const std::string comma = labels.empty() ? "" : labels + ",";
  for (std::size_t i = 0; i < counts_.size(); ++i) {
    total += counts_[i];
    const std::string bound = i < k_bounds.size() ? fmt::format("{}", k_bounds[i]) : "+Inf";
    out += fmt::format("{}_bucket{{{}le=\"{}\"}} {}\n", name, comma, bound, total);
  }
  out += fmt::format("{}_sum{} {}\n{}_count{} {}\n", name, braces(labels), sum_, name, braces(labels), total);
}

void Metrics::count(const std::string& name, const std::string& labels, double by) {
  const std::lock_guard lock(mutex_);
  counters_[name][labels] += by;
}

void Metrics::set(const std::string& name, const std::string& labels, double value) {
  const std::lock_guard lock(mutex_);
  gauges_[name][labels] = value;
}

void Metrics::observe(const std::string& name, const std::string& labels, double seconds) {
  const std::lock_guard lock(mutex_);
  histograms_[name][labels].observe(seconds);
}

void Metrics::forget(const std::string& name, const std::string& labels) {
  const std::lock_guard lock(mutex_);
  const auto gauge = gauges_.find(name);
  if (gauge == gauges_.end()) return;
  gauge->second.erase(labels);
  if (gauge->second.empty()) gauges_.erase(gauge);
}

double Metrics::value(const std::string& name, const std::string& labels) const {
  const std::lock_guard lock(mutex_);
  for (const auto* family : {&counters_, &gauges_}) {
    if (const auto it = family->find(name); it != family->end())
      if (const auto at = it->second.find(labels); at != it->second.end()) return at->second;
  }
  return 0;
}

std::string Metrics::text() const {
  std::string out;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [name, series] : counters_) {
      head(out, name, "counter");
      for (const auto& [labels, value] : series) out += fmt::format("{}{} {}\n", name, braces(labels), value);
    }
    for (const auto& [name, series] : gauges_) {
      head(out, name, "gauge");
      for (const auto& [labels, value] : series) out += fmt::format("{}{} {}\n", name, braces(labels), value);
    }
    for (const auto& [name, series] : histograms_) {
      head(out, name, "histogram");
      for (const auto& [labels, histogram] : series) histogram.write(out, name, labels);
    }
  }
  write_process(out);
  return out;
}

std::string label_value(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c == '\n' ? ' ' : c;
  }
  return out;
}

std::string site_labels(const std::string& site, const std::string& more) {
  return fmt::format("site=\"{}\"{}{}", label_value(site), more.empty() ? "" : ",", more);
}

}  // namespace knothe::service
