#include "knothe/project/project_file.hpp"

#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/project/option_table.hpp"

namespace knothe::project {
namespace {

const char* k_minimal = R"(model = "M.h5"
data = "D.h5"
[parameters]
Y0 = { prior = "normal", mean = 0.9, std = 0.4 }
Ad = { prior = "normal", mean = 1.1, std = 0.4 }
)";

std::string complaint(const std::string& text) {
  try {
    (void)parse_project(text, "dir/p.toml");
  } catch (const ProjectError& error) {
    return error.what();
  }
  return "valid";
}

TEST(ProjectFile, DefaultsAndPaths) {
  const Project p = parse_project(k_minimal, "dir/p.toml");
  EXPECT_EQ(p.model, "dir/M.h5");
  EXPECT_EQ(p.data, "dir/D.h5");
  EXPECT_EQ(p.results, "dir/results/");
  EXPECT_EQ(p.method.kind, posterior::Method::automatic);
  EXPECT_EQ(p.method.update.map.tolerance, 1e-3);
  EXPECT_EQ(p.method.update.map.max_order, 8);
  EXPECT_EQ(p.text, k_minimal);
  EXPECT_FALSE(p.offline || p.simulate);
}

TEST(ProjectFile, ParametersKeepTheOrderOfTheFile) {
  const Project p = parse_project(
      "[parameters]\nz = { prior = \"uniform\", lower = 0, upper = 1 }\n"
      "a = { prior = \"lognormal\", mu = 0, sigma = 0.25 }\n",
      "p.toml");
  ASSERT_EQ(p.parameters.size(), 2u);
  EXPECT_EQ(p.parameters[0].name, "z");
  EXPECT_EQ(p.parameters[1].name, "a");
  EXPECT_EQ(p.parameters[1].prior.describe(), "lognormal(0, 0.25)");
}

TEST(ProjectFile, LongAndShortFormsOfModelAndData) {
  const Project p =
      parse_project("[model]\nseparated = \"M.h5\"\n[data]\nfile = \"/abs/D.csv\"\n", "x/p.toml");
  EXPECT_EQ(p.model, "x/M.h5");
  EXPECT_EQ(p.data, "/abs/D.csv");
}

TEST(ProjectFile, NamesOfQuantitiesMayHaveDots) {
  const Project p = parse_project(
      "[simulate]\ntruth = { a = 1.5 }\n[simulate.noise]\n\"TIP.81.vy\" = 3e-5\ndrift = 2e-3\n", "p.toml");
  ASSERT_TRUE(p.simulate.has_value());
  ASSERT_EQ(p.simulate->noise.size(), 2u);
  EXPECT_EQ(p.simulate->noise.begin()->first, "TIP.81.vy");
  EXPECT_EQ(p.simulate->noise.begin()->second, 3e-5);
  EXPECT_EQ(complaint("[simulate]\ntruth = { a = 1 }\n[simulate.noise]\n\"TIP.81.vy\" = -1\n"),
            "dir/p.toml:4:15: error: \"simulate.noise.TIP.81.vy\" must be a positive number, not -1");
}

TEST(ProjectFile, MisspeltKeyGetsASuggestion) {
  EXPECT_EQ(complaint("[method]\ntolerence = 1e-3\n"),
            "dir/p.toml:2:1: error: unknown key \"tolerence\" in [method] (did you mean \"tolerance\"?)");
  EXPECT_EQ(complaint("[metod]\nkind = \"grid\"\n"),
            "dir/p.toml:1:2: error: unknown table \"metod\" (did you mean \"method\"?)");
}

TEST(ProjectFile, WrongTypesAndValues) {
  EXPECT_EQ(complaint("[method]\ntolerance = \"small\"\n"),
            "dir/p.toml:2:13: error: \"method.tolerance\" must be a positive number, not \"small\"");
  EXPECT_EQ(complaint("[method]\nmax_order = 0\n"),
            "dir/p.toml:2:1: error: \"method.max_order\" must be at least 1");
  EXPECT_EQ(
      complaint("[method]\nkind = \"transprot\"\n"),
      "dir/p.toml:2:8: error: \"method.kind\" must be one of \"auto\", \"transport\", \"grid\", \"mcmc\", "
      "\"smc\", \"ekf\", \"ukf\", \"enkf\", not "
      "\"transprot\" (did you mean "
      "\"transport\"?)");
  EXPECT_EQ(complaint("[parameters]\nY0 = { prior = \"normal\", mean = 1, std = -1 }\n"),
            "dir/p.toml:2:42: error: \"parameters.Y0.std\" must be a positive number, not -1");
  EXPECT_EQ(complaint("[parameters]\nY0 = { prior = \"normal\", mean = 1 }\n"),
            "dir/p.toml:2:6: error: [parameters.Y0]: a normal prior needs \"std\"");
}

const std::string k_own_solver =
    "[offline.command]\nrun = [\"ccx\", \"job\"]\ntemplates = [\"job.inp\"]\nfield = \"job.frd\"\n"
    "[offline.parameters.k]\nlower = -3\nupper = -1\nunits = \"N/m\"\n";

TEST(ProjectFile, AnotherSolverHasItsOwnParameters) {
  const Project p = parse_project(k_own_solver, "dir/p.toml");
  ASSERT_TRUE(p.offline && p.offline->command);
  EXPECT_FALSE(p.offline->is_beam());
  EXPECT_EQ(p.offline->command->run, (std::vector<std::string>{"ccx", "job"}));
  EXPECT_EQ(p.offline->command->templates, (std::vector<std::string>{"dir/job.inp"}));
  EXPECT_EQ(p.offline->command->result.field, "job.frd");
  EXPECT_EQ(p.offline->parameters[0].reference, 1);
  EXPECT_EQ(p.offline->parameters[0].lower, -3);
}

TEST(ProjectFile, WhatDoesNotGoWithAnotherSolverIsRefused) {
  EXPECT_NE(
      complaint("[offline]\nsteps = 3\n" + k_own_solver).find("[offline] steps is of the built-in beam"),
      std::string::npos);
  EXPECT_NE(
      complaint("[offline]\nmethod = \"latin\"\n" + k_own_solver).find("LATIN-PGD solves for the built-in"),
      std::string::npos);
  EXPECT_NE(
      complaint(k_own_solver + "[offline.umbridge]\nurl = \"http://h:1\"\ntimes = [1]\nnames = [\"a\"]\n")
          .find("has both \"command\" and \"umbridge\""),
      std::string::npos);
  EXPECT_NE(complaint("[offline.command]\nfield = \"a.csv\"\n").find("[offline.command] lacks \"run\""),
            std::string::npos);
  EXPECT_NE(complaint("[offline.command]\nrun = [\"solver\"]\nfield = \"u.npy\"\ntimes = [1]\npoints = "
                      "\"points.csv\"\nunits = [\"mm\"]\n[offline.parameters.k]\nlower = 1\nupper = 2\n")
                .find("\"units\" are those of \"names\": without names a field is a displacement in m"),
            std::string::npos);
  EXPECT_NE(complaint("[offline.parameters.Y0]\nlower = 0.5\nupper = 1.5\n")
                .find("[offline.parameters.Y0] lacks "
                      "\"reference\""),
            std::string::npos);
}

TEST(ProjectFile, TimeMayBeAnOutputOfTheSolver) {
  const Project p = parse_project(
      k_own_solver + "[offline]\ntime = \"opening\"\ntime_values = [1e-6, 3e-6]\n", "dir/p.toml");
  EXPECT_EQ(p.offline->time.output, "opening");
  EXPECT_EQ(p.offline->time.values, (std::vector{1e-6, 3e-6}));
  for (const char* alone : {"time = \"opening\"\n", "time_values = [1, 2]\n"})
    EXPECT_NE(complaint("[offline]\n" + std::string(alone)).find("\"time\" and \"time_values\" go together"),
              std::string::npos);
  for (const char* values : {"[1]", "[1, 3, 3]"})
    EXPECT_NE(complaint("[offline]\ntime = \"a\"\ntime_values = " + std::string(values) + "\n")
                  .find("must be at least two numbers, each greater than the one before"),
              std::string::npos);
  EXPECT_NE(complaint("[offline]\nmethod = \"latin\"\ntime = \"a\"\ntime_values = [1, 2]\n")
                .find("LATIN-PGD solves for all parameters at the same load steps"),
            std::string::npos);
}

TEST(ProjectFile, TheExponentialLawHasAFractureEnergyAndABand) {
  const std::string y0 = "[offline.parameters.Y0]\nreference = 200\nlower = 0.5\nupper = 1.5\n";
  const std::string gf = "[offline.parameters.Gf]\nreference = 80\nlower = 0.5\nupper = 1.5\n";
  const std::string law = "[offline.damage]\nlaw = \"exponential\"\n",
                    band = "regularisation = \"crack-band\"\n";
  for (const std::string& two : {law, std::string("[offline.damage]\nlaw = \"bilinear\"\n")})
    EXPECT_EQ(parse_project(two + band + y0 + gf, "p.toml").offline->parameters[1].name, "Gf");
  EXPECT_NE(complaint(law + band + y0).find("both parameters of the damage law, Y0 and Gf"),
            std::string::npos);
  EXPECT_NE(complaint(y0 + gf).find("both parameters of the damage law, Y0 and Ad"), std::string::npos);
  EXPECT_NE(complaint(law + y0 + gf).find("the law is one of stress against opening: it needs"),
            std::string::npos);
}

TEST(ProjectFile, LimitsOfTheService) {
  const Project p = parse_project("[serve]\nlimits = { displacement = 1, force = 2.5e3 }\n", "p.toml");
  EXPECT_EQ(p.serve.limits, (std::map<std::string, double>{{"displacement", 1}, {"force", 2500}}));
  EXPECT_TRUE(parse_project("", "p.toml").serve.limits.empty());
  EXPECT_EQ(complaint("[serve.limits]\ndisplacement = -1\nforce = inf\n"),
            "dir/p.toml:2:16: error: \"serve.limits.displacement\" must be a positive number, not -1\n"
            "dir/p.toml:3:9: error: \"serve.limits.force\" must be a positive number, not inf");
}

TEST(ProjectFile, AllErrorsAtOnce) {
  const std::string text =
      complaint("modle = \"M.h5\"\n[method]\nseed = 1.5\n[forecast.a]\nquantity = \"output\"\n");
  EXPECT_NE(text.find("dir/p.toml:1:1: error: unknown key \"modle\" (did you mean \"model\"?)"),
            std::string::npos)
      << text;
  EXPECT_NE(text.find("\"method.seed\" must be an integer ≥ 0, not 1.5"), std::string::npos) << text;
  EXPECT_NE(text.find("[forecast.a] lacks \"horizon\""), std::string::npos) << text;
  EXPECT_NE(text.find("[forecast.a] needs \"output\""), std::string::npos) << text;
}

TEST(ProjectFile, WhatIsThereButWrongIsNotCalledMissing) {
  EXPECT_EQ(complaint("[parameters]\nY0 = { prior = \"normla\", mean = 1, std = 1 }\n").find("lacks"),
            std::string::npos);
  EXPECT_EQ(complaint("[observations]\nvalues = [1.0, 0.8, \"x\"]\nstd = [0.1, inf, 0.1]\n"),
            "dir/p.toml:2:21: error: \"observations.values\"[2] must be a finite number, not \"x\"\n"
            "dir/p.toml:3:13: error: \"observations.std\"[1] must be a finite number, not inf");
  EXPECT_EQ(complaint("[model]\numbridge = \"http://h:1\"\nconfig = { x = [1, nan] }\n"),
            "dir/p.toml:3:20: error: \"model.config\": JSON, which servers read, has no word for nan");
}

TEST(ProjectFile, NotTomlSaysWhere) {
  EXPECT_NE(complaint("model = \n").find("dir/p.toml:1:"), std::string::npos);
  EXPECT_NE(complaint("model = \n").find("error: not valid TOML"), std::string::npos);
}

TEST(ProjectFile, MissingFile) {
  try {
    (void)read_project("/nowhere/p.toml");
    FAIL();
  } catch (const ProjectError& error) {
    EXPECT_EQ(error.status(), ExitStatus::project);
    EXPECT_STREQ(error.what(), "/nowhere/p.toml: cannot read the project file: No such file or directory");
  }
}

TEST(ProjectFile, UniformPriorNeedsAnInterval) {
  EXPECT_NE(complaint("[parameters]\na = { prior = \"uniform\", lower = 1, upper = 1 }\n")
                .find("\"upper\" must be greater"),
            std::string::npos);
  EXPECT_NE(complaint("[parameters]\na = { prior = \"uniform\", lower = 1, upper = 2, mean = 3 }\n")
                .find("\"mean\" does not belong to a uniform prior, which takes lower and upper"),
            std::string::npos);
}

TEST(ProjectFile, OfflineTable) {
  const Project p = parse_project(R"([offline]
mesh = { element = 0.01, layers = 2 }
modes = 12
[offline.parameters.Y0]
reference = 216.0
lower = 0.5
upper = 1.5
nodes = 5
[offline.parameters.Ad]
reference = 2.25e-3
lower = 0.6
upper = 1.4
)",
                                  "p.toml");
  ASSERT_TRUE(p.offline);
  EXPECT_EQ(p.offline->element, 0.01);
  EXPECT_EQ(p.offline->layers, 2);
  EXPECT_EQ(p.offline->parameters[0].name, "Y0");
  EXPECT_EQ(p.offline->parameters[1].nodes, 7);
  EXPECT_NE(complaint("[offline.parameters.Y1]\nreference=1\nlower=1\nupper=2\n")
                .find("the beam has no parameter \"Y1\" (did you mean \"Y0\"?)"),
            std::string::npos);
  const std::string tables = "mesh = { element = 0.01 }\ndamage = { regularisation = \"gradient\" }\n";
  EXPECT_NE(complaint("[offline]\n" + tables).find("less than two elements of 0.01 m"), std::string::npos);
  EXPECT_NE(complaint("[offline]\nmethod = \"latin\"\n" + tables).find("LATIN-PGD cannot do gradient damage"),
            std::string::npos);
}

