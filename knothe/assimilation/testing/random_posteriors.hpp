#pragma once
/// @file Random separated models of three to eight parameters whose posteriors are hard: several modes,
/// ridges, rings, funnels, edges of the box, directions that the data say nothing of.
///
/// A model is a chain of blocks of one to three parameters. Of half of the neighbours in it the data also
/// measure the sum of their first parameters; without that the data do not couple blocks. So the posterior of
/// a block is, but for factors of its first parameter, that of its own data: dense quadrature block by block,
/// and sums along the chain, are an exact answer in any dimension.
#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "knothe/assimilation/testing/dense_quadrature.hpp"
#include "knothe/likelihood/noise/noise_model.hpp"
#include "knothe/likelihood/step/collapsed_posterior.hpp"
#include "knothe/likelihood/step/datum_projector.hpp"
#include "knothe/likelihood/step/prior_of_model.hpp"
#include "knothe/model/observe/observed_model.hpp"
#include "knothe/model/reduced/spline_functions.hpp"

namespace knothe::assimilation::test {

/// Σ over terms of a product of one-variable functions: one observation.
using OneVariable = std::function<double(double)>;
struct Term {
  double factor;
  std::vector<OneVariable> functions;  ///< one per parameter of the block
};
struct Observation {
  std::vector<Term> terms;
  double std;  ///< of all steps together
};
struct Block {
  std::string kind;
  bool is_hard;  ///< several modes, or far from a Gaussian
  std::vector<double> truth;
  std::vector<Observation> observations;
};

inline constexpr double k_half_width = 3;  ///< of the box, whose middle is 0

class RandomPosterior {
 public:
  RandomPosterior(Eigen::Index dimension, unsigned seed, Eigen::Index steps = 6)
      : random_(seed), steps_(steps) {
    Eigen::Index hard = 0;
    while (dimension_ < dimension) {
      Block block = random_block(dimension - dimension_, hard < k_max_hard_blocks);
      hard += block.is_hard;
      dimension_ += static_cast<Eigen::Index>(block.truth.size());
      blocks_.push_back(std::move(block));
    }
    for (std::size_t b = 0; b < blocks_.size(); ++b) {
      if (b > 0) links_.push_back(uniform(0, 1) < 0.5 ? uniform(0.1, 1) : 0);
      name += (b == 0 ? "" : links_.back() > 0 ? " with " : " + ") + blocks_[b].kind;
    }
    draw_data();
    model = make_model(blocks_, links_);
  }

  std::string name;
  std::shared_ptr<const model::ObservedModel> model;

  [[nodiscard]] Eigen::Index steps() const { return steps_; }
  [[nodiscard]] likelihood::NoiseModel noise() const { return likelihood::NoiseModel::independent(std_); }
  [[nodiscard]] std::vector<posterior::Prior> priors() const {
    return std::vector<posterior::Prior>(static_cast<std::size_t>(dimension_), prior());
  }
  [[nodiscard]] Eigen::VectorXd datum(Eigen::Index step) const { return data_.col(step); }

  /// Mean, standard deviations and log-evidence of the steps 0 … step.
  struct Answer {
    Eigen::VectorXd mean, std;
    double log_evidence = 0;
    bool resolved = true;
  };
  [[nodiscard]] Answer exact(Eigen::Index step) const {
    Answer answer{Eigen::VectorXd(dimension_), Eigen::VectorXd(dimension_)};
    std::vector<Part> parts;
    Eigen::Index row = 0;
    for (const Block& block : blocks_) {
      const auto rows = static_cast<Eigen::Index>(block.observations.size());
      parts.push_back(part(block, row, step, answer));
      row += rows;
    }
    // What the blocks before (after) tell of each one's first parameter.
    for (std::size_t b = 0; b + 1 < parts.size(); ++b)
      parts[b + 1].before = links_[b] > 0 ? Eigen::VectorXd(link(b, parts, step).transpose() *
                                                            parts[b].before.cwiseProduct(parts[b].own.mass))
                                          : scaled(parts[b + 1].own.mass, parts[b].total_before());
    for (std::size_t b = parts.size() - 1; b > 0; --b)
      parts[b - 1].after =
          links_[b - 1] > 0
              ? Eigen::VectorXd(link(b - 1, parts, step) * parts[b].after.cwiseProduct(parts[b].own.mass))
              : scaled(parts[b - 1].own.mass, parts[b].total_after());
    Eigen::Index parameter = 0;
    for (const Part& p : parts) {
      const Eigen::VectorXd others = p.before.cwiseProduct(p.after);
      const double total = others.dot(p.own.mass);
      const Eigen::Index d = p.own.first.cols();
      const Eigen::VectorXd mean = p.own.first.transpose() * others / total;
      answer.mean.segment(parameter, d) = mean;
      answer.std.segment(parameter, d) =
          (p.own.second.transpose() * others / total - mean.cwiseAbs2()).cwiseSqrt();
      parameter += d;
    }
    answer.log_evidence += std::log(parts.back().total_before());
    return answer;
  }

