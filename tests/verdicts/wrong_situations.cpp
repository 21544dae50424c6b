#include "tests/verdicts/wrong_situations.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace knothe::verdicts {
namespace {

using assimilation::MisfitCause;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Random = std::mt19937_64;

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();
constexpr int k_nodes = 13;
constexpr double k_machine_stiffness = 4e8;  // N/m
constexpr std::size_t k_modes = 60;

MatrixXd white(Index rows, Index columns, Random& random) {
  std::normal_distribution<double> normal;
  return MatrixXd::NullaryExpr(rows, columns, [&](Index, Index) { return normal(random); });
}

Case case_of(const Reduced& model, MatrixXd values, bool force = false) {
  Case c;
  c.model = &model;
  c.force = force;
  c.time_indices.resize(static_cast<std::size_t>(values.cols()));
  std::iota(c.time_indices.begin(), c.time_indices.end(), std::size_t{0});
  c.values = std::move(values);
  return c;
}

const Reduced& good_model(BeamBench& bench) {
  return bench.reduced(modelled(), k_nodes, k_modes);
}

/// Displacements with noise.
MatrixXd measured(const History& exact, Random& random, double noise = k_noise) {
  const Index n = exact.rows() - 1;
  return exact.topRows(n) + noise * white(n, exact.cols(), random);
}

Case of_structure(BeamBench& bench, const Structure& structure, const Vector2d& truth, Random& random,
                  bool force) {
  const History& exact = bench.history(structure, truth);
  MatrixXd values = measured(exact, random);
  if (force) {
    values.conservativeResize(exact.rows(), Eigen::NoChange);
    values.bottomRows(1) = exact.bottomRows(1) + k_force_noise * white(1, exact.cols(), random);
  }
  Case c = case_of(good_model(bench), std::move(values), force);
  c.structure = &structure;
  return c;
}

/// A situation that changes good data.
Situation changed(const std::string& name, std::optional<MisfitCause> cause,
                  std::function<void(BeamBench&, Case&, Random&)> change) {
  return {name, cause, [change](BeamBench& bench, const Vector2d& truth, Random& random) {
            Case c = right_case(bench, truth, random);
            change(bench, c, random);
            return c;
          }};
}

Situation another_structure(const std::string& name, const Structure& structure, bool force = false) {
  return {name, std::nullopt, [&structure, force](BeamBench& bench, const Vector2d& truth, Random& random) {
            return of_structure(bench, structure, truth, random, force);
          }};
}

Situation another_model(const std::string& name, int nodes, std::size_t modes, model::Form form) {
  return {name, std::nullopt, [=](BeamBench& bench, const Vector2d& truth, Random& random) {
            return case_of(bench.reduced(modelled(), nodes, modes, form),
                           measured(bench.history(modelled(), truth), random));
          }};
}

/// A history between its steps.
Eigen::VectorXd at_time(const History& exact, double time) {
  const double at = std::clamp(time, 0.0, static_cast<double>(exact.cols() - 1));
  const Index left = std::min<Index>(static_cast<Index>(at), exact.cols() - 2);
  const double share = at - static_cast<double>(left);
  return (1 - share) * exact.col(left) + share * exact.col(left + 1);
}

/// The test's time is `time_of` (history, step).
Situation timed(const std::string& name, MisfitCause cause,
                std::function<double(const History&, Index)> time_of) {
  return {name, cause, [time_of](BeamBench& bench, const Vector2d& truth, Random& random) {
            const History& exact = bench.history(modelled(), truth);
            History other(exact.rows(), exact.cols());
            for (Index t = 0; t < exact.cols(); ++t) other.col(t) = at_time(exact, time_of(exact, t));
            return case_of(good_model(bench), measured(other, random));
          }};
}

/// The test's time runs by `steps` ahead of the data's.
Situation shifted(const std::string& name, double steps) {
  return timed(name, MisfitCause::time_shift,
               [steps](const History&, Index t) { return static_cast<double>(t) + steps; });
}

Structure structure(const std::string& name, const std::function<void(offline::BeamProblem&)>& change) {
  Structure s{name, modelled_beam()};
  change(s.problem);
  return s;
}

}  // namespace

