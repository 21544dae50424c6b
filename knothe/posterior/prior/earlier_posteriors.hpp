#pragma once
/// @file Posteriors in files of results as priors of what comes next.
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "knothe/posterior/prior/prior.hpp"

namespace knothe::posterior {

/// Each file is read once, and its parameters are one joint prior.
class EarlierPosteriors {
 public:
  /// Of the parameter that the results in `path` (a folder, or its file) call `name`. Errors: DataError of a
  /// file; ProjectError, with the names that it has, for one that it does not have.
  [[nodiscard]] Prior prior_of(const std::string& path, const std::string& name);

 private:
  struct Earlier {
    std::vector<std::string> parameters;
    std::shared_ptr<const JointPrior> joint;
  };
  std::map<std::string, Earlier> of_file_;
};

}  // namespace knothe::posterior
