#include "knothe/inference/evaluation_file.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/base/version.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/hdf5.hpp"

namespace knothe::inference {
namespace {

constexpr const char* k_kind = "model evaluations";
constexpr int k_schema_version = 1;

}  // namespace

Eigen::Index keep_evaluations(const std::string& path, const ModelEvaluator& evaluator,
                              const std::string& identity) {
  Eigen::MatrixXd points, values;
  evaluator.stored(points, values);
  const auto n = static_cast<std::size_t>(points.cols()), d = static_cast<std::size_t>(points.rows()),
             m = static_cast<std::size_t>(values.rows());
  if (n == 0) return 0;
  files::write_atomically(path, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    file.text_attribute("/", "kind", k_kind);
    file.integer_attribute("/", "schema_version", k_schema_version);
    file.text_attribute("/", "created_by", k_created_by);
    file.text_attribute("/", "identity", identity);
    // Column by column is row by row of the transpose.
    file.write("/points", {points.data(), n * d}, {n, d}, {"1", "points of the parameters"});
    file.write("/values", {values.data(), n * m}, {n, m}, {"1", "the model's outputs there"});
    file.close();
  });
  return points.cols();
}

KeptEvaluations take_evaluations(const std::string& path, ModelEvaluator& evaluator,
                                 const std::string& identity) {
  KeptEvaluations out;
  std::error_code none;
  if (!std::filesystem::exists(path, none)) return out;
  std::vector<double> points, values;
  const auto d = static_cast<std::size_t>(evaluator.model().dimension()),
             m = static_cast<std::size_t>(evaluator.model().output_count());
  std::size_t n = 0;
  try {
    const files::Hdf5Reader file(path);
    if (file.text_attribute("/", "kind") != k_kind ||
        file.number_attribute("/", "schema_version") != k_schema_version) {
      out.refused = "it is no such file";
      return out;
    }
    if (file.text_attribute("/", "identity") != identity) {
      out.refused = "they are of another model or another configuration";
      return out;
    }
    const files::Shape shape = file.shape("/points");
    n = shape.empty() ? 0 : shape[0];
    points = file.read("/points", {n, d});
    values = file.read("/values", {n, m});
  } catch (const DataError& error) {
    out.refused = error.what();
    return out;
  }
  const auto rows = static_cast<Eigen::Index>(n);
  if (rows == 0) return out;
  const Eigen::Map<const Eigen::MatrixXd> p(points.data(), static_cast<Eigen::Index>(d), rows),
      v(values.data(), static_cast<Eigen::Index>(m), rows);
  Eigen::MatrixXd some(p.rows(), 3), now;
  const Eigen::Index chosen[] = {0, rows / 2, rows - 1};
  for (Eigen::Index i = 0; i < 3; ++i) some.col(i) = p.col(chosen[i]);
  evaluator.evaluate(some, now);
  for (Eigen::Index i = 0; i < 3; ++i) {
    const auto before = v.col(chosen[i]);
    if ((now.col(i) - before).cwiseAbs().maxCoeff() <= 1e-9 * before.cwiseAbs().maxCoeff()) continue;
    out.refused = "the model answers otherwise now";
    return out;
  }
  evaluator.remember(p, v);
  out.taken = rows;
  return out;
}

}  // namespace knothe::inference
