#pragma once
/// @file Counters and histograms in Prometheus' text format.
#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace knothe::service {

/// Times in seconds, counted in fixed buckets.
class Histogram {
 public:
  static constexpr std::array<double, 13> k_bounds = {0.0002, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02,
                                                      0.05,   0.1,    0.2,   0.5,   1,     5};
  void observe(double seconds);
  /// Appends `name_bucket{labels,le="…"} …`, sum and count; `labels` as `a="b",c="d"`.
  void write(std::string& out, const std::string& name, const std::string& labels) const;

 private:
  std::array<std::uint64_t, k_bounds.size() + 1> counts_{};
  double sum_ = 0;
};

/// Everything counted, by name and labels. Thread-safe.
class Metrics {
 public:
  void count(const std::string& name, const std::string& labels, double by = 1);
  void set(const std::string& name, const std::string& labels, double value);
  void observe(const std::string& name, const std::string& labels, double seconds);
  /// A gauge that no longer has a value.
  void forget(const std::string& name, const std::string& labels);
  [[nodiscard]] double value(const std::string& name, const std::string& labels) const;
  /// The whole text, with what the process itself uses (memory, processor time, descriptors).
  [[nodiscard]] std::string text() const;

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::map<std::string, double>> counters_, gauges_;
  std::map<std::string, std::map<std::string, Histogram>> histograms_;
};

/// `text` as the value of a label.
[[nodiscard]] std::string label_value(const std::string& text);
/// Labels of what a site counts: its name, and `more`.
[[nodiscard]] std::string site_labels(const std::string& site, const std::string& more = "");

}  // namespace knothe::service
