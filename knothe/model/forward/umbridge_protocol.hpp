#pragma once
/// @file The words of UM-Bridge 1.0: JSON requests and answers, checked. Private to this room.
#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "knothe/model/forward/http_connection.hpp"

namespace knothe::model::umbridge {

using Json = nlohmann::json;

/// One answer as a JSON object; errors (an error object of the server, a status that is not 200, a text that
/// is not JSON) are DataErrors that begin with `where` and hold the server's own words. With `infinities`,
/// −Infinity, which JSON does not have but servers write, is read as −1.8e308.
[[nodiscard]] Json read_answer(const HttpAnswer& answer, const std::string& where, bool infinities = false);

/// Entry `key` of an answer; DataError if it lacks it.
[[nodiscard]] const Json& member(const Json& answer, const std::string& key, const std::string& where);

/// Positive sizes of vectors: [2, 1].
[[nodiscard]] std::vector<std::size_t> read_sizes(const Json& answer, const std::string& key,
                                                  const std::string& where);

/// A vector of numbers of a fixed length into `out`; `what` names it in messages: "output[0]".
void read_vector(const Json& array, Eigen::Ref<Eigen::VectorXd> out, const std::string& what,
                 const std::string& where);

/// `values` cut into vectors of these sizes.
[[nodiscard]] Json cut(const Eigen::Ref<const Eigen::VectorXd>& values,
                       const std::vector<std::size_t>& sizes);

}  // namespace knothe::model::umbridge
