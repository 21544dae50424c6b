#pragma once
/// @file A JSON object that was read from a file, and where it stands: every message says so. Private to the
/// room.
#include <fmt/format.h>

#include <Eigen/Core>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"

namespace knothe::record {

/// A JSON object together with where it stands, so that every message can say so.
class JsonObject {
 public:
  JsonObject(const nlohmann::json& value, std::string where, std::string path = {})
      : value_(value), where_(std::move(where)), path_(std::move(path)) {
    if (!value_.is_object()) fail("an object { … } is expected");
  }
  [[noreturn]] void fail(const std::string& what) const {
    throw DataError(where_ + ": error: " + path_ + what);
  }
  [[nodiscard]] bool has(const char* key) const { return value_.contains(key) && !value_[key].is_null(); }
  [[nodiscard]] const nlohmann::json& at(const char* key) const {
    if (!value_.contains(key)) fail(fmt::format("key \"{}\" is missing", key));
    return value_[key];
  }
  [[nodiscard]] JsonObject object(const char* key) const { return member(key, at(key)); }
  /// `value`, which stands under `key` in this object.
  [[nodiscard]] JsonObject member(const std::string& key, const nlohmann::json& value) const {
    return {value, where_, path_ + '"' + key + "\": "};
  }
  /// The objects under `key` with their names; none where it is absent.
  [[nodiscard]] std::vector<std::pair<std::string, JsonObject>> named(const char* key) const {
    std::vector<std::pair<std::string, JsonObject>> all;
    if (!has(key)) return all;
    const JsonObject group = object(key);
    for (const auto& [name, entry] : group.value().items()) all.emplace_back(name, group.member(name, entry));
    return all;
  }
  /// The objects of a list.
  [[nodiscard]] std::vector<JsonObject> list(const char* key) const {
    std::vector<JsonObject> all;
    if (!at(key).is_array()) fail(fmt::format("\"{}\" must be a list", key));
    for (const nlohmann::json& entry : at(key)) all.push_back(member(key, entry));
    return all;
  }
  [[nodiscard]] double number(const char* key) const {
    const nlohmann::json& v = at(key);
    if (!v.is_number() || !std::isfinite(v.get<double>()))
      fail(fmt::format("\"{}\" must be a finite number", key));
    return v.get<double>();
  }
  [[nodiscard]] double number_or(const char* key, double otherwise) const {
    return has(key) ? number(key) : otherwise;
  }
  [[nodiscard]] std::optional<double> optional_number(const char* key) const {
    return has(key) ? std::optional<double>(number(key)) : std::nullopt;
  }
  [[nodiscard]] std::size_t count(const char* key) const {
    const nlohmann::json& v = at(key);
    if (!v.is_number_integer() || v.get<double>() < 0.0)
      fail(fmt::format("\"{}\" must be an integer ≥ 0", key));
    return v.get<std::size_t>();
  }
  [[nodiscard]] std::vector<double> numbers(const char* key) const { return numbers(at(key), key); }
  [[nodiscard]] std::vector<double> numbers(const nlohmann::json& v, const char* key) const {
    if (!v.is_array()) fail(fmt::format("\"{}\" must be a list of numbers", key));
    std::vector<double> out;
    for (const auto& entry : v) {
      if (!entry.is_number() || !std::isfinite(entry.get<double>()))
        fail(fmt::format("\"{}\"[{}] must be a finite number", key, out.size()));
      out.push_back(entry.get<double>());
    }
    return out;
  }
  [[nodiscard]] std::vector<double> numbers(const char* key, std::size_t size) const {
    auto out = numbers(key);
    if (out.size() != size)
      fail(fmt::format("\"{}\" has {} numbers, {} are expected", key, out.size(), size));
    return out;
  }
  [[nodiscard]] std::string text_or(const char* key, const std::string& otherwise = {}) const {
    if (!has(key)) return otherwise;
    const nlohmann::json& v = at(key);
    return v.is_string() ? v.get<std::string>() : v.dump();
  }
  [[nodiscard]] bool boolean(const char* key) const {
    if (!at(key).is_boolean()) fail(fmt::format("\"{}\" must be true or false", key));
    return at(key).get<bool>();
  }
  [[nodiscard]] Eigen::VectorXd vector(const char* key) const {
    const auto all = numbers(key);
    return Eigen::Map<const Eigen::VectorXd>(all.data(), std::ssize(all));
  }
  /// A list of rows of the same length.
  [[nodiscard]] Eigen::MatrixXd matrix(const char* key) const {
    const auto& list = at(key);
    if (!list.is_array()) fail(fmt::format("\"{}\" must be a list of rows", key));
    Eigen::MatrixXd matrix;
    for (Index i = 0; i < std::ssize(list); ++i) {
      const std::vector<double> row = numbers(list[i], key);
      if (i == 0) matrix.resize(std::ssize(list), std::ssize(row));
      if (std::ssize(row) != matrix.cols())
        fail(fmt::format("the rows of \"{}\" have different lengths", key));
      matrix.row(i) = Eigen::Map<const Eigen::RowVectorXd>(row.data(), std::ssize(row));
    }
    return matrix;
  }
  [[nodiscard]] const nlohmann::json& value() const { return value_; }

 private:
  const nlohmann::json& value_;
  std::string where_;  ///< file and line
  std::string path_;   ///< keys that lead to the object
};

}  // namespace knothe::record
