#include "knothe/service/site/line_archive.hpp"

#include <cassert>
#include <cstring>
#include <type_traits>

namespace knothe::service {
namespace {

template <class T>
concept Plain = std::is_trivially_copyable_v<T>;

/// Appends.
class Writer {
 public:
  explicit Writer(std::string& bytes) : bytes_(bytes) {}
  template <class... T>
  void operator()(const T&... values) {
    (put(values), ...);
  }

 private:
  void append(const void* data, std::size_t size) { bytes_.append(static_cast<const char*>(data), size); }
  template <Plain T>
  void put(const T& value) {
    append(&value, sizeof value);
  }
  void put(const std::string& text) {
    put(text.size());
    bytes_ += text;
  }
  template <int Columns>
  void put(const Eigen::Matrix<double, Eigen::Dynamic, Columns>& matrix) {
    put(matrix.rows());
    put(matrix.cols());
    append(matrix.data(), matrix.size() * sizeof(double));
  }
  template <class T>
  void put(const std::vector<T>& values) {
    put(values.size());
    for (const T value : values) put(value);
  }
  void put(const std::map<std::string, double>& values) {
    put(values.size());
    for (const auto& [name, value] : values) (*this)(name, value);
  }

  std::string& bytes_;
};

/// Takes away from the front.
class Reader {
 public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}
  template <class... T>
  void operator()(T&... values) {
    (get(values), ...);
  }

 private:
  void take(void* data, std::size_t size) {
    assert(size <= bytes_.size());
    std::memcpy(data, bytes_.data(), size);
    bytes_.remove_prefix(size);
  }
  template <Plain T>
  [[nodiscard]] T next() {
    T value;
    take(&value, sizeof value);
    return value;
  }
  template <Plain T>
  void get(T& value) {
    value = next<T>();
  }
  void get(std::string& text) {
    text.resize(next<std::size_t>());
    take(text.data(), text.size());
  }
  template <int Columns>
  void get(Eigen::Matrix<double, Eigen::Dynamic, Columns>& matrix) {
    const auto rows = next<Eigen::Index>(), columns = next<Eigen::Index>();
    matrix.resize(rows, columns);
    if (matrix.size() > 0) take(matrix.data(), matrix.size() * sizeof(double));
  }
  template <class T>
  void get(std::vector<T>& values) {
    values.resize(next<std::size_t>());
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = next<T>();
  }
  void get(std::map<std::string, double>& values) {
    for (auto count = next<std::size_t>(); count > 0; --count) {
      std::string name;
      get(name);
      values[name] = next<double>();
    }
  }

  std::string_view bytes_;
};

/// One list of members for both ways. `L` is `Line`, const or not.
template <class Archive, class L>
void exchange(Archive& archive, L& line) {
  archive(line.event, line.step, line.time, line.withdrawn, line.json, line.mean, line.std, line.samples,
          line.missing, line.residual, line.above_threshold, line.trusted, line.remark, line.verdict,
          line.verdict_message, line.misfit, line.misfit_message, line.monitor_alarm, line.bias_corrected,
          line.stuck, line.absent, line.notice, line.bias.functions, line.bias.sensors, line.model_doubted);
}

}  // namespace

std::string bytes_of(const Line& line) {
  std::string bytes;
  Writer writer(bytes);
  exchange(writer, line);
  return bytes;
}

std::shared_ptr<Line> line_of_bytes(std::string_view bytes) {
  auto line = std::make_shared<Line>();
  Reader reader(bytes);
  exchange(reader, *line);
  return line;
}

}  // namespace knothe::service
