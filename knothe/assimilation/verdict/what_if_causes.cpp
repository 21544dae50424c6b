#include "knothe/assimilation/verdict/what_if_causes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace knothe::assimilation {
namespace {

using Eigen::Index;

constexpr Index k_max_matched_sensors = 300;  // whose order is looked for: the cost grows with their square
constexpr double k_nearly_all = 0.05;         // of the misfit beyond noise may be left over
constexpr double k_moved_by = 30;             // χ² that another place must spare a sensor
constexpr Index k_max_knots = 8;              // of a time base that is bent
constexpr double k_whole_frames = 0.15;       // so near to a whole number
constexpr double k_worth_a_look = 0.7;        // of the misfit: what is left of it by a rough fit
constexpr double k_share_of_excess = 0.5;     // of the misfit beyond noise that a cause must spare
constexpr double k_plausible = 1e-3;          // of the sharper tests, by chance, where a cause explains all
constexpr Index k_max_delay = 6,
                k_max_frames = 4;  // steps by which data are late, and how often that changes
constexpr int k_rounds = 4;        // of delays and parameters in turn
constexpr Index k_max_half_window = 5,
                k_windows = 3;    // smoothed data, and how many windows they are at least
constexpr double k_smooth = 0.4;  // correlation of neighbours that smoothing leaves

/// Of m data, piecewise linear between q knots, m × q.
Eigen::MatrixXd hats(Index m, Index q) {
  Eigen::MatrixXd basis(m, q);
  for (Index k = 0; k < m; ++k)
    for (Index j = 0; j < q; ++j) basis(k, j) = std::max(0.0, 1 - std::abs(k * (q - 1.0) / (m - 1.0) - j));
  return basis;
}

/// 0 before datum `from`, then 1.
Eigen::MatrixXd step_at(Index m, Index from) {
  Eigen::MatrixXd basis = Eigen::MatrixXd::Ones(m, 1);
  basis.topRows(from).setZero();
  return basis;
}

/// Of data whose misfits at delays of −D … D steps are given (m × 2D + 1), the delays that are best where
/// each change costs as much as chance may spare.
std::vector<Index> whole_delays(const Eigen::MatrixXd& misfits) {
  const Index m = misfits.rows(), count = misfits.cols();
  Eigen::MatrixXi from(m, count);
  Eigen::VectorXd cost = misfits.row(0).transpose();
  for (Index k = 1; k < m; ++k) {
    Index least = 0;
    const double changed = cost.minCoeff(&least) + k_moved_by;
    for (Index d = 0; d < count; ++d) {
      from(k, d) = static_cast<int>(changed < cost[d] ? least : d);
      cost[d] = std::min(changed, cost[d]) + misfits(k, d);
    }
  }
  std::vector<Index> delays(m);
  cost.minCoeff(&delays.back());
  for (Index k = m - 1; k > 0; --k) delays[k - 1] = from(k, delays[k]);
  for (Index& delay : delays) delay -= (count - 1) / 2;
  return delays;
}

std::string later_or_earlier(double steps) {
  return fmt::format("{:.2g} {} {}", std::abs(steps), std::abs(steps) == 1 ? "step" : "steps",
                     steps > 0 ? "later" : "earlier");
}

}  // namespace

WhatIfCauses::WhatIfCauses(const ResidualTests& tests, Data few, const WhatIfFits& fits_of_few, Data all,
                           const WhatIfFits& fits_of_all, double limit)
    : tests_(tests),
      few_(few),
      all_(all),
      fits_(fits_of_few),
      fits_of_all_(fits_of_all),
      limit_(limit),
      plain_(fits_.fit({})) {}

bool WhatIfCauses::is_small(double misfit) const {
  const double n = fits_.present();
  return misfit < n * (1 + 5 * std::sqrt(2 / n));
}

bool WhatIfCauses::takes_nearly_all(double misfit) const {
  const double n = fits_.present();
  return !fits_plainly() && misfit - n < k_nearly_all * (plain_.misfit - n);
}

/// Of all data: nothing is left but noise, which so many successive values share, and that is not what was
/// left before.
bool WhatIfCauses::explains_all(double misfit, Index sharing) const {
  const double n = fits_of_all_.present(), before = fits_of_all_.fit_from({}, plain_.p, {}).misfit;
  return misfit < n * (1 + 5 * std::sqrt(2 * sharing / n)) &&
         before - misfit > std::max(25.0, k_share_of_excess * (before - n));
}

