// The whole page, from a made-up assimilation that looks like the paper's.
#include "knothe/report/pages/assimilation_report.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/record/testing/result_examples.hpp"
#include "knothe/report/figures/result_figures.hpp"

namespace knothe::report {
namespace {

std::string contents_of(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

void expect_sound(const std::string& html) {
  EXPECT_EQ(record::test::xml_fault(html), "");
  for (const char* number : {"\"nan", " nan", "\"inf", " inf\"", "Lnan", "Mnan"})
    EXPECT_EQ(html.find(number), std::string::npos);
  // Self-contained: nothing is fetched.
  EXPECT_EQ(record::test::count_of(html, "src="), 0u);
  EXPECT_EQ(record::test::count_of(html, "<link"), 0u);
  EXPECT_EQ(record::test::count_of(html, "@import"), 0u);
  EXPECT_EQ(record::test::count_of(html, "url("), 0u);
}

TEST(AssimilationReport, ShowsEverySection) {
  const files::TestFolder place;
  const std::string folder = record::test::write_results(place), model_path = folder + "/beam.h5";
  model::SeparatedModel(record::test::small_beam(model::Form::tree)).save(model_path);
  write_assimilation_report(folder, model_path, folder + "/report.html");
  const std::string html = contents_of(folder + "/report.html");
  expect_sound(html);
  for (const char* heading :
       {"What the data say about the parameters", "Forecast", "Which steps carry information",
        "How it was computed", "The reduced model", "Comparison with the paper", "Provenance"})
    EXPECT_NE(html.find(std::string(">") + heading + "</h2>"), std::string::npos) << heading;
  EXPECT_NE(html.find("99 of 100 steps"), std::string::npos);
  EXPECT_NE(html.find("not trusted: 22"), std::string::npos);
  EXPECT_NE(html.find("0.6 σ from the true value 1"), std::string::npos);
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
        "u_y: mean residual of the last 2 steps", "y (mm)"})
    EXPECT_NE(html.find(watch), std::string::npos) << watch;
  EXPECT_LT(html.size(), 4u << 20);
}

TEST(AssimilationReport, CanonicalModelsToo) {
  const files::TestFolder place;
  const std::string folder = record::test::write_results(place, 30);
  const model::SeparatedModel model(record::test::small_beam(model::Form::canonical));
  const std::string html = assimilation_report(record::read_results(folder), &model);
  expect_sound(html);
  EXPECT_NE(html.find("in the canonical form: 4 space modes"), std::string::npos);
  EXPECT_NE(html.find("Parameter functions along A_d"), std::string::npos);
}

TEST(AssimilationReport, SaysWhatIsMissing) {
  const files::TestFolder place;
  const std::string folder = record::test::write_results(place, 1);
  std::filesystem::remove(folder + "/summary.json");
  write_assimilation_report(folder, folder + "/none.h5", folder + "/report.html");
  const std::string html = contents_of(folder + "/report.html");
  expect_sound(html);
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

TEST(AssimilationReport, OverviewIsAPictureOfItsOwn) {
  const files::TestFolder place;
  const std::string folder = record::test::write_results(place);
  write_overview_svg(folder, folder + "/overview.svg");
  const std::string svg = contents_of(folder + "/overview.svg");
  EXPECT_EQ(record::test::xml_fault(svg), "");
  EXPECT_EQ(svg.find("<?xml"), 0u);
  EXPECT_NE(svg.find("Posterior of A_d"), std::string::npos);
  EXPECT_NE(svg.find("Equivalent elastic crack length at time 0.3"), std::string::npos);
}

}  // namespace
}  // namespace knothe::report
