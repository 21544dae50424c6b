/// @file Fig. 10 to 12: the elastic beams with a crack, and their modes.
#include <fmt/format.h>

#include <cmath>

#include "knothe/report/figures/model_figures.hpp"
#include "knothe/reproduction/figure_parts.hpp"
#include "knothe/reproduction/study.hpp"

namespace knothe::reproduction {

FigureRecord figures_10_12(const Subject& subject) {
  const reduction::SeparatedModel& model = subject.models.paper;
  const reduction::CrackSolutions& crack = model.contents().crack;
  const std::size_t modes = crack.coefficients.size() / crack.length.size();
  FigureRecord record{"10-12", "Elastic beams with a crack, and their modes", "", {}, {}, {}, {}};
  record.setting = fmt::format(
      "{} elastic solutions for a unit imposed displacement, with a vertical crack of 0 to 79 mm from the "
      "right corner "
      "of the notch, on a mesh of their own with 1 mm elements along the crack; interpolated to the dofs of "
      "the "
      "damage model, then a singular value decomposition (Eq. 32).",
      crack.length.size());
  const std::vector<double> lengths = {0.0, 0.025, 0.075};
  record.panels.push_back(
      {report::crack_figures(model, lengths), "Fig. 10: horizontal displacement for three lengths."});
  record.panels.push_back(
      {report::crack_mode_figures(model, 6), "Fig. 11: the first six space modes, scaled to 1."});
  report::Figure functions{"Crack modes against the length", {}};
  functions.columns = 2;
  functions.plots = {report::crack_coefficients_plot(model, 2), report::crack_coefficients_plot(model, 6, 2)};
  record.panels.push_back(
      {{functions},
       "Fig. 12: the functions of the length, times their singular values; the small ones apart."});
  // σ_k: the coefficients are σ_k v_k with orthonormal v_k.
  std::vector<double> sigma(modes, 0.0);
  for (std::size_t i = 0; i < crack.length.size(); ++i)
    for (std::size_t k = 0; k < modes; ++k) sigma[k] += std::pow(crack.coefficients[i * modes + k], 2);
  double total = 0;
  for (double& s : sigma) total += s, s = std::sqrt(s);
  const auto needed = [&](double tolerance) {
    double rest = total;
    std::size_t k = 0;
    for (; k < modes && rest > tolerance * tolerance * total; ++k) rest -= sigma[k] * sigma[k];
    return k;
  };
  record.data.emplace_back("singular_values", sigma);
  record.rows.push_back({"modes for an error of 1 % and of 0.1 %",
                         "1",
                         "“a few”",
                         fmt::format("{} and {}", needed(1e-2), needed(1e-3)),
                         "Agrees: the lengths differ by how far the same two halves have turned.",
                         {},
                         static_cast<double>(needed(1e-2))});
  record.rows.push_back(
      {"third singular value over the first",
       "1",
       "rapidly decreasing",
       report::readable(sigma[2] / sigma[0], 2),
       "Agrees: the first two modes hold the beam broken in two and the whole one; the others open "
       "and close parts of the crack, as the paper's stitching patches.",
       {},
       sigma[2] / sigma[0]});
  // Of the longest crack's solution: what the first two modes leave. The modes are orthonormal.
  double error = 0, size = 0;
  for (std::size_t k = 0; k < modes; ++k) {
    const double square = std::pow(crack.coefficients[(crack.length.size() - 1) * modes + k], 2);
    size += square;
    if (k >= 2) error += square;
  }
  record.rows.push_back({"error of two modes for the longest crack (79 mm), relative",
                         "1",
                         "the first two modes: the kinematics with a full-length crack",
                         report::readable(std::sqrt(error / size), 2),
                         "Agrees: nearly all of the broken beam is in them.",
                         {},
                         std::sqrt(error / size)});
  return record;
}

}  // namespace knothe::reproduction
