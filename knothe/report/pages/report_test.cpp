// Text, colours, faces of meshes, pages.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "knothe/base/error.hpp"
#include "knothe/base/text.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/record/testing/result_examples.hpp"
#include "knothe/report/data/report_record.hpp"
#include "knothe/report/data/specimen.hpp"
#include "knothe/report/data/words.hpp"
#include "knothe/report/figures/colour_map.hpp"
#include "knothe/report/pages/inference_report.hpp"
#include "knothe/report/pages/page.hpp"
#include "knothe/report/pages/study_report.hpp"

namespace knothe::report {
namespace {

constexpr double k_nan = std::numeric_limits<double>::quiet_NaN();

TEST(Text, EscapesWhatMeansSomethingInXml) {
  EXPECT_EQ(escape_xml("a<b & \"c\" > 'd'"), "a&lt;b &amp; &quot;c&quot; &gt; &#39;d&#39;");
  EXPECT_EQ(escape_xml(std::string("x\x01y\x1b\n")), "xy\n");
  EXPECT_EQ(escape_xml("σ ≤ 1 µm"), "σ ≤ 1 µm");
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
  EXPECT_EQ(record::with_uncertainty(12345, 678), "12345 ± 678");
  EXPECT_EQ(record::with_uncertainty(2.0022e11, 1.71e9), "(2.002 ± 0.017)·10¹¹");
  EXPECT_EQ(record::to_decimals_of(1.71e9, 1.9692e11), "1.969·10¹¹");
  EXPECT_EQ(record::to_decimals_of(0.0412, 1.0432), "1.043");
  EXPECT_EQ(record::plain(0.3), "0.3");
  EXPECT_EQ(record::plain(25.0), "25");
  EXPECT_EQ(record::plain(-1200.0), "−1200");
  EXPECT_EQ(record::superscript(-12), "⁻¹²");
  EXPECT_THROW((void)record::readable(k_nan), NumericalError);
  EXPECT_THROW((void)record::with_uncertainty(1.0, k_nan), NumericalError);
}

TEST(Colours, EndsOfTheMaps) {
  EXPECT_EQ(viridis(0), (Rgb{68, 1, 84}));
  EXPECT_EQ(viridis(1), (Rgb{253, 231, 37}));
  EXPECT_EQ(viridis(-3), viridis(0));
  EXPECT_EQ(blue_white_red(0.5), (Rgb{247, 247, 247}));
}

TEST(Words, NamesAndUnits) {
  EXPECT_EQ(parameter_label({"Y0", {}, {}, {}, 216.0, "J/m3", {}}), "Y₀ (1 = 216 J/m³)");
  EXPECT_EQ(parameter_label({"k1", {}, {}, {}, 1.0, "N/m", {}}), "k1 (N/m)");
  EXPECT_EQ(parameter_label({"a", {}, {}, {}, {}, "1", {}}), "a");
  EXPECT_EQ(pretty_units("m/s2"), "m/s²");
  EXPECT_EQ(unit_scale("m").unit, "mm");
  EXPECT_EQ(unit_scale("N").factor, 1e-3);
}

TEST(Face, IsTheOuterOneWithItsDofs) {
  const auto contents = record::test::small_beam(model::Form::tree);
  const OuterFace face = outer_face(*contents.mesh);
  EXPECT_EQ(face.cells.size(), 42u * 5u - 1u);  // the notch is missing
  EXPECT_EQ(face.points.size(), 43u * 6u);
  const auto dofs = dofs_of_face(face, contents.dofs, 1);
  for (std::size_t i = 0; i < face.nodes.size(); ++i)
    EXPECT_EQ(dofs[i], static_cast<std::ptrdiff_t>(3 * face.nodes[i] + 1));
}

TEST(Face, FieldsAreTheModelsAtItsNodes) {
  const model::SeparatedModel model(record::test::small_beam(model::Form::tree));
  const std::vector<double> p = {1.1, 0.8};
  const auto record = specimen_record(model, p);
  const auto& contents = model.contents();
  const OuterFace face = outer_face(*contents.mesh);
  ASSERT_EQ(record.at("points").size(), face.points.size());
  ASSERT_EQ(record.at("fields").size(), contents.time.size());  // eleven times, all of them
  for (const std::size_t t : {0u, 4u, 10u}) {
    const auto& field = record.at("fields").at(t);
    EXPECT_EQ(field.at("time"), contents.time[t]);
    const auto values = model.evaluate(p, t).value;
    for (const std::size_t i : {0u, 100u, 257u}) {
      EXPECT_EQ(field.at("x").at(i), values[3 * face.nodes[i]]);
      EXPECT_EQ(field.at("y").at(i), values[3 * face.nodes[i] + 1]);
    }
  }
  ASSERT_EQ(record.at("modes").size(), 4u);
  for (const auto& mode : record.at("modes")) {
    double largest = 0;
    for (const double v : mode.at("x")) largest = std::max(largest, std::abs(v));
    EXPECT_NEAR(largest, 1, 1e-12);
  }
  EXPECT_EQ(record.at("crack").at(1).at("title"), "Elastic beam, crack of 25 mm");
}

TEST(Record, NumbersAreShortenedEverywhere) {
  nlohmann::ordered_json value = {{"a", {1.23456789, -0.000123456}}, {"b", {{"c", 3}, {"d", "1.23456"}}}};
  shorten_numbers(value, 3);
  EXPECT_EQ(value.dump(), R"({"a":[1.23,-0.000123],"b":{"c":3,"d":"1.23456"}})");
}

/// As the points of a posterior a millionth as wide as its mean: they must not become one.
TEST(Record, NumbersOfAListThatAreCloseStayApart) {
  nlohmann::ordered_json value = {{"points", {1.49999840123, 1.49999861234, 1.49999881111}}};
  shorten_numbers(value, 3);
  const auto points = value.at("points").get<std::vector<double>>();
  for (const std::size_t i : {0u, 1u}) EXPECT_NEAR(points[i + 1] - points[i], 2e-7, 2e-8);
  nlohmann::ordered_json equal = {1.23456, 1.23456};
  shorten_numbers(equal, 3);
  EXPECT_EQ(equal.dump(), "[1.23,1.23]");
}

TEST(Page, EscapesAndStaysWellFormed) {
  Page page("Title <&>", "sub");
  page.result(Usability::with_caveats, {"because <of> this"});
  page.section("One & two").paragraph("a < b").note("n");
  page.tables({{"numbers", {"x"}, {{{"1 ± 2"}}, {{"<r>"}, true}}, Usability::with_caveats}});
  page.figures({{"marginal:0", "a \"figure\""}, {"pairs", "two"}}, "caption & more");
  page.table({"h"}, {{{"<c>"}}}).details("file", "x = \"<\"");
  const std::string html = page.html({{"kind", "curves"}, {"figures", {"</script><!--"}}});
  EXPECT_EQ(record::test::html_fault(html), "");
  EXPECT_NE(html.find("<a href=\"#s1\">One &amp; two</a>"), std::string::npos);
  EXPECT_NE(html.find("<b class=\"word\">Result: usable with caveats</b>"), std::string::npos);
  EXPECT_NE(html.find("<figure data-figure=\"pairs\"><figcaption><b>Figure 2.</b> two"), std::string::npos);
  EXPECT_NE(html.find("class=\"scroll demoted\""), std::string::npos);
  EXPECT_NE(html.find("<tr class=\"expired\">"), std::string::npos);
  // A row of more cells than the header has, from a file: none is lost, and none has a word that is not
  // there.
  const std::string longer = Page("t", "s")
                                 .table({"a", "b", "c", "d"}, {{{"1", "2", "3", "4", "5"}}})
                                 .html(nlohmann::ordered_json::object());
  EXPECT_NE(longer.find("<td data-of=\"d\">4</td><td>5</td>"), std::string::npos);
  // What the record says cannot end the element that holds it.
  EXPECT_NE(html.find(R"("\u003c/script>\u003c!--")"), std::string::npos);
}

TEST(Page, AsksForNothingOutside) {
  const std::string html = Page("t", "s").html(nlohmann::ordered_json::object());
  EXPECT_NE(html.find("default-src 'none'"), std::string::npos);
  for (const char* asks : {"<link", "@import", " src=\"", "url(http", "connect-src"})
    EXPECT_EQ(html.find(asks), std::string::npos) << asks;
}

TEST(InferenceReport, WhatDoesNotFitIsNotUsableHoweverWellItWasComputed) {
  const auto judged = [](nlohmann::json content) {
    content["trusted"] = content.value("trusted", true);
    return judgement(content);
  };
  const auto clean = judged({{"verdict", "Trusted: map of order 2."}, {"fit_probability", 0.4}});
  EXPECT_EQ(clean.usability, Usability::usable);
  EXPECT_EQ(clean.sentences, std::vector<std::string>{"Computation trusted: map of order 2."});
  const auto missed =
      judged({{"verdict", "Trusted: map; the tolerance was missed, though."}, {"tolerance_reached", false}});
  EXPECT_EQ(missed.usability, Usability::with_caveats);
  const auto cut = judged({{"verdict", "Trusted: map. But 99 % of a lies at an end."},
                           {"computation", "Trusted: map."},
                           {"doubts", {"99 % of a lies at an end."}},
                           {"fit_probability", 0.4}});
  EXPECT_EQ(cut.usability, Usability::with_caveats);
  const auto misfit = judged({{"verdict", "Trusted: map. But one. But the observations do not fit."},
                              {"computation", "Trusted: map."},
                              {"doubts", {"one.", "the observations do not fit."}},
                              {"fit_probability", 1e-20}});
  EXPECT_EQ(misfit.usability, Usability::not_usable);
  EXPECT_EQ(misfit.sentences,
            (std::vector<std::string>{"One.", "The observations do not fit.", "Computation trusted: map."}));
  const auto untrusted = judged({{"verdict", "Not trusted: too few."}, {"trusted", false}});
  EXPECT_EQ(untrusted.usability, Usability::not_usable);
  EXPECT_EQ(untrusted.sentences.front(), "Computation not trusted: too few.");
}

/// What the model states in physical units: 1 means 210 GPa.
TEST(InferenceReport, NumbersOfAParameterAreInItsUnit) {
  const nlohmann::json content = {
      {"parameters", {"E", "nu"}},
      {"mean", {1.01, 0.3}},
      {"covariance", {{1e-4, 0}, {0, 4e-4}}},
      {"physical", {{"E", {{"mean", 212.1e9}, {"std", 2.1e9}, {"units", "Pa"}}}}},
      {"maximum_a_posteriori", {1.0, 0.31}},
      {"quantiles", {{"levels", {0.025, 0.975}}, {"values", {{0.99, 1.03}, {0.26, 0.34}}}}},
      {"skewness", {0, 0}},
      {"kurtosis", {3, 3}},
      {"method", "grid"},
      {"trusted", true},
      {"verdict", "Trusted: grid."},
      {"ess", 1},
      {"log_evidence", -3},
      {"log_evidence_error", 0.1},
      {"model_evaluations", 10},
      {"phases", nlohmann::json::array()},
      {"model_calls", {{"evaluate", 1}, {"gradient", 0}, {"apply_jacobian", 0}, {"apply_hessian", 0}}},
      {"created_by", "knothe 9"},
      {"model", "m.h5"},
      {"seed", 1},
      {"priors", {"uniform", "uniform"}},
      {"project", ""},
      {"figures", {{"posterior", nlohmann::json::array()}, {"observations", {{"residual", {0.5, -1.2}}}}}}};
  const std::string html = inference_report(content, "inference.json");
  // What was observed and what was inferred come first, then the numbers.
  const auto place = [&](const char* text) { return html.find(text); };
  EXPECT_LT(place("data-figure=\"observations\""), place("data-figure=\"pairs\""));
  EXPECT_LT(place("data-figure=\"pairs\""), place("<caption>Parameters"));
  EXPECT_LT(place("<caption>Parameters"), place("data-figure=\"marginal:0\""));
  EXPECT_NE(place("data-figure=\"marginal:1\""), std::string::npos);
  for (const char* row :
       {"<td data-of=\"parameter\">E</td><td data-of=\"estimate\">212.1 ± 2.1 GPa</td>"
        "<td data-of=\"most probable\">210.0 GPa</td><td data-of=\"95 % between\">207.9 … 216.3 GPa</td>",
        "<td data-of=\"parameter\">nu</td><td data-of=\"estimate\">0.300 ± 0.020</td>"
        "<td data-of=\"most probable\">0.3100</td>"})
    EXPECT_NE(html.find(row), std::string::npos) << row;
}

TEST(Page, ResultsAreSaidInWordsForPeople) {
  EXPECT_EQ(result_words(Usability::usable), "usable");
  EXPECT_EQ(result_words(Usability::with_caveats), "usable with caveats");
  EXPECT_EQ(result_words(Usability::not_usable), "do not use");
}

/// What studies/reproduction writes, of one figure with two drawings.
nlohmann::json small_study() {
  return nlohmann::json::parse(R"({"created_by": "knothe 9", "publication": "Rubio <2019>", "quick": true,
    "seed": 7, "elapsed_s": 12.4, "machine": {"cores": 2, "processor": "a"}, "faces": [],
    "first": [["Y0", "1.04", "1.00"]], "figures": [{"figure": "5", "heading": "Fig. 5 of the paper: a < b",
      "setting": "s", "panels": [{"caption": "c", "drawings": [{"kind": "chart", "title": "one"},
        {"kind": "map", "title": "two"}]}], "tables": [{"caption": "t", "header": ["h"], "rows": [["x"]]}],
      "rows": [{"quantity": "length", "unit": "mm", "paper": "37.2", "here": "37.4", "why": "mesh"},
               {"quantity": "ratio", "unit": "1", "paper": "2", "here": "3", "why": "noise"}]}]})");
}

TEST(Study, PageHasTheComparisonAndAPlaceForEveryDrawing) {
  const std::string folder = testing::TempDir() + "study_report";
  std::filesystem::create_directories(folder);
  EXPECT_FALSE(holds_study(folder + "/none"));
  const std::string file = folder + "/reproduce.json", output = folder + "/page.html";
  std::ofstream(file) << small_study().dump();
  ASSERT_TRUE(holds_study(folder));
  write_study_report(folder, output);
  std::stringstream read;
  read << std::ifstream(output).rdbuf();
  const std::string html = read.str();
  EXPECT_EQ(record::test::html_fault(html), "");
  for (const char* words :
       {"Rubio &lt;2019&gt;, section 6", "seed 7, quick study in 12 s", "Fig. 5 of the paper: a &lt; b",
        "<figure data-figure=\"drawing:1\"><figcaption><b>Figure 2.</b> two</figcaption>",
        "<td data-of=\"quantity\">length, mm</td><td data-of=\"paper\">37.2</td>",
        "<td data-of=\"quantity\">ratio</td>", "<td>Machine: cores</td><td>2</td>", "<caption>t</caption>",
        R"({"kind":"study","faces":[],"drawings":[{"kind":"chart","title":"one"})"})
    EXPECT_NE(html.find(words), std::string::npos) << words;
  nlohmann::json broken = small_study();
  broken["figures"][0].erase("rows");
  std::ofstream(file) << broken.dump();
  EXPECT_THROW(write_study_report(folder, output), DataError);
}

}  // namespace
}  // namespace knothe::report
