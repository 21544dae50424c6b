// Text, ticks, colours and figures.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <regex>
#include <set>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/record/testing/result_examples.hpp"
#include "knothe/report/figures/mesh_view.hpp"
#include "knothe/report/figures/result_figures.hpp"
#include "knothe/report/figures/svg_figure.hpp"
#include "knothe/report/pages/page.hpp"

namespace knothe::report {
namespace {

using Texts = std::vector<std::string>;
constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

TEST(Text, EscapesWhatMeansSomethingInXml) {
  EXPECT_EQ(escape_xml("a<b & \"c\" > 'd'"), "a&lt;b &amp; &quot;c&quot; &gt; &#39;d&#39;");
  EXPECT_EQ(escape_xml(std::string("x\x01y\x1b\n")), "xy\n");
  EXPECT_EQ(escape_xml("σ ≤ 1 µm"), "σ ≤ 1 µm");
}

TEST(Text, CoordinatesAreShortAndFinite) {
  EXPECT_EQ(record::coordinate(12.5), "12.5");
  EXPECT_EQ(record::coordinate(100.0), "100");
  EXPECT_EQ(record::coordinate(-0.001), "0");
  EXPECT_EQ(record::coordinate(1.0 / 3), "0.33");
  EXPECT_THROW((void)record::coordinate(k_nan), NumericalError);
  EXPECT_THROW((void)record::coordinate(INFINITY), NumericalError);
}

TEST(Text, NumbersForPeople) {
  EXPECT_EQ(record::readable(0.0), "0");
  EXPECT_EQ(record::readable(1.04), "1.04");
  EXPECT_EQ(record::readable(-37.25, 3), "−37.2");
  EXPECT_EQ(record::readable(9.999, 3), "10.0");
  EXPECT_EQ(record::readable(1.5e-7, 2), "1.5·10⁻⁷");
  EXPECT_EQ(record::readable(123456.0, 3), "123456");
  EXPECT_EQ(record::with_uncertainty(1.0432, 0.0412), "1.043 ± 0.041");
  EXPECT_EQ(record::with_uncertainty(37.2345, 1.26), "37.2 ± 1.3");
  EXPECT_EQ(record::with_uncertainty(-2.0, 0.0), "−2.000 ± 0");
  EXPECT_EQ(record::plain(0.3), "0.3");
  EXPECT_EQ(record::plain(25.0), "25");
  EXPECT_EQ(record::plain(-1200.0), "−1200");
  EXPECT_EQ(record::superscript(-12), "⁻¹²");
  EXPECT_THROW((void)record::readable(k_nan), NumericalError);
  EXPECT_THROW((void)record::with_uncertainty(1.0, k_nan), NumericalError);
}

TEST(Ticks, ExactCases) {
  EXPECT_EQ(record::nice_ticks(0, 1, 5).labels, (Texts{"0.0", "0.2", "0.4", "0.6", "0.8", "1.0"}));
  EXPECT_EQ(record::nice_ticks(0, 100, 5).labels, (Texts{"0", "20", "40", "60", "80", "100"}));
  EXPECT_EQ(record::nice_ticks(-1, 1, 4).labels, (Texts{"−1.0", "−0.5", "0.0", "0.5", "1.0"}));
  EXPECT_EQ(record::nice_ticks(0.5, 1.5, 5).labels, (Texts{"0.6", "0.8", "1.0", "1.2", "1.4"}));
  EXPECT_EQ(record::nice_ticks(0, 0.00035, 4).labels, (Texts{"0.0000", "0.0001", "0.0002", "0.0003"}));
  EXPECT_EQ(record::nice_ticks(3, 3).labels, (Texts{"3.00"}));
  EXPECT_THROW((void)record::nice_ticks(1, 0), NumericalError);
  EXPECT_THROW((void)record::nice_ticks(0, INFINITY), NumericalError);
}

TEST(Ticks, InsideTheRangeEvenlySpacedAndReasonablyMany) {
  for (double low : {-3.7e4, -1.0, 0.0, 1e-9, 0.123, 998.5})
    for (double span : {1e-8, 0.37, 1.0, 61.0, 1e7}) {
      const record::Ticks ticks = record::nice_ticks(low, low + span, 5);
      ASSERT_GE(ticks.values.size(), 2u);
      ASSERT_LE(ticks.values.size(), 9u);
      for (double v : ticks.values) {
        EXPECT_GE(v, low - 1e-6 * span);
        EXPECT_LE(v, low + span * (1 + 1e-6));
      }
      EXPECT_EQ(std::set<std::string>(ticks.labels.begin(), ticks.labels.end()).size(),
                span > 1e-6 * std::abs(low)
                    ? ticks.labels.size()
                    : std::set<std::string>(ticks.labels.begin(), ticks.labels.end()).size());
    }
}

TEST(Ticks, Decades) {
  EXPECT_EQ(record::decade_ticks(1e-4, 1e-1).labels, (Texts{"10⁻⁴", "10⁻³", "10⁻²", "10⁻¹"}));
  EXPECT_EQ(record::decade_ticks(0.5, 2e3).labels, (Texts{"1", "10", "100", "1000"}));
  EXPECT_EQ(record::decade_ticks(200, 900, 4).labels,
            record::nice_ticks(200, 900, 4).labels);  // less than a decade
  EXPECT_LE(record::decade_ticks(1e-12, 1.0, 5).labels.size(), 5u);
  EXPECT_THROW((void)record::decade_ticks(0, 1), NumericalError);
}

TEST(Colours, EndsOfTheMaps) {
  EXPECT_EQ(viridis(0), "#440154");
  EXPECT_EQ(viridis(1), "#fde725");
  EXPECT_EQ(viridis(-3), viridis(0));
  EXPECT_EQ(blue_white_red(0.5), "#f7f7f7");
  EXPECT_EQ(Paint::time(0.0).css_class(), "kt0");
  EXPECT_EQ(Paint::time(2.0).css_class(), "kt31");
  EXPECT_NE(paint_css().find(".kt31{"), std::string::npos);
  EXPECT_NE(paint_css().find("prefers-color-scheme:dark"), std::string::npos);
}

Figure example() {
  const std::vector<double> x = {1, 2, 3, 4}, y = {3, 5, 4, 6}, low = {2, 4, 3, 5};
  Plot plot("All <kinds> & \"more\"", {"step"}, {"value (µm)"});
  plot.band(x, low, y, Paint::series(0), "band").line(x, y, Paint::series(1), "line");
  plot.steps(x, y, Paint::series(2), "steps").bars(x, low, 0.8, Paint::series(3), "bars");
  plot.scatter(x, y, Paint::time(0.5), "dots").vertical(2.5, Paint::truth(), "truth");
  plot.horizontal(4.5, Paint::faint());
  plot.right_axis({"cost", std::nullopt, std::nullopt, true});
  plot.line(x, std::vector<double>{10, 1e4, 100, 1000}, Paint::ink(), "cost", {}, Side::right);
  plot.colour_bar({"T", 0, 100, ColourBar::Map::time});
  return {"Example & co", {plot}};
}

TEST(SvgFigure, IsWellFormedAndFinite) {
  for (const std::string& svg : {standalone_svg(example()), inline_svg(example())}) {
    EXPECT_EQ(record::test::xml_fault(svg), "");
    EXPECT_EQ(svg.find("nan"), std::string::npos);
    EXPECT_EQ(svg.find("inf"), std::string::npos);
    EXPECT_NE(svg.find("All &lt;kinds&gt; &amp; &quot;more&quot;"), std::string::npos);
    EXPECT_NE(svg.find("Example &amp; co"), std::string::npos);
  }
  EXPECT_EQ(record::test::count_of(standalone_svg(example()), "<circle"), 5u);  // four and one in the legend
  EXPECT_EQ(record::test::xml_fault("<a><b></a></b>"), "</a> closes nothing");  // the checker itself
  EXPECT_NE(record::test::xml_fault("<a b=c></a>"), "");
  EXPECT_NE(record::test::xml_fault("<a>x & y</a>"), "");
}

TEST(SvgFigure, PutsDataWhereTheAxesSay) {
  // The axis from 0 to 10 has its ends at the line's ends: one path from the lower left to the upper right
  // corner.
  Plot plot("", {"", 0.0, 10.0}, {"", 0.0, 10.0});
  plot.line(std::vector<double>{0, 10}, std::vector<double>{0, 10}, Paint::ink());
  const std::string svg = plot.render(0, 0, 400, 300);
  const auto at = svg.find("<svg x=\"");
  ASSERT_NE(at, std::string::npos);
  double x = 0, y = 0, w = 0, h = 0, x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  ASSERT_EQ(
      std::sscanf(svg.c_str() + at, "<svg x=\"%lf\" y=\"%lf\" width=\"%lf\" height=\"%lf\"", &x, &y, &w, &h),
      4);
  const auto path = svg.find(" d=\"M", at);
  ASSERT_EQ(std::sscanf(svg.c_str() + path, " d=\"M%lf %lfL%lf %lf\"", &x0, &y0, &x1, &y1), 4);
  EXPECT_NEAR(x0, x, 0.02);
  EXPECT_NEAR(y0, y + h, 0.02);
  EXPECT_NEAR(x1, x + w, 0.02);
  EXPECT_NEAR(y1, y, 0.02);
}

TEST(SvgFigure, SurvivesConstantEmptyAndHugeData) {
  Plot plot("odd", {"x"}, {"y"});
  const std::vector<double> one = {5.0}, none;
  plot.line(none, none, Paint::ink(), "nothing")
      .line(one, one, Paint::ink(), "one point")
      .bars(one, one, 0.0, Paint::ink());
  Plot huge("", {"", 0.0, 1e-300}, {"", 0.0, 1.0});
  huge.line(std::vector<double>{-1e300, 1e300}, std::vector<double>{1e300, -1e300}, Paint::ink());
  const std::string svg = standalone_svg({"odd", {plot, huge, Plot("", {""}, {""})}, 2});
  EXPECT_EQ(record::test::xml_fault(svg), "");
  EXPECT_EQ(svg.find("nan"), std::string::npos);
}

TEST(SvgFigure, RefusesNumbersThatAreNotFiniteByName) {
  Plot plot("", {""}, {""});
  try {
    plot.line(std::vector<double>{0, 1}, std::vector<double>{0, k_nan}, Paint::ink(), "mean");
    FAIL() << "accepted";
  } catch (const NumericalError& e) {
    EXPECT_STREQ(e.what(), "figure: series 'mean': y[1] is not finite");
  }
  EXPECT_THROW(plot.line(std::vector<double>{0, 1}, std::vector<double>{0}, Paint::ink()), NumericalError);
  EXPECT_THROW(plot.cells({{{{0.0, k_nan}}, "#000000"}}), NumericalError);
}

TEST(MeshView, FindsTheOuterFaceAndItsDofs) {
  const auto contents = record::test::small_beam(model::Form::tree);
  const OuterFace face = outer_face(*contents.mesh);
  EXPECT_EQ(face.cells.size(), 42u * 5u - 1u);  // the notch is missing
  EXPECT_EQ(face.points.size(), 43u * 6u);
  const auto dofs = dofs_of_face(face, contents.dofs, 1);
  for (std::size_t i = 0; i < face.nodes.size(); ++i)
    EXPECT_EQ(dofs[i], static_cast<std::ptrdiff_t>(3 * face.nodes[i] + 1));
  std::vector<double> value;
  for (const auto& p : face.points) value.push_back(p[0]);
  const std::string svg = standalone_svg({"mesh", {mesh_plot("x", face, value, {}, "m")}});
  EXPECT_EQ(record::test::xml_fault(svg), "");
  EXPECT_NE(svg.find(blue_white_red(0.0)), std::string::npos);
  EXPECT_THROW((void)mesh_plot("x", face, std::vector<double>(3), {}, "m"), DataError);
}

TEST(MeshView, OutlineIsTheBoundaryWithItsNotch) {
  const auto contents = record::test::small_beam(model::Form::tree);
  const OuterFace face = outer_face(*contents.mesh);
  // 42 × 5 elements: around it 2 (42 + 5) edges; the missing element of the lower edge gives three for one.
  const auto edges = outline(face);
  EXPECT_EQ(edges.size(), 2u * (42 + 5) + 2);
  std::map<std::array<double, 2>, int> ends;
  for (const auto& edge : edges) ++ends[edge[0]], ++ends[edge[1]];
  for (const auto& [point, count] : ends) EXPECT_EQ(count, 2) << point[0] << ", " << point[1];  // closed
}

TEST(SvgFigure, EqualScalesKeepTheirAspectBesideTheirAxes) {
  Plot plot("", {"x (mm)"}, {"y (mm)"});
  plot.scatter(std::vector{0.0, 300.0}, std::vector{0.0, 100.0}, Paint::ink()).equal_scales();
  const std::string svg = plot.render(0, 0, 460, 300);
  std::smatch first, second;
  const std::regex circle("cx=\"([0-9.]+)\" cy=\"([0-9.]+)\"");
  ASSERT_TRUE(std::regex_search(svg, first, circle));
  const std::string rest = first.suffix();
  ASSERT_TRUE(std::regex_search(rest, second, circle));
  EXPECT_NEAR(std::stod(second[1]) - std::stod(first[1]), 3 * (std::stod(first[2]) - std::stod(second[2])),
              0.5);
}

TEST(ResultFigures, DensitiesAreLogarithmicWhereEarlyStepsWouldVanish) {
  EXPECT_FALSE(density_axis("", {1.0, 20.0}).logarithmic);
  EXPECT_EQ(density_axis("1/mm", {1.0, 20.0}).label, "probability density (1/mm)");
  const PlotAxis axis = density_axis("", {1.0, 21.0});
  EXPECT_TRUE(axis.logarithmic);
  EXPECT_EQ(axis.label, "probability density, logarithmic");
  EXPECT_EQ(axis.low, 0.01);
  EXPECT_THAT(density_values({0.0, 0.5}, axis), testing::ElementsAre(0.001, 0.5));
  EXPECT_FALSE(density_axis("", {}).logarithmic);
}

TEST(Page, EscapesAndStaysWellFormed) {
  Page page("Title <&>", "sub");
  page.section("One & two").paragraph("a < b").note("n").cards({{"x", "1 ± 2", "<r>", true}});
  page.figure(example(), "caption & more").table({"h"}, {{{"<c>"}}}).details("file", "x = \"<\"");
  const std::string html = page.html();
  EXPECT_EQ(record::test::xml_fault(html), "");
  EXPECT_EQ(html.find("http://www.w3.org"), html.rfind("http"));  // no address but the name of SVG itself
  EXPECT_EQ(record::test::count_of(html, "<script"), 0u);
  EXPECT_NE(html.find("<a href=\"#s1\">One &amp; two</a>"), std::string::npos);
}

}  // namespace
}  // namespace knothe::report
