#include "knothe/posterior/weighted_posterior_file.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <sstream>

#include "knothe/base/error.hpp"
#include "knothe/files/hdf5.hpp"

namespace knothe::posterior {
namespace {

std::string file_in(const std::string& path) {
  const std::filesystem::path given(path);
  if (!std::filesystem::is_directory(given)) return path;
  for (const char* name : {"posterior.nc", "samples.nc"})
    if (std::filesystem::exists(given / name)) return (given / name).string();
  throw DataError(fmt::format(
      "{}: holds neither posterior.nc nor samples.nc: give the folder of results of `knothe assimilate` or "
      "`knothe infer`",
      path));
}

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

std::vector<std::string> listed(const files::Hdf5Reader& file, const std::string& object, const char* name) {
  std::vector<std::string> found;
  std::istringstream list(file.text_attribute(object, name));
  for (std::string entry; std::getline(list, entry, ',');) found.push_back(entry);
  return found;
}

PriorValues read_prior(const files::Hdf5Reader& file, const std::string& group, std::size_t n,
                       std::size_t d) {
  const auto vector = [&](const char* name, std::size_t size) -> Eigen::VectorXd {
    const std::vector<double> values = file.read(group + name, files::Shape{size});
    return Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values));
  };
  PriorValues prior;
  for (const std::string& family : listed(file, group, "prior_families")) {
    const auto known = from_text<Prior::Family>(family);
    if (!known)
      throw DataError(
          fmt::format("{}: {}: attribute prior_families: \"{}\" is unknown", file.path(), group, family));
    prior.families.push_back(*known);
  }
  if (prior.families.size() != d)
    throw DataError(fmt::format("{}: {}: attribute prior_families must name one for each of {} parameters",
                                file.path(), group, d));
  prior.mean = vector("prior_mean", d);
  prior.std = vector("prior_std", d);
  const std::vector<double> values = file.read(group + "log_prior", files::Shape{n, d});
  prior.log_density = Eigen::Map<const RowMajor>(values.data(), n, d);
  if (file.has(group + "log_dependence")) prior.log_dependence = vector("log_dependence", n);
  return prior;
}

}  // namespace

WeightedPosterior read_weighted_posterior(const std::string& path) {
  const files::Hdf5Reader file(file_in(path));
  if (!file.has("/weighted_posterior"))
    throw DataError(file.path() + ": has no group weighted_posterior: it is not a posterior of knothe");
  WeightedPosterior found;
  found.parameters = listed(file, "/weighted_posterior", "parameters");
  // Files before 0.2 have the last step among the others only.
  const std::string group = file.has("/last_posterior") ? "/last_posterior/" : "/weighted_posterior/";
  const files::Shape shape = file.shape(group + "points");
  const std::size_t d = found.parameters.size();
  if (shape.size() < 2 || shape.size() > 3 || shape[0] == 0 || shape.back() != d)
    throw DataError(file.path() + ": " + group.substr(1) +
                    "points must have the shape [point, parameter] or [step, point, parameter]");
  const std::size_t n = shape[shape.size() - 2];
  const bool has_steps = shape.size() == 3;
  const std::size_t last = shape[0] - 1;
  const std::vector<double> points =
      has_steps ? file.read_slab(group + "points", {last, 0, 0}, {1, n, d}) : file.read(group + "points");
  const std::vector<double> weights = has_steps ? file.read_slab(group + "weights", {last, 0}, {1, n})
                                                : file.read(group + "weights", files::Shape{n});
  const Eigen::Index rows = n, columns = d;
  found.points = Eigen::Map<const RowMajor>(points.data(), rows, columns);
  found.weights = Eigen::Map<const Eigen::VectorXd>(weights.data(), rows);
  const double sum = found.weights.sum();
  if (!(found.weights.minCoeff() >= 0) || !(sum > 0))
    throw DataError(file.path() + ": " + group.substr(1) + "weights must not be negative, nor all zero");
  if (std::abs(sum - 1) > 1e-9) found.weights /= sum;  // as they are where they are normalised: to the bit
  if (file.has(group + "log_prior")) found.prior = read_prior(file, group, n, d);
  return found;
}

}  // namespace knothe::posterior