  /// The same on one grid over all parameters, of which there are three at most.
  [[nodiscard]] Answer exact_on_one_grid(Eigen::Index step) const {
    const auto transform = likelihood::truncated_to_box(*model, priors());
    const auto value = [&](Eigen::Index k, double z) {
      return transform->prior(k).from_standard_normal(z).value;
    };
    auto target = target_of(model, transform, 0, step);
    const DenseQuadrature grid(*target, value, dimension_ == 1 ? 4001 : dimension_ == 2 ? 601 : 151);
    return {grid.mean, grid.covariance.diagonal().cwiseSqrt(), grid.log_evidence, grid.resolved};
  }

 private:
  static constexpr Eigen::Index k_max_hard_blocks = 2, k_nodes = 41;
  static posterior::Prior prior() { return posterior::Prior::normal(0, 1.5); }
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  /// Posterior of a block by its own data, along its first parameter, and what the other blocks tell of that.
  struct Part {
    Eigen::VectorXd at;  ///< the first parameter
    DenseQuadrature::ByFirst own;
    Eigen::VectorXd before, after;
    [[nodiscard]] double total_before() const { return before.dot(own.mass); }
    [[nodiscard]] double total_after() const { return after.dot(own.mass); }
  };
  static Eigen::VectorXd scaled(const Eigen::VectorXd& like, double value) {
    return Eigen::VectorXd::Constant(like.size(), value);
  }

  /// The collapsed posterior of a model of the rows from `row` on, given the data of steps 0 … step.
  std::unique_ptr<likelihood::CollapsedLogDensity> target_of(
      const std::shared_ptr<const model::ObservedModel>& some,
      const std::shared_ptr<const posterior::PriorTransform>& transform, Eigen::Index row,
      Eigen::Index step) const {
    const Eigen::Index rows = some->space.rows();
    likelihood::DatumProjector projector(some, likelihood::NoiseModel::independent(std_.segment(row, rows)),
                                         likelihood::medians(*transform));
    auto target = std::make_unique<likelihood::CollapsedLogDensity>(some->functions, transform,
                                                                    projector.central_functions());
    likelihood::StepForm sum = likelihood::StepForm::zero(some->functions->count()), form;
    for (Eigen::Index t = 0; t <= step; ++t) {
      projector.project(static_cast<std::size_t>(t), static_cast<std::size_t>(t),
                        data_.col(t).segment(row, rows), form);
      sum.add(form);
    }
    target->set_form(sum);
    return target;
  }

  Part part(const Block& block, Eigen::Index row, Eigen::Index step, Answer& answer) const {
    const auto d = static_cast<Eigen::Index>(block.truth.size());
    const auto model_of_block = make_model({block}, {});
    const auto transform = likelihood::truncated_to_box(
        *model_of_block, std::vector<posterior::Prior>(static_cast<std::size_t>(d), prior()));
    const auto target = target_of(model_of_block, transform, row, step);
    const auto value = [&](Eigen::Index k, double z) {
      return transform->prior(k).from_standard_normal(z).value;
    };
    Eigen::Index nodes = d == 1 ? 4001 : d == 2 ? 601 : 151;
    auto quadrature = std::make_unique<DenseQuadrature>(*target, value, nodes);
    for (int finer = 0; finer < 2 && !quadrature->resolved; ++finer)
      quadrature = std::make_unique<DenseQuadrature>(*target, value, nodes = nodes * 3 / 2);
    const DenseQuadrature& grid = *quadrature;
    answer.log_evidence += grid.log_evidence;
    answer.resolved = answer.resolved && grid.resolved;
    Part p{Eigen::VectorXd(nodes), grid.by_first(value), Eigen::VectorXd::Ones(nodes),
           Eigen::VectorXd::Ones(nodes)};
    for (Eigen::Index i = 0; i < nodes; ++i) p.at[i] = value(0, grid.node(0, i));
    return p;
  }