TEST(OptionTable, EveryOptionHasAMeaningAndAUniquePath) {
  std::vector<std::string> paths;
  for (const Option& option : option_table()) {
    EXPECT_FALSE(option.meaning.empty()) << option.path;
    EXPECT_EQ(std::count(paths.begin(), paths.end(), option.path), 0) << option.path;
    EXPECT_EQ(option.kind == ValueKind::choice, !option.choices.empty()) << option.path;
    paths.push_back(option.path);
  }
}

/// Each default, as it is printed, written into a file of its own.
TEST(OptionTable, EveryPrintedDefaultIsAValueThatTheReaderTakes) {
  for (const Option& option : option_table()) {
    if (option.default_value.empty()) continue;
    std::string path = option.path;
    if (const auto star = path.find('*'); star != std::string::npos) path.replace(star, 1, "Y0");
    const std::string text = complaint(path + " = " + option.default_value + "\n");
    EXPECT_EQ(text.find("must be"), std::string::npos) << text;
    EXPECT_EQ(text.find("unknown"), std::string::npos) << text;
    EXPECT_EQ(text.find("not valid TOML"), std::string::npos) << text;
  }
}

/// Options whose default the reference names, by the struct that is read from an empty file.
TEST(OptionTable, PrintsWhatAnEmptyProjectHas) {
  const Project p = parse_project("", "p.toml");
  const auto printed = [](const std::string& path) {
    for (const Option& option : option_table())
      if (option.path == path) return option.default_value;
    return std::string("no such option");
  };
  EXPECT_EQ(printed("method.kind"), '"' + to_text(p.method.kind) + '"');
  EXPECT_EQ(std::stod(printed("method.tolerance")), p.method.update.map.tolerance);
  EXPECT_EQ(std::stoi(printed("method.bias_rank")), p.method.update.bias.rank);
  EXPECT_EQ(printed("method.bias_extrapolation"), "\"joint\"");
  EXPECT_EQ(p.method.update.bias.way, likelihood::BiasOptions::Way::joint);
  EXPECT_EQ(std::stod(printed("dic.element_size")), p.pictures.series.element_size);
  EXPECT_EQ(std::stol(printed("serve.max_body")), p.serve.max_body);
  EXPECT_EQ(printed("results"), '"' + p.results + '"');
  EXPECT_EQ(printed("simulate.dofs.components"), "[\"x\", \"y\"]");
  EXPECT_EQ(std::stod(printed("offline.young_modulus")), 30e9);
  EXPECT_EQ(std::stod(printed("offline.latin.accuracy")), 1e-7);
  EXPECT_EQ(printed("offline.adaptive.grid_error"), "");
}

}  // namespace
}  // namespace knothe::project