/// `freedom`: numbers that are free beside the parameters.
Tried WhatIfCauses::judged(MisfitCause cause, const WhatIfAnswer& answer, Index freedom,
                           std::string message) const {
  Tried tried{cause, answer.misfit, std::move(message)};
  const double spared = plain_.misfit - answer.misfit;
  // A misfit too small for χ² of all is seen by the sharper tests alone.
  tried.explains =
      fits_plainly()
          ? spared > 25 + 3 * freedom && tests_.noise().measurement().is_independent() &&
                !tests_.examine_scores(answer.scores, answer.p.size()).fails(std::max(limit_, k_plausible))
          : is_small(answer.misfit + freedom) &&
                spared - freedom > k_share_of_excess * (plain_.misfit - fits_.present());
  return tried;
}

std::optional<Tried> WhatIfCauses::find(bool sensors_may_be_permuted) {
  using Attempt = void (WhatIfCauses::*)();
  for (const Attempt attempt :
       {&WhatIfCauses::try_factors, &WhatIfCauses::try_shift, &WhatIfCauses::try_swapped_components,
        &WhatIfCauses::try_sensor_order, &WhatIfCauses::try_smoothing, &WhatIfCauses::try_lost_frames,
        &WhatIfCauses::try_regions, &WhatIfCauses::try_time_base, &WhatIfCauses::try_offsets}) {
    if (attempt == &WhatIfCauses::try_sensor_order && !sensors_may_be_permuted) continue;
    (this->*attempt)();
    const auto found =
        std::find_if(tried_.begin(), tried_.end(), [](const Tried& tried) { return tried.explains; });
    if (found != tried_.end()) return *found;
  }
  const auto best = std::min_element(tried_.begin(), tried_.end(),
                                     [](const Tried& a, const Tried& b) { return a.misfit < b.misfit; });
  if (best == tried_.end() || !takes_nearly_all(best->misfit)) return {};
  return *best;
}

std::optional<Tried> WhatIfCauses::factor_of_sensor(Index sensor) const {
  const bool is_scalar = tests_.is_scalar(sensor);
  const std::string name = tests_.name_of(sensor);
  return factor_of(Eigen::VectorXd::Unit(tests_.noise().size(), sensor), "values of " + name,
                   is_scalar ? name : "its axis", !is_scalar);
}

std::optional<Tried> WhatIfCauses::factor_of(const Eigen::VectorXd& rows, const std::string& what,
                                             const std::string& axis, bool is_displacement) const {
  WhatIf assumption;
  assumption.scaled = rows;
  const WhatIfAnswer answer = fits_.fit(assumption);
  const double f = answer.factor;
  if (std::abs(f - 1) < 1e-3) return {};
  if (std::abs(f + 1) < 0.1) {
    Tried sign = judged(MisfitCause::sign, answer, 1,
                        fmt::format("{} look like the model's times −1: check the sign of {}", what, axis));
    sign.is_exact = true;
    return sign;
  }
  const double power = std::round(std::log10(std::abs(f)));
  const bool is_unit = power != 0 && std::abs(std::log10(std::abs(f)) - power) < 0.05;
  Tried scale = judged(
      MisfitCause::scale, answer, 1,
      is_unit
          ? fmt::format("{} look like the model's times {}: check their unit{}", what,
                        f < 0 ? fmt::format("−10^{:.0f}", power) : fmt::format("10^{:.0f}", power),
                        is_displacement ? " (m is expected)" : "")
          : fmt::format("{} look like the model's times {:.4g}: check unit, scale and calibration", what, f));
  scale.is_exact = is_unit;
  return scale;
}