  /// Likelihood of the data on the sum of the first parameters of blocks b (rows) and b + 1 (columns).
  Eigen::MatrixXd link(std::size_t b, const std::vector<Part>& parts, Eigen::Index step) const {
    Eigen::Index row = std_.size();
    for (std::size_t l = links_.size(); l-- > b;) row -= links_[l] > 0;
    const Eigen::ArrayXd data = data_.row(row).head(step + 1).transpose();
    const double n = static_cast<double>(step + 1), std = std_[row];
    const double scatter = (data - data.mean()).square().sum();
    const double constant = -0.5 * scatter / (std * std) - n * std::log(std * std::sqrt(2 * M_PI));
    const Eigen::ArrayXXd sum = parts[b].at.replicate(1, parts[b + 1].at.size()).array() +
                                parts[b + 1].at.transpose().replicate(parts[b].at.size(), 1).array();
    return (constant - 0.5 * n * ((sum - data.mean()) / std).square()).exp().matrix();
  }

  double sign() { return uniform(0, 1) < 0.5 ? -1 : 1; }

  Block random_block(Eigen::Index room, bool may_be_hard) {
    const OneVariable one = [](double) { return 1.0; };
    const OneVariable x = [](double v) { return v; };
    const OneVariable square = [](double v) { return v * v; };
    const OneVariable shrinks = [](double v) { return std::exp(-v); };
    const auto bent = [&](double std) { return Observation{{{1, {one, x}}, {-1, {square, one}}}, std}; };
    const std::vector<std::function<Block()>> easy = {
        [&] {
          return Block{"gaussian", false, {uniform(-1.5, 1.5)}, {{{{1, {x}}}, uniform(0.03, 0.5)}}};
        },
        [&] {
          return Block{"edge", false, {sign() * k_half_width}, {{{{1, {x}}}, uniform(0.05, 0.5)}}};
        },
        [&] {
          return Block{"unidentified", false, {uniform(-1, 1)}, {{{{0.02, {x}}}, 1}}};
        },
        [&] {
          return Block{"ridge",
                       false,
                       {uniform(-1, 1), uniform(-1, 1)},
                       {{{{1, {x, one}}, {1, {one, x}}}, uniform(0.02, 0.15)}}};
        }};
    const std::vector<std::function<Block()>> hard = {
        [&] {
          return Block{"two modes", true, {uniform(0.8, 2)}, {{{{1, {square}}}, uniform(0.1, 0.6)}}};
        },
        [&] {
          return Block{"unequal modes",
                       true,
                       {uniform(0.8, 2)},
                       {{{{1, {square}}}, uniform(0.1, 0.6)}, {{{1, {x}}}, uniform(1, 3)}}};
        },
        [&] {
          return Block{"banana",
                       true,
                       {uniform(-1, 1), uniform(0, 1)},
                       {{{{1, {x, one}}}, uniform(0.3, 1)}, bent(uniform(0.05, 0.3))}};
        },
        [&] {
          return Block{"double banana",
                       true,
                       {uniform(0.8, 1.3), uniform(1, 2)},
                       {{{{1, {square, one}}}, uniform(0.2, 0.5)}, bent(uniform(0.05, 0.3))}};
        },
        [&] {
          return Block{"ring",
                       true,
                       {uniform(0.7, 1.4), uniform(0.7, 1.4)},
                       {{{{1, {square, one}}, {1, {one, square}}}, uniform(0.1, 0.6)}}};
        },
        [&] {
          return Block{"sphere",
                       true,
                       {uniform(0.6, 1.2), uniform(0.6, 1.2), uniform(0.6, 1.2)},
                       {{{{1, {square, one, one}}, {1, {one, square, one}}, {1, {one, one, square}}},
                         uniform(0.15, 0.6)}}};
        },
        [&] {
          return Block{"funnel", true, {uniform(-1, 1), 0}, {{{{1, {shrinks, x}}}, uniform(0.2, 0.6)}}};
        },
        [&] {
          return Block{"Rosenbrock", true, {1, 1}, {{{{1, {x, one}}}, 1}, bent(uniform(0.1, 0.3))}};
        },
        [&] {
          return Block{
              "product", true, {uniform(0.6, 1.5), uniform(0.6, 1.5)}, {{{{1, {x, x}}}, uniform(0.1, 0.4)}}};
        }};
    const auto& kinds = may_be_hard ? hard : easy;
    for (;;) {
      const auto k = static_cast<std::size_t>(uniform(0, static_cast<double>(kinds.size())));
      Block block = kinds[std::min(k, kinds.size() - 1)]();
      if (static_cast<Eigen::Index>(block.truth.size()) <= room) return block;
    }
  }

