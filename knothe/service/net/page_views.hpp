#pragma once
/// @file What the page asks for (docs/reference/dashboard.md): description, mesh, fields, observations,
/// samples. Private to this room. RequestError 400 and 404 for what is not there.
#include <string>
#include <vector>

#include "knothe/service/site/served_site.hpp"

namespace knothe::service {

[[nodiscard]] Json description(const Site& site, const std::vector<std::string>& sites);
[[nodiscard]] Json mesh(const Site& site);
/// `step`: text of the query, empty for the latest.
[[nodiscard]] Json field(const Site& site, const std::string& name, const std::string& step,
                         const std::string& parameter);
/// The picture that the step was measured in, as PNG of 8 bits at most `k_picture_width` wide. Files are
/// those that the watched folder's thread has found, never one that a request names.
inline constexpr int k_picture_width = 1000;
[[nodiscard]] std::string picture(Site& site, const std::string& step);
[[nodiscard]] Json observations(const Site& site, const std::string& step);
/// The journals of this structure's tests, as they are beside the one that is served.
[[nodiscard]] Json tests_of(const ServedSite& served);
[[nodiscard]] Json samples(const Site& site, const std::string& step);
/// What to show first: the first series, else the displacement that is largest over its noise at the last
/// model time, predicted at the priors' centre.
[[nodiscard]] std::string first_signal(const Site& site);
/// What a sensor (index, or name of a series) measured up to a step, and the prediction of that step's
/// posterior at all model times.
[[nodiscard]] Json signal(const Site& site, const std::string& sensor, const std::string& step);

/// The line of that step. RequestError 404 NoState, 400 Malformed.
[[nodiscard]] std::shared_ptr<const Line> line_of(const Site& site, const std::string& step);
/// A step as a text. RequestError 400 naming `what`.
[[nodiscard]] std::size_t parse_index(const std::string& text, const std::string& what);

}  // namespace knothe::service