const Structure& modelled() {
  static const Structure structure{"modelled", modelled_beam()};
  return structure;
}

std::vector<posterior::Prior> priors() {
  return {posterior::Prior::normal(0.9, std::sqrt(0.2)), posterior::Prior::normal(1.1, std::sqrt(0.2))};
}

Vector2d draw_truth(Random& random) {
  std::normal_distribution<double> normal;
  Vector2d p;
  const double means[] = {0.9, 1.1};
  for (Index k = 0; k < 2; ++k) do {
      p[k] = means[k] + std::sqrt(0.2) * normal(random);
    } while (p[k] < 0.5 || p[k] > 1.5);
  return p;
}

Vector2d outside_the_box(const Vector2d& truth) {
  return truth[0] < 0.95 ? Vector2d(1.8, truth[1]) : Vector2d(truth[0], 1.8);
}

Case right_case(BeamBench& bench, const Vector2d& truth, Random& random) {
  return case_of(good_model(bench), measured(bench.history(modelled(), truth), random));
}

std::vector<Situation> wrong_situations() {
  static const Structure face =
      structure("left face held", [](auto& p) { p.beam.left_support = offline::LeftSupport::left_face; });
  static const Structure stiff = structure("E 5 % higher", [](auto& p) { p.elastic.young_modulus *= 1.05; });
  static const Structure offset = structure("load 8 mm off", [](auto& p) { p.beam.load_offset = 0.008; });
  static const Structure deep = structure("notch 30 mm deep", [](auto& p) { p.beam.notch_depth = 0.03; });
  static const Structure fine = structure("elements of 5 mm", [](auto& p) { p.beam.element = 0.005; });
  static const Structure crushed = structure("damage under the load", [](auto& p) {
    p.beam.protected_half_width = 0;
    p.beam.protected_depth = 0;
  });
  static const Structure soft = structure("supports yield", [](auto& p) { p.beam.support_stiffness = 2e7; });
  const auto rows_of = [](BeamBench& bench, int component) {
    std::vector<Index> rows;
    for (std::size_t i = 0; i < bench.sensors().components.size(); ++i)
      if (bench.sensors().components[i] == component) rows.push_back(static_cast<Index>(i));
    return rows;
  };
  std::vector<Situation> all;
  all.push_back(
      changed("sign", MisfitCause::sign, [](BeamBench&, Case& c, Random&) { c.values = -c.values; }));
  all.push_back(changed("sign of y", MisfitCause::sign, [=](BeamBench& b, Case& c, Random&) {
    for (const Index i : rows_of(b, 1)) c.values.row(i) *= -1;
  }));
  all.push_back(
      changed("millimetres", MisfitCause::scale, [](BeamBench&, Case& c, Random&) { c.values *= 1e3; }));
  all.push_back(changed("swapped components", MisfitCause::component, [=](BeamBench& b, Case& c, Random&) {
    const auto x = rows_of(b, 0), y = rows_of(b, 1);
    for (std::size_t k = 0; k < x.size(); ++k) c.values.row(x[k]).swap(c.values.row(y[k]));
  }));
  all.push_back(
      changed("permuted sensors", MisfitCause::sensor_order, [](BeamBench&, Case& c, Random& random) {
        std::vector<Index> order(static_cast<std::size_t>(c.values.rows()));
        std::iota(order.begin(), order.end(), Index{0});
        std::shuffle(order.begin(), order.end(), random);
        c.values = MatrixXd(c.values(order, Eigen::all));
      }));
  all.push_back(shifted("shifted by 1 %", 0.5));
  all.push_back(shifted("shifted by 10 %", -5));
  all.push_back(another_structure("wrong support", face));
  all.push_back(another_structure("yielding supports", soft));
  all.push_back(another_structure("wrong E, force measured", stiff, true));
  all.push_back(another_structure("wrong load point", offset));
  all.push_back(another_structure("another beam", deep));
  all.push_back(another_structure("another mesh", fine));
  all.push_back(another_structure("damage outside the model", crushed));
  all.push_back(another_model("coarse in nodes", 5, 50, model::Form::tree));
  all.push_back(another_model("coarse in modes", k_nodes, 3, model::Form::tree));
  all.push_back(another_model("canonical, 3 modes", 9, 3, model::Form::canonical));
  all.push_back(changed("noise stated 0.3 times", MisfitCause::noise_level,
                        [](BeamBench&, Case& c, Random&) { c.noise *= 0.3; }));
  all.push_back(changed("noise stated 3 times", MisfitCause::noise_level,
                        [](BeamBench&, Case& c, Random&) { c.noise *= 3; }));
  all.push_back({"noise correlated in space", std::nullopt,
                 [](BeamBench& bench, const Vector2d& truth, Random& random) {
                   const History& exact = bench.history(modelled(), truth);
                   const auto& s = bench.sensors();
                   const auto n = static_cast<Index>(s.components.size());
                   MatrixXd covariance = MatrixXd::Zero(n, n);
                   for (Index i = 0; i < n; ++i)
                     for (Index j = 0; j < n; ++j) {
                       const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(j);
                       if (s.components[a] != s.components[b]) continue;
                       const double d =
                           std::hypot(s.point(a)[0] - s.point(b)[0], s.point(a)[1] - s.point(b)[1]);
                       covariance(i, j) = std::exp(-d / 0.05) + (i == j ? 1e-9 : 0);
                     }
                   const MatrixXd factor = covariance.llt().matrixL();
                   return case_of(good_model(bench),
                                  exact.topRows(n) + k_noise * (factor * white(n, exact.cols(), random)));
                 }});
  all.push_back(
      {"noise correlated in time", std::nullopt, [](BeamBench& bench, const Vector2d& truth, Random& random) {
         const History& exact = bench.history(modelled(), truth);
         MatrixXd noise = white(exact.rows() - 1, exact.cols(), random);
         for (Index t = 1; t < noise.cols(); ++t) noise.col(t) = 0.8 * noise.col(t - 1) + 0.6 * noise.col(t);
         return case_of(good_model(bench), exact.topRows(exact.rows() - 1) + k_noise * noise);
       }});
  all.push_back(changed("5 % outliers", std::nullopt, [](BeamBench&, Case& c, Random& random) {
    std::uniform_real_distribution<double> uniform;
    std::normal_distribution<double> normal;
    for (double& v : c.values.reshaped())
      if (uniform(random) < 0.05) v += 30 * k_noise * normal(random);
  }));
  all.push_back(changed("a spike", MisfitCause::single_sensor, [](BeamBench&, Case& c, Random& random) {
    c.values(static_cast<Index>(random() % 60), static_cast<Index>(random() % k_steps)) = 1;
  }));
  all.push_back(
      changed("a stuck sensor", MisfitCause::single_sensor, [](BeamBench&, Case& c, Random& random) {
        const auto i = static_cast<Index>(random() % 60);
        const Index from = 15;
        c.values.row(i).tail(c.values.cols() - from).setConstant(c.values(i, from));
      }));
  all.push_back(
      changed("a drifting sensor", MisfitCause::single_sensor, [](BeamBench&, Case& c, Random& random) {
        const auto i = static_cast<Index>(random() % 60);
        for (Index t = 0; t < c.values.cols(); ++t)
          c.values(i, t) += 10e-6 * static_cast<double>(t) / static_cast<double>(k_steps);
      }));
  all.push_back({"structure changed at half time", std::nullopt,
                 [](BeamBench& bench, const Vector2d& truth, Random& random) {
                   const Vector2d other(std::clamp(0.85 * truth[0], 0.5, 1.5),
                                        std::clamp(1.15 * truth[1], 0.5, 1.5));
                   History exact = bench.history(modelled(), truth);
                   exact.rightCols(k_steps / 2) = bench.history(modelled(), other).rightCols(k_steps / 2);
                   return case_of(good_model(bench), measured(exact, random));
                 }});
  all.push_back(
      {"truth outside the box", std::nullopt, [](BeamBench& bench, const Vector2d& truth, Random& random) {
         return case_of(good_model(bench),
                        measured(bench.history(modelled(), outside_the_box(truth)), random));
       }});
  all.push_back(changed("a region without sensors", std::nullopt, [](BeamBench& bench, Case& c, Random&) {
    for (std::size_t i = 0; i < bench.sensors().components.size(); ++i)
      if (bench.sensors().point(i)[0] > -0.02) c.values.row(static_cast<Index>(i)).setConstant(k_nan);
  }));
  all.push_back(timed("a frame lost", MisfitCause::lost_frame,
                      [](const History&, Index t) { return static_cast<double>(t < 22 ? t : t + 1); }));
  all.push_back(timed("a time base that is bent", MisfitCause::time_base, [](const History&, Index t) {
    return static_cast<double>(t) + std::sin(M_PI * static_cast<double>(t) / (k_steps - 1.0));
  }));
  // The specimen gets the imposed displacement less what the machine takes up of it.
  all.push_back(timed("a machine that yields", MisfitCause::time_base, [](const History& exact, Index t) {
    const double a_step = modelled_beam().solver.displacement / static_cast<double>(k_steps);
    double at = static_cast<double>(t);
    for (int k = 0; k < 50; ++k)
      at = 0.5 * (at + static_cast<double>(t) -
                  std::abs(at_time(exact, at)[exact.rows() - 1]) / k_machine_stiffness / a_step);
    return at;
  }));
  all.push_back(changed("half a camera 1 % larger", MisfitCause::scale, [](BeamBench& b, Case& c, Random&) {
    for (std::size_t i = 0; i < b.sensors().components.size(); ++i)
      if (b.sensors().point(i)[0] > 0) c.values.row(static_cast<Index>(i)) *= 1.01;
  }));
  all.push_back(changed("a range that ends", MisfitCause::saturation, [](BeamBench&, Case& c, Random&) {
    const double end = 0.4 * c.values.cwiseAbs().maxCoeff();
    c.values = c.values.cwiseMin(end).cwiseMax(-end);
  }));
  all.push_back(changed("unloaded by 30 %", MisfitCause::few_steps,
                        [](BeamBench&, Case& c, Random&) { c.values.middleCols(25, 6) *= 0.7; }));
  all.push_back(
      {"preloaded", MisfitCause::offset, [](BeamBench& bench, const Vector2d& truth, Random& random) {
         const History& exact = bench.history(modelled(), truth);
         History late(exact.rows(), exact.cols() - 4);
         for (Index t = 0; t < late.cols(); ++t) late.col(t) = exact.col(t + 4) - exact.col(4);
         return case_of(good_model(bench), measured(late, random));
       }});
  all.push_back(changed("smoothed over 5 pictures", std::nullopt, [](BeamBench&, Case& c, Random&) {
    const MatrixXd right = c.values;
    for (Index t = 2; t + 2 < right.cols(); ++t)
      c.values.col(t) = right.middleCols(t - 2, 5).rowwise().mean();
  }));
  // As wide as the data can contradict it: one that is much narrower than what they say decides alone.
  const std::pair<const char*, double> narrow[] = {{"prior of Y0 6 std away", 0.1},
                                                   {"prior of Ad 6 std away", 0.02}};
  for (std::size_t a = 0; a < 2; ++a)
    all.push_back({narrow[a].first, std::nullopt,
                   [a, width = narrow[a].second](BeamBench& bench, const Vector2d& truth, Random& random) {
                     Case c = right_case(bench, truth, random);
                     const auto k = static_cast<Index>(a);
                     c.priors = priors();
                     c.priors[a] =
                         posterior::Prior::normal(truth[k] + (truth[k] > 1 ? -6 : 6) * width, width);
                     return c;
                   }});
  all.push_back(changed("pictures stored twice", std::nullopt, [](BeamBench&, Case& c, Random&) {
    MatrixXd twice(c.values.rows(), 2 * c.values.cols());
    std::vector<std::size_t> times;
    for (Index t = 0; t < c.values.cols(); ++t) {
      twice.col(2 * t) = twice.col(2 * t + 1) = c.values.col(t);
      times.insert(times.end(), 2, static_cast<std::size_t>(t));
    }
    c.values = twice;
    c.time_indices = times;
  }));
  return all;
}

}  // namespace knothe::verdicts