  void draw_data() {
    std::normal_distribution<double> normal;
    std::vector<double> value, std;
    const auto add = [&](double exact, double std_of_all) {
      value.push_back(exact);
      std.push_back(std_of_all * std::sqrt(static_cast<double>(steps_)));
    };
    for (const Block& block : blocks_) {
      for (const Observation& o : block.observations) {
        double sum = 0;
        for (const Term& term : o.terms) {
          double product = term.factor;
          for (std::size_t a = 0; a < term.functions.size(); ++a)
            product *= term.functions[a](block.truth[a]);
          sum += product;
        }
        add(sum, o.std);
      }
    }
    for (std::size_t b = 0; b < links_.size(); ++b)
      if (links_[b] > 0) add(blocks_[b].truth[0] + blocks_[b + 1].truth[0], links_[b]);
    std_ = Eigen::Map<Eigen::VectorXd>(std.data(), static_cast<Eigen::Index>(std.size()));
    data_.resize(std_.size(), steps_);
    for (Eigen::Index t = 0; t < steps_; ++t)
      for (Eigen::Index i = 0; i < std_.size(); ++i)
        data_(i, t) = value[static_cast<std::size_t>(i)] + std_[i] * normal(random_);
  }

  /// One row for each observation of each block, then one for each link.
  std::shared_ptr<const model::ObservedModel> make_model(const std::vector<Block>& blocks,
                                                         const std::vector<double>& links) const {
    std::size_t d = 0, n = 0, r = 0;
    for (const Block& block : blocks) {
      d += block.truth.size(), n += block.observations.size();
      for (const Observation& o : block.observations) r += o.terms.size();
    }
    for (const double link : links)
      if (link > 0) n += 1, r += 2;
    std::vector<double> nodes(k_nodes);
    for (std::size_t i = 0; i < nodes.size(); ++i)
      nodes[i] = k_half_width * (2.0 * static_cast<double>(i) / (k_nodes - 1) - 1);
    std::vector<std::vector<double>> values(d, std::vector<double>(r * k_nodes, 1.0));
    auto result = std::make_shared<model::ObservedModel>();
    result->space.setZero(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(r));
    std::size_t row = 0, k = 0;
    const auto add = [&](const Term& term, std::size_t parameter) {
      for (std::size_t a = 0; a < term.functions.size(); ++a)
        for (std::size_t i = 0; i < nodes.size(); ++i)
          values[parameter + a][k * k_nodes + i] = term.functions[a](nodes[i]);
      result->space(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(k++)) = term.factor;
    };
    std::vector<std::size_t> first{0};
    for (const Block& block : blocks) {
      for (const Observation& o : block.observations) {
        for (const Term& term : o.terms) add(term, first.back());
        ++row;
      }
      first.push_back(first.back() + block.truth.size());
    }
    const Term itself{1, {[](double v) { return v; }}};
    for (std::size_t b = 0; b < links.size(); ++b) {
      if (!(links[b] > 0)) continue;
      add(itself, first[b]), add(itself, first[b + 1]);
      ++row;
    }
    const std::vector<std::vector<double>> axes(d, nodes);
    result->functions =
        std::make_shared<model::CanonicalFunctions>(axes, values, static_cast<Eigen::Index>(r));
    for (std::size_t a = 0; a < d; ++a) result->parameters.push_back("p" + std::to_string(a));
    for (Eigen::Index t = 0; t < steps_; ++t) {
      result->time.push_back(static_cast<double>(t));
      result->core.emplace_back(
          Eigen::MatrixXd::Identity(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(r)));
    }
    result->lift.setZero(static_cast<Eigen::Index>(n), steps_);
    return result;
  }

  std::mt19937_64 random_;
  Eigen::Index dimension_ = 0, steps_;
  std::vector<Block> blocks_;
  std::vector<double> links_;  ///< between block b and the next: std of what is measured; 0: nothing is
  Eigen::VectorXd std_;
  Eigen::MatrixXd data_;
};

}  // namespace knothe::assimilation::test