void WhatIfCauses::try_factors() {
  const model::Sensors& sensors = tests_.sensors();
  const Index n = tests_.noise().size();
  const Index displacements = sensors.size() == 0 ? n : Index(sensors.displacement_count());
  if (displacements > 0) {
    Eigen::VectorXd rows = Eigen::VectorXd::Zero(n);
    rows.head(displacements).setOnes();
    auto whole = factor_of(rows, displacements == n ? "the data" : "the displacements", "the axes", true);
    // All strains in proportion are what another imposed displacement does.
    if (whole && whole->cause == MisfitCause::scale && !whole->is_exact)
      whole->message += ", and the imposed displacement";
    add(std::move(whole));
  }
  const auto& names = tests_.group_names();
  if (names.size() < 2) return;
  for (Index g = 0; g < std::ssize(names); ++g) {
    Eigen::VectorXd rows = Eigen::VectorXd::Zero(n);
    for (Index i = 0; i < n; ++i) rows[i] = tests_.groups()[i] == g ? 1 : 0;
    const bool is_component = names[g].size() == 1;
    add(factor_of(rows, is_component ? "displacements along " + names[g] : "values of \"" + names[g] + "\"",
                  is_component ? "the " + names[g] + " axis" : "\"" + names[g] + "\"", is_component));
    // Series of one unit, a force beside them.
    if (names.size() > 2)
      add(factor_of(Eigen::VectorXd::Ones(n) - rows, "all values but those of \"" + names[g] + "\"",
                    "all but \"" + names[g] + "\"", false));
  }
}

void WhatIfCauses::try_shift() {
  WhatIf assumption;
  assumption.delays = Eigen::MatrixXd::Ones(std::ssize(few_), 1);
  const WhatIfAnswer answer = fits_.fit(assumption);
  const double steps = answer.shifts[0];
  if (std::abs(steps) < 0.05) return;
  add(judged(MisfitCause::time_shift, answer, 1,
             fmt::format("the data match the model {}: check the clock, and where the test begins",
                         later_or_earlier(steps))));
}

/// The other component at the same point.
void WhatIfCauses::try_swapped_components() {
  const model::Sensors& sensors = tests_.sensors();
  const std::size_t n = sensors.displacement_count();
  for (int a = 0; a < 3; ++a) {
    for (int b = a + 1; b < 3; ++b) {
      std::vector<Index> order(sensors.size());
      bool swapped = false;
      for (std::size_t i = 0; i < sensors.size(); ++i) {
        order[i] = i;
        if (i >= n || (sensors.components[i] != a && sensors.components[i] != b)) continue;
        for (std::size_t j = 0; j < n; ++j) {
          if (sensors.components[j] != a + b - sensors.components[i]) continue;
          const auto x = sensors.point(i), y = sensors.point(j);
          if (std::equal(x.begin(), x.end(), y.begin())) order[i] = j, swapped = true;
        }
      }
      if (!swapped) continue;
      WhatIf assumption;
      assumption.order = order;
      add(judged(MisfitCause::component, fits_.fit(assumption), 0,
                 fmt::format("the components {} and {} look swapped: check the columns of the data", "xyz"[a],
                             "xyz"[b])));
    }
  }
}

/// Each sensor compared with what the model says of every other one.
void WhatIfCauses::try_sensor_order() {
  const Index n = tests_.noise().size();
  if (n > k_max_matched_sensors || n < 3 || few_.size() < 2) return;
  const Eigen::MatrixXd& values = fits_.values();
  double best_cost = std::numeric_limits<double>::infinity();
  std::vector<Index> best;
  for (Index s = 0; s <= fits_.starts().rows(); ++s) {
    const Eigen::VectorXd p = s == 0 ? plain_.p : Eigen::VectorXd(fits_.starts().row(s - 1).transpose());
    const Eigen::MatrixXd y = fits_.predicted(p);
    std::vector<Index> order(n);
    double cost = 0;
    for (Index i = 0; i < n; ++i) {
      const auto there = values.row(i).array() == values.row(i).array();
      const double precision = tests_.inverse_std()[i] * tests_.inverse_std()[i];
      const auto misfit_at = [&](Index j) {
        return precision * there.select((values.row(i) - y.row(j)).array().square(), 0.0).sum();
      };
      order[i] = i;
      double least = misfit_at(i), to_beat = least - k_moved_by;
      for (Index j = 0; j < n; ++j)
        if (const double misfit = misfit_at(j); misfit < to_beat) least = to_beat = misfit, order[i] = j;
      cost += least;
    }
    if (cost < best_cost) best_cost = cost, best = order;
  }
  Index moved = 0;
  for (Index i = 0; i < n; ++i) moved += best[i] != i ? 1 : 0;
  if (moved < 2) return;
  WhatIf assumption;
  assumption.order = best;
  add(judged(MisfitCause::sensor_order, fits_.fit(assumption), moved,
             fmt::format("{} of {} sensors fit better at another sensor's position: check the order of the "
                         "columns, and the places of the sensors",
                         moved, n)));
}

