#include "knothe/posterior/draws/importance_proposal.hpp"

#include "knothe/posterior/draws/mixture_fit.hpp"

namespace knothe::posterior {
namespace {

void append(const std::vector<MixtureComponent>& some, double share, std::vector<MixtureComponent>& all) {
  double total = 0;
  for (const MixtureComponent& c : some) total += c.weight;
  for (const MixtureComponent& c : some) all.push_back({c.weight * share / total, c.centre, c.lower});
}

}  // namespace

void ImportanceProposal::fit(Groups groups, const WeightedPoints& target, const WeightedPoints& flattened) {
  if (groups != groups_) {
    groups_ = std::move(groups);
    target_.assign(groups_.size(), {});
    flattened_.clear();
    for (const auto& group : groups_)
      flattened_.push_back(fit_mixture(columns_of(flattened.points, group), flattened.weights));
  }
  for (std::size_t g = 0; g < groups_.size(); ++g)
    target_[g] = fit_mixture(columns_of(target.points, groups_[g]), target.weights, std::move(target_[g]));
}

std::size_t ImportanceProposal::components() const {
  std::size_t n = 0;
  for (const auto& c : target_) n += c.size();
  return n;
}

MixtureProduct ImportanceProposal::mixtures(SupportEnds ends) const {
  std::vector<MixtureProduct::Factor> factors;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const auto d = std::ssize(groups_[g]);
    std::vector<MixtureComponent> all = {
        {shares_.reference, Eigen::VectorXd::Zero(d), Eigen::MatrixXd::Identity(d, d)}};
    append(target_[g], 1 - shares_.reference - shares_.flat, all);
    append(flattened_[g], shares_.flat, all);
    factors.push_back({groups_[g], Mixture(std::move(all), tails_)});
  }
  return MixtureProduct(std::move(factors), std::move(ends));
}

}  // namespace knothe::posterior
