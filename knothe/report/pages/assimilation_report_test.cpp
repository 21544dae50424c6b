// The whole page, from a made-up assimilation that looks like the paper's.
#include "knothe/report/pages/assimilation_report.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "knothe/base/error.hpp"
#include "knothe/files/netcdf.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/record/number_text.hpp"
#include "knothe/record/testing/result_examples.hpp"
#include "knothe/report/data/report_record.hpp"

namespace knothe::report {
namespace {

std::string contents_of(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

/// What the page's figures are drawn from.
nlohmann::json record_in(const std::string& html) {
  const std::string begin = "<script type=\"application/json\" id=\"record\">";
  const std::size_t at = html.find(begin) + begin.size();
  return nlohmann::json::parse(html.substr(at, html.find("</script>", at) - at));
}

TEST(AssimilationReport, ShowsEverySection) {
  const files::TestFolder place;
  const std::string folder = record::test::write_results(place), model_path = folder + "/beam.h5";
  model::SeparatedModel(record::test::small_beam(model::Form::tree)).save(model_path);
  write_assimilation_report(folder, model_path, folder + "/report.html");
  const std::string html = contents_of(folder + "/report.html");
  EXPECT_EQ(record::test::html_fault(html), "");
  for (const char* heading :
       {"What the data say about the parameters", "Forecast", "Which steps carry information",
        "How it was computed", "The reduced model", "Comparison with the paper", "Provenance"})
    EXPECT_NE(html.find(std::string(">") + heading + "</h2>"), std::string::npos) << heading;
  EXPECT_NE(html.find("99 of 100 steps"), std::string::npos);
  EXPECT_NE(html.find("not trusted: 22"), std::string::npos);
  EXPECT_NE(html.find("<td data-of=\"true value\">1, 0.6 σ away</td>"), std::string::npos);
  EXPECT_NE(html.find("Equivalent elastic crack length at time 0.3"), std::string::npos);
  EXPECT_NE(html.find("37.2 mm (mean), 37.6 mm"), std::string::npos);
  EXPECT_NE(html.find("the order no longer helps"), std::string::npos);
  EXPECT_NE(html.find("reproduces the predicted displacements to 2.5 µm RMS"), std::string::npos);
  EXPECT_NE(html.find("Space mode 4"), std::string::npos);
  EXPECT_NE(html.find("crack of 25 mm"), std::string::npos);
  EXPECT_NE(html.find("# &lt;a comment&gt; &amp; &quot;quotes&quot;"), std::string::npos);
  for (const char* watch :
       {">Does the model fit the data?</h2>", "The alarm was raised at step 60: from some steps before on",
        "the model does not explain the data", "Inferred size of the model discrepancy", ">m10.h5<",
        "u_y: mean residual of the last 2 steps"})
    EXPECT_NE(html.find(watch), std::string::npos) << watch;
  EXPECT_LT(html.size(), 4u << 20);
}

TEST(AssimilationReport, CanonicalModelsToo) {
  const files::TestFolder place;
  const std::string folder = record::test::write_results(place, 30);
  const model::SeparatedModel model(record::test::small_beam(model::Form::canonical));
  const std::string html = assimilation_report(record::read_results(folder), &model);
  EXPECT_EQ(record::test::html_fault(html), "");
  EXPECT_NE(html.find("in the canonical form: 4 space modes"), std::string::npos);
  EXPECT_NE(html.find("Parameter functions along A_d"), std::string::npos);
}

TEST(AssimilationReport, SaysWhatIsMissing) {
  const files::TestFolder place;
  const std::string folder = record::test::write_results(place, 1);
  std::filesystem::remove(folder + "/summary.json");
  write_assimilation_report(folder, folder + "/none.h5", folder + "/report.html");
  const std::string html = contents_of(folder + "/report.html");
  EXPECT_EQ(record::test::html_fault(html), "");
  EXPECT_NE(html.find("summary.json is missing"), std::string::npos);
  EXPECT_NE(html.find("The figures of the model are left out"), std::string::npos);
  EXPECT_NE(html.find("none.h5"), std::string::npos);
  EXPECT_NE(html.find("no load–displacement curve"), std::string::npos);
  EXPECT_EQ(html.find("Comparison with the paper</h2>"), std::string::npos);
}

TEST(AssimilationReport, BrokenResultsLeaveNoPage) {
  const files::TestFolder place;
  EXPECT_THROW(write_assimilation_report("/nonexistent", "", place.file("none.html")), DataError);
  EXPECT_FALSE(std::filesystem::exists(place.file("none.html")));
}

TEST(AssimilationReport, LearningIsWhereTheStandardDeviationFalls) {
  const files::TestFolder place;
  const record::Results results = record::read_results(record::test::write_results(place));
  for (std::size_t d : {0u, 1u}) {
    const auto steps = learning_steps(results, d);
    EXPECT_EQ(steps.size(), 5u);
    for (std::size_t i : steps) {
      EXPECT_GE(results.steps[i].step, 17u);
      EXPECT_LE(results.steps[i].step, 40u);
    }
  }
}

TEST(AssimilationReport, ComparisonOnlyForThePapersBeam) {
  const files::TestFolder place;
  record::Results results = record::read_results(record::test::write_results(place, 60));
  const auto rows = comparison_with_paper(results);
  ASSERT_EQ(rows.size(), 5u);
  EXPECT_EQ(rows[0].cells[1], "1.04 ± 0.041");
  EXPECT_NE(rows[3].cells[2].find("up to 5 (first reached at step 19)"), std::string::npos);
  results.parameters[0].name = "a";
  EXPECT_TRUE(comparison_with_paper(results).empty());
}

/// A number for each member that a figure asks for, from the files themselves.
TEST(AssimilationReport, TheRecordHasWhatFiguresAreDrawnFrom) {
  const files::TestFolder place;
  const std::string folder = record::test::write_results(place, 100);
  const model::SeparatedModel model(record::test::small_beam(model::Form::tree));
  const auto record = record_in(assimilation_report(record::read_results(folder), &model));
  ASSERT_EQ(record.at("lines").size(), 100u);
  std::ifstream file(folder + "/steps.jsonl");
  std::string text;
  for (int i = 0; i < 58; ++i) std::getline(file, text);
  const auto line = nlohmann::json::parse(text);
  const auto& written = record.at("lines").at(57);
  EXPECT_EQ(written.at("step"), line.at("step"));
  EXPECT_NEAR(written.at("mean").at(1), line.at("mean").at(1), 1e-6);
  EXPECT_NEAR(written.at("quantiles").at("values").at(0).at(4), line.at("quantiles").at("values").at(0).at(4),
              1e-6);
  EXPECT_NEAR(written.at("forecast").at("crack").at("values").at(0),
              line.at("forecast").at("crack").at("values").at(0), 1e-8);
  EXPECT_NEAR(written.at("monitor").at("cumulative_sum"), line.at("monitor").at("cumulative_sum"), 1e-5);
  EXPECT_EQ(written.at("elapsed_us").at("total"), 400.0);
  // Densities of some forty steps, the last among them.
  int densities = 0;
  for (const auto& l : record.at("lines")) densities += l.contains("marginals") ? 1 : 0;
  EXPECT_EQ(densities, 34);
  EXPECT_EQ(record.at("lines").at(99).at("marginals").at("Ad").at("points").size(), 101u);
  EXPECT_EQ(record.at("lines").at(99).at("forecast").at("crack").at("density").at("points").size(), 161u);
  const auto& summary = record.at("summary");
  EXPECT_EQ(summary.at("parameters").at(0).at("reference"), 216.0);
  EXPECT_EQ(summary.at("forecasts").at("crack").at("threshold"), 0.04);
  EXPECT_EQ(summary.at("prior_marginals").at("Y0").at("density").size(), 101u);
  EXPECT_EQ(record.at("load").at("mean").size(), 101u);
  EXPECT_EQ(record.at("sensors").at("component"), "xxy");
  EXPECT_EQ(record.at("specimen").at("cells").size(), 209u);
  ASSERT_EQ(record.at("functions").size(), 3u);  // of time and two parameters
  EXPECT_EQ(record.at("functions").at(2).at("curves").size(), 4u);
}

/// Two draws of a prediction about a known mean: mean and standard deviation by hand.
TEST(AssimilationReport, MeasuredValuesStandBesideTheirPredictions) {
  const files::TestFolder place;
  const std::string folder = record::test::write_results(place, 3);
  using Names = std::vector<std::string>;
  files::NetcdfWriter out(folder + "/posterior.nc");
  const std::vector<std::int64_t> steps = {1, 2, 3}, draws = {0, 1}, chain = {0};
  const std::vector<double> time = {0.01, 0.02, 0.03};
  for (const char* group : {"observed_data", "posterior_predictive"}) {
    out.add_dimension(group, "step", steps, {"", ""});
    out.add_dimension(group, "observation", Names{"x0", "y0"}, {"", ""});
    out.add_variable(group, "time", Names{"step"}, time, {"1", ""});
  }
  out.add_dimension("posterior_predictive", "chain", chain, {"", ""});
  out.add_dimension("posterior_predictive", "draw", draws, {"", ""});
  // Sensor 1, along y, moves most; draws 1 apart about 1, 3, 7 (times 1e-6).
  std::vector<double> predicted;
  for (const double half : {-0.5, 0.5})
    for (const double mean : {1.0, 3.0, 7.0})
      predicted.insert(predicted.end(), {1e-6 * (1 + half), 1e-6 * (mean + half)});
  out.add_variable("posterior_predictive", "displacement", Names{"chain", "draw", "step", "observation"},
                   predicted, {"m", ""});
  const double nan = std::nan("");
  out.add_variable("observed_data", "displacement", Names{"step", "observation"},
                   std::vector<double>{1e-6, 2e-6, nan, 3e-6, 1e-6, 6e-6}, {"m", ""});
  out.add_dimension("constant_data", "observation", Names{"x0", "y0"}, {"", ""});
  out.add_dimension("constant_data", "axis", Names{"x", "y", "z"}, {"1", ""});
  out.add_variable("constant_data", "points", Names{"observation", "axis"},
                   std::vector<double>{0, 0, 0, 0.012, 0.03, 0}, {"m", ""});
  out.add_variable("constant_data", "component", Names{"observation"}, std::vector<std::int64_t>{0, 1},
                   {"1", ""});
  out.close();
  const auto record = predictions_record(record::read_results(folder));
  ASSERT_EQ(record.at("measured").size(), 2u);
  const auto& first = record.at("measured").at(0);
  EXPECT_EQ(first.at("label"), "u_y at (12.0, 30.0) mm");
  EXPECT_EQ(first.at("time").get<std::vector<double>>(), time);
  const double std = std::sqrt(0.5) * 1e-6;
  for (int s = 0; s < 3; ++s) {
    const double mean = 1e-6 * std::array{1.0, 3.0, 7.0}[s];
    EXPECT_NEAR(first.at("mean").at(s), mean, 1e-15);
    EXPECT_NEAR(first.at("low").at(s), mean - 1.959964 * std, 1e-12);
    EXPECT_NEAR(first.at("high").at(s), mean + 1.959964 * std, 1e-12);
  }
  EXPECT_TRUE(record.at("measured").at(1).at("measured").at(1).is_null());
  const auto& residuals = record.at("residuals");
  ASSERT_EQ(residuals.at("value").size(), 5u);  // one of six is missing
  EXPECT_TRUE(std::ranges::is_sorted(residuals.at("time").get<std::vector<double>>()));
  double sum = 0;  // (0, 1, 0, 0, −1) / √½
  for (const double v : residuals.at("value")) sum += v * v;
  EXPECT_NEAR(sum, 4, 1e-6);
}

TEST(AssimilationReport, TheLastDecisionStandsBelowTheBannerAndAllOfThemInASection) {
  const files::TestFolder place;
  record::Results results = record::read_results(record::test::write_results(place, 60));
  results.judged = true;
  std::string html = assimilation_report(results, nullptr, "none");
  EXPECT_EQ(record::test::html_fault(html), "");
  const std::size_t next = html.find(
      "<p class=\"next\"><b>Next: load to time 0.62</b> each measurement costs &lt;0.05&gt; nats</p>");
  ASSERT_NE(next, std::string::npos);
  EXPECT_LT(html.find("<b class=\"word\">Result"), next);
  EXPECT_LT(next, html.find("data-figure=\"specimen\""));
  EXPECT_NE(html.find("data-figure=\"decisions\""), std::string::npos);
  const auto decision = record_in(html).at("lines").at(7).at("decision");
  EXPECT_EQ(decision.at("action"), "load");
  EXPECT_EQ(decision.at("time"), 0.1);
  EXPECT_FALSE(decision.contains("plan"));
  results.time_units = "h";
  html = assimilation_report(results, nullptr, "none");
  EXPECT_NE(html.find("<b>Next: load to time 0.62 h</b>"), std::string::npos);
  // In the load's unit where the model knows it.
  results.steps.back().decision->load = 1.24e-4;
  results.steps.back().decision->load_units = "m";
  html = assimilation_report(results, nullptr, "none");
  EXPECT_NE(html.find("<b>Next: load to 0.124 mm</b>"), std::string::npos);
  for (record::Step& step : results.steps) step.decision.reset();
  html = assimilation_report(results, nullptr, "none");
  EXPECT_EQ(html.find("<p class=\"next\">"), std::string::npos);
  EXPECT_EQ(html.find("data-figure=\"risk\""), std::string::npos);
}

TEST(AssimilationReport, AParameterWithAUnitIsSaidInItThroughoutItsRow) {
  const files::TestFolder place;
  record::Results results = record::read_results(record::test::write_results(place, 60));
  results.judged = false;
  results.verdict = {};
  record::ParameterSummary& p = results.parameters[0];
  record::Step& last = results.steps.back();
  p = {.name = "E", .units = "Pa", .truth = 30.5e9};
  last.mean[0] = 30.123e9, last.covariance(0, 0) = 4e16;  // 0.2 GPa
  last.quantiles.row(0) = Eigen::RowVectorXd::LinSpaced(last.quantiles.cols(), 29.7e9, 30.5e9);
  const auto cells = headline(results)[0].rows[0].cells;
  EXPECT_EQ(cells,
            (std::vector<std::string>{"E", "30.12 ± 0.20 GPa", "29.70 … 30.50 GPa", "30.5 GPa, 1.9 σ away"}));
  p.truth = 60e9;  // as under data in a wrong unit
  EXPECT_EQ(headline(results)[0].rows[0].cells.back(), "60 GPa, more than 100 σ away");
  // Multiples of a reference too; without a unit they stay multiples.
  p = {.name = "Y0", .reference = 216, .units = "J/m3"};
  last.mean[0] = 1.02, last.covariance(0, 0) = 4e-4, last.maximum_a_posteriori[0] = 1.03;
  last.quantiles.row(0) = Eigen::RowVectorXd::LinSpaced(last.quantiles.cols(), 0.98, 1.06);
  EXPECT_EQ(headline(results)[0].rows[0].cells,
            (std::vector<std::string>{"Y₀", "220.3 ± 4.3 J/m³", "211.7 … 229.0 J/m³", "222.5 J/m³"}));
  p.units.clear();
  EXPECT_EQ(headline(results)[0].rows[0].cells,
            (std::vector<std::string>{"Y₀ (1 = 216)", "1.020 ± 0.020", "0.980 … 1.060", "1.030"}));
}

/// The table says so itself, so that it is struck out without JavaScript too.
TEST(AssimilationReport, ShiftsByAnInputsErrorAreWorthWhatTheResultIs) {
  const files::TestFolder place;
  record::Results results = record::read_results(record::test::write_results(place, 60));
  results.judged = true;
  results.verdict.level = assimilation::VerdictLevel::reject;
  results.input_shifts = {{.name = "clock",
                           .relative = 0.02,
                           .shift = Eigen::Vector2d(0.03, -0.01),
                           .in_std = Eigen::Vector2d(1.5, -0.5)}};
  EXPECT_NE(assimilation_report(results, nullptr, "none")
                .find("<div class=\"scroll demoted rejected\"><table><caption>If an input is too large"
                      "</caption><thead><tr><th>input</th><th>Y₀ shifts by</th><th>A_d shifts by</th></tr>"
                      "</thead><tbody><tr><td>clock (imposed displacement) by 2\u00a0%</td>"
                      "<td>+1.5\u00a0σ (0.030)</td>"),
            std::string::npos);
}

TEST(AssimilationReport, RejectedNumbersAreDemotedAndExpiredForecastsDoNotLead) {
  const files::TestFolder place;
  record::Results results = record::read_results(record::test::write_results(place, 60));
  results.steps.back().forecast["early"] = results.steps.back().forecast.at("crack");
  results.steps.back().forecast["early"].is_past = true;
  results.steps.back().forecast["aaa"] = results.steps.back().forecast.at("early");
  for (const auto level : {assimilation::VerdictLevel::ok, assimilation::VerdictLevel::caution,
                           assimilation::VerdictLevel::reject}) {
    results.judged = true;
    results.verdict = {};
    results.verdict.level = level;
    // Three times the posterior's own deviation: with it √10.
    results.verdict.model_shift_std = Eigen::Vector2d(3, 0);
    const bool is_ok = level == assimilation::VerdictLevel::ok,
               is_rejected = level == assimilation::VerdictLevel::reject;
    const auto tables = headline(results);
    ASSERT_EQ(tables.size(), 2u);
    for (const Table& table : tables) EXPECT_EQ(table.worth, usability(level));
    const double std = results.steps.back().standard_deviations()[0];
    const double mean = results.steps.back().mean[0];
    EXPECT_EQ(tables[0].rows[0].cells[1], is_rejected
                                              ? record::readable(mean, 2)
                                              : record::with_uncertainty(mean, std * std::sqrt(10.0)));
    for (const Table& table : tables)
      for (const TableRow& row : table.rows)
        EXPECT_EQ(row.cells[1].find("±") == std::string::npos, is_rejected) << row.cells[1];
    EXPECT_FALSE(tables[1].rows[0].expired);
    EXPECT_TRUE(tables[1].rows[1].expired && tables[1].rows[2].expired);
    const std::string html = assimilation_report(results, nullptr, "none");
    const std::string words = is_ok ? "Result: usable</b>"
                              : level == assimilation::VerdictLevel::caution
                                  ? "Result: usable with caveats</b>"
                                  : "Result: do not use</b>";
    EXPECT_NE(html.find(words), std::string::npos) << words;
    EXPECT_EQ(record::test::count_of(html, "±:"), 1u);
  }
}

}  // namespace
}  // namespace knothe::report