/// A constant of each sensor, and with it a shift in time: what a preload does.
void WhatIfCauses::try_offsets() {
  const Index n = tests_.noise().size(), m = std::ssize(few_);
  if (m < 8) return;
  WhatIf assumption;
  assumption.offsets = true;
  add(judged(
      MisfitCause::offset, fits_.fit(assumption), n,
      "every sensor is off by a constant of its own: the reference picture or the zero was taken under "
      "load, or is noisy (method.offset_std allows for it)"));
  if (!tried_.empty() && tried_.back().explains) return;
  assumption.delays = Eigen::MatrixXd::Ones(m, 1);
  const WhatIfAnswer answer = fits_.fit(assumption);
  add(judged(MisfitCause::offset, answer, n + 1,
             fmt::format("every sensor is off by a constant of its own, and the data match the model {}: the "
                         "zero was taken under a preload",
                         later_or_earlier(answer.shifts[0]))));
}

/// A factor on one side of a line: where the factors that the sensors would have each differ most.
void WhatIfCauses::try_regions() {
  const model::Sensors& sensors = tests_.sensors();
  const Index n = sensors.displacement_count();
  if (n < 8 || few_.size() < 4) return;
  WhatIf each;
  each.own_factors = true;
  const WhatIfAnswer own = fits_.fit(each);
  const Tried all = judged(MisfitCause::scale, own, tests_.noise().size(), "");
  if (!all.explains && !takes_nearly_all(all.misfit)) return;
  double largest = 0;
  int along = -1;
  std::vector<Index> behind;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<Index> order(n);
    std::iota(order.begin(), order.end(), Index{0});
    const auto at = [&](Index i) { return sensors.point(i)[axis]; };
    std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) { return at(a) < at(b); });
    const double weight = own.response.head(n).sum();
    const double mean = own.response.head(n).dot(own.factors.head(n)) / weight;
    double before = 0, sum = 0;
    for (Index k = 0; k + 1 < n; ++k) {
      before += own.response[order[k]];
      sum += own.response[order[k]] * (own.factors[order[k]] - mean);
      if (k < 2 || k + 3 >= n || at(order[k + 1]) == at(order[k])) continue;
      const double between = sum * sum * (1 / before + 1 / std::max(weight - before, 1e-300));
      if (between <= largest) continue;
      largest = between, along = axis;
      behind.assign(order.begin() + k + 1, order.end());
    }
  }
  if (along < 0) return;
  Eigen::VectorXd rows = Eigen::VectorXd::Zero(tests_.noise().size());
  rows(behind).setOnes();
  double border = std::numeric_limits<double>::infinity();
  for (const Index i : behind) border = std::min(border, sensors.point(i)[along]);
  const auto try_side = [&](const char* side) {
    add(factor_of(rows, fmt::format("displacements at {} {} {:.4g} m", "xyz"[along], side, border),
                  "the axes there", true));
  };
  try_side("≥");
  rows.head(n) = Eigen::VectorXd::Ones(n) - rows.head(n);
  try_side("<");
}

/// The test's time runs differently from the model's.
void WhatIfCauses::try_time_base() {
  const Index m = std::ssize(few_), q = std::min<Index>(k_max_knots, m / 3);
  if (q < 3) return;
  WhatIf assumption;
  assumption.delays = hats(m, q);
  const WhatIfAnswer bent = fits_.fit(assumption);
  const Eigen::VectorXd delay = assumption.delays * bent.shifts;
  Index at = 0;
  delay.cwiseAbs().maxCoeff(&at);
  Tried tried = judged(MisfitCause::time_base, bent, q,
                       fmt::format("the data match the model up to {} (about step {}): its time, or the "
                                   "imposed displacement, is not the model's there: check clock and stroke, "
                                   "and whether machine or supports yield",
                                   later_or_earlier(delay[at]), few_[at]->step));
  if (!tried.explains && !takes_nearly_all(tried.misfit)) return;
  add(std::move(tried));
}

