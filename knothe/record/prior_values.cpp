#include "knothe/record/prior_values.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <utility>
#include <vector>

#include "knothe/posterior/prior/prior_values.hpp"

namespace knothe::record {

void add_prior_values(const std::string& group, std::span<const posterior::Prior> priors,
                      const Eigen::MatrixXd& points, files::NetcdfWriter& out) {
  using Names = std::vector<std::string>;
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const posterior::PriorValues values = posterior::prior_values(priors, points);
  const auto span_of = [](const auto& matrix) { return std::span(matrix.data(), matrix.size()); };
  const RowMajor log_density = values.log_density;
  Names families;
  for (const posterior::Prior::Family family : values.families) families.push_back(to_text(family));
  out.add_variable(group, "log_prior", Names{"point", "parameter"}, span_of(log_density),
                   {"1", "logarithm of each prior's density at the points"});
  for (const auto& [name, vector] :
       {std::pair("prior_mean", values.mean), std::pair("prior_std", values.std)})
    out.add_variable(group, name, Names{"parameter"}, span_of(vector),
                     {"1", "before truncation; of the logarithm of a lognormal parameter"});
  out.add_attribute(group, "prior_families", fmt::format("{}", fmt::join(families, ",")));
  if (values.log_dependence.size() > 0)
    out.add_variable(group, "log_dependence", Names{"point"}, span_of(values.log_dependence),
                     {"1", "logarithm of the joint prior's density over the product of the priors"});
}

}  // namespace knothe::record