/// Averages over a window in time that is cut off at the ends. What is left is noise that neighbours share.
void WhatIfCauses::try_smoothing() {
  const Index m = std::ssize(all_), n = tests_.noise().size();
  const auto over = [m](Index half) {
    WhatIf assumption;
    assumption.smoothing.setZero(m, m);
    for (Index k = 0; k < m; ++k) {
      const Index from = std::max<Index>(0, k - half), count = std::min(m - 1, k + half) - from + 1;
      assumption.smoothing.col(k).segment(from, count).setConstant(1.0 / count);
    }
    return assumption;
  };
  Index half = 0;
  double least = std::numeric_limits<double>::infinity();
  for (Index h = 1; h <= k_max_half_window && m >= k_windows * (2 * h + 1); ++h) {
    const double misfit = fits_of_all_.fit_from(over(h), plain_.p, {}).misfit;
    if (misfit < least) least = misfit, half = h;
  }
  if (half == 0) return;
  const WhatIfAnswer best = fits_of_all_.fit(over(half));
  if (!explains_all(best.misfit, 2 * half + 1)) return;
  const auto products = best.scores.leftCols(m - 1).cwiseProduct(best.scores.rightCols(m - 1));
  if (products.sum() / (n * (m - 1)) < k_smooth * best.misfit / (n * m)) return;
  Tried tried{
      MisfitCause::smoothing, best.misfit,
      fmt::format("the data look smoothed in time, each over about {} and over fewer at the ends: give "
                  "them as they were measured, or leave out {} at each end and state the noise left",
                  2 * half + 1, half)};
  tried.explains = true;
  tried_.push_back(std::move(tried));
}

/// Delays of whole steps, each from a datum on: these follow from parameters, and the parameters from them.
void WhatIfCauses::try_lost_frames() {
  const Index few = std::ssize(few_), m = std::ssize(all_);
  if (few < 8) return;
  WhatIf bent;
  bent.delays = hats(few, std::min<Index>(k_max_knots, few / 3));
  WhatIfAnswer best = fits_.fit(bent);
  for (Index part = 1; part < k_max_knots; ++part) {
    WhatIf late;
    late.delays = step_at(few, part * few / k_max_knots);
    WhatIfAnswer answer = fits_.fit_from(late, plain_.p, Eigen::VectorXd::Zero(1));
    if (answer.misfit < best.misfit) best = std::move(answer);
  }
  if (!(best.misfit < k_worth_a_look * plain_.misfit)) return;
  std::vector<Index> delays;
  for (int round = 0; round < k_rounds; ++round) {
    Eigen::MatrixXd misfits(m, 2 * k_max_delay + 1);
    WhatIf late;
    late.delays = Eigen::MatrixXd::Ones(m, 1);
    for (Index d = -k_max_delay; d <= k_max_delay; ++d)
      misfits.col(d + k_max_delay) = fits_of_all_.scores_at(late, best.p, Eigen::VectorXd::Constant(1, d))
                                         .colwise()
                                         .squaredNorm()
                                         .transpose();
    std::vector<Index> found = whole_delays(misfits);
    if (found == delays) break;
    delays = std::move(found);
    std::vector<Index> at;
    for (Index k = 1; k < m; ++k)
      if (delays[k] != delays[k - 1]) at.push_back(k);
    if (at.empty() || std::ssize(at) > k_max_frames) return;
    WhatIf steps;
    steps.delays.resize(m, std::ssize(at));
    Eigen::VectorXd by(std::ssize(at));
    for (std::size_t j = 0; j < at.size(); ++j) {
      steps.delays.col(j) = step_at(m, at[j]);
      by[j] = delays[at[j]] - delays[at[j] - 1];
    }
    best = fits_of_all_.fit_from(steps, best.p, by);
  }
  if (!explains_all(best.misfit)) return;
  const Eigen::VectorXd whole = best.shifts.array().round();
  if ((whole.array() == 0).any() || (best.shifts - whole).cwiseAbs().maxCoeff() > k_whole_frames) return;
  std::string where;
  double late = 0;
  Index j = 0;
  for (Index k = 1; k < m; ++k) {
    if (delays[k] == delays[k - 1]) continue;
    late += whole[j++];
    where += fmt::format("{}from step {} on{}{}", where.empty() ? "" : ", ", all_[k]->step,
                         where.empty() ? " the data match the model " : " ",
                         late == 0 ? std::string("as it is") : later_or_earlier(late));
  }
  const bool is_one = whole.size() == 1;
  Tried tried{
      MisfitCause::lost_frame, best.misfit,
      where + (whole.minCoeff() > 0
                   ? is_one ? ": a picture or datum is missing there" : ": pictures or data are missing there"
               : whole.maxCoeff() < 0 ? is_one ? ": there is one too many" : ": there are some too many"
                                      : ": pictures or data are missing, and others are too many")};
  tried.explains = true;
  tried_.push_back(std::move(tried));
}

}  // namespace knothe::assimilation
