#include "knothe/model/simulator/command_simulator.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/simulator/run_file.hpp"

namespace knothe::model {
namespace {

using files::message_of;
using testing::HasSubstr;

/// Parameters k (a multiple of 100 N/m) and c.
class CommandSimulatorTest : public testing::Test {
 protected:
  CommandOptions shell(const std::string& script) const {
    CommandOptions options;
    options.run = {"sh", "-c", script};
    options.result.field = "result.csv";
    return options;
  }
  CommandSimulator simulator(const CommandOptions& options) const {
    return {options, {{"k", {1, 2}, "1", "stiffness", 100.0}, {"c", {0, 1}, "1", ""}}, folder_.file("work")};
  }
  std::string write(const std::string& name, const std::string& text) const {
    files::write_text_atomically(folder_.file(name), text);
    return folder_.file(name);
  }
  std::size_t kept_folders() const {
    const std::filesystem::path work = folder_.file("work");
    if (!std::filesystem::exists(work)) return 0;
    return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(work), {}));
  }
  files::TestFolder folder_;
  const std::string csv_ = "(echo 'time,u [mm],force'; echo '0.5,2,{{k}}'; echo 1,4,{{c}}) > result.csv";
};

TEST_F(CommandSimulatorTest, FillsPhysicalValuesAndReadsNamesUnitsAndTimes) {
  CommandSimulator command = simulator(shell(csv_));
  const Snapshots solution = command.solve(std::vector{1.25, 0.1});
  EXPECT_EQ(solution.time, (std::vector<double>{0.5, 1}));
  EXPECT_EQ(solution.values, (std::vector<double>{2e-3, 125, 4e-3, 0.1}));
  ASSERT_EQ(solution.quantities.size(), 2u);
  EXPECT_EQ(solution.quantities[0].name, "u");
  EXPECT_EQ(solution.quantities[0].units, "m");
  EXPECT_EQ(solution.parameters_at(0), (std::vector<double>{1.25, 0.1}));
  EXPECT_EQ(kept_folders(), 0u);
}

TEST_F(CommandSimulatorTest, FillsTemplatesInFormatsAndLinksFiles) {
  CommandOptions options = shell("cat head.csv input.csv > result.csv");
  options.templates = {write("input.csv", "1,{{k:.2e}},{{ c}} \n2,{{c:8.3f}},{{{{c}}}}\n")};
  options.files = {write("head.csv", "time,u,v\n")};
  CommandSimulator command = simulator(options);
  // What is no placeholder stays: the numbers beside it cannot be read, and the message has the line.
  const std::string message = message_of<DataError>([&] { (void)command.solve(std::vector{1.25, 0.1}); });
  EXPECT_THAT(message, HasSubstr("result.csv:2:"));
  EXPECT_THAT(message, HasSubstr("its folder is kept"));
  options.templates = {write("input.csv", "1,{{k:.2e}},{{c}}\n2,{{c:8.3f}},7\n")};
  EXPECT_EQ(simulator(options).solve(std::vector{1.25, 0.1}).values, (std::vector<double>{125, 0.1, 0.1, 7}));
}

TEST_F(CommandSimulatorTest, ThePlaceholdersAreCheckedBeforeTheFirstRun) {
  EXPECT_THAT(message_of<ProjectError>([&] { (void)simulator(shell("echo {{k}} {{d}} {{c}}")); }),
              HasSubstr("{{d}} is no parameter"));
  EXPECT_THAT(message_of<ProjectError>([&] { (void)simulator(shell("echo {{k}}")); }),
              HasSubstr("the parameter c is in no template and not in \"run\": write {{c}}"));
  EXPECT_THAT(message_of<ProjectError>([&] { (void)simulator(shell("echo {{k:q}} {{c}}")); }),
              HasSubstr("\"q\" is no format of a number"));
  CommandOptions options = shell(csv_);
  options.templates = {folder_.file("none.inp")};
  EXPECT_THAT(message_of<ProjectError>([&] { (void)simulator(options); }), HasSubstr("there is no file"));
}

TEST_F(CommandSimulatorTest, AFailureSaysWhatTheProgramSaidAndKeepsItsFolder) {
  CommandSimulator command = simulator(shell("echo diverged at {{k}} {{c}} >&2; exit 3"));
  const std::string message = message_of<NumericalError>([&] { (void)command.solve(std::vector{1.0, 0.5}); });
  EXPECT_THAT(message, HasSubstr("sh ended with status 3: diverged at 100 0.5"));
  EXPECT_THAT(message, HasSubstr("its folder is kept: " + folder_.file("work")));
  EXPECT_EQ(kept_folders(), 1u);
}

TEST_F(CommandSimulatorTest, ARunThatTakesTooLongIsEnded) {
  CommandOptions options = shell("sleep 60; echo {{k}} {{c}}");
  options.time_limit_s = 0.05;
  CommandSimulator command = simulator(options);
  EXPECT_THAT(message_of<NumericalError>([&] {
                (void)command.solve(std::vector{1.0, 0.5});
              }),
              HasSubstr("took longer than the 0.05 s of time_limit"));
}

TEST_F(CommandSimulatorTest, ARunThatLeavesNoResultOrNoNumberIsAFailure) {
  CommandSimulator nothing = simulator(shell("true {{k}} {{c}}"));
  EXPECT_THAT(message_of<DataError>([&] {
                (void)nothing.solve(std::vector{1.0, 0.5});
              }),
              HasSubstr("left no result.csv"));
  CommandSimulator no_number = simulator(shell("(echo time,u; echo 1,{{k}}{{c}}; echo 2,nan) > result.csv"));
  EXPECT_THAT(message_of<DataError>([&] {
                (void)no_number.solve(std::vector{1.0, 0.5});
              }),
              HasSubstr("result.csv:3"));
}

TEST_F(CommandSimulatorTest, AFailedRunIsTriedAgain) {
  const std::string flag = folder_.file("flag");
  CommandOptions options = shell("test -e " + flag + " || { touch " + flag + "; exit 1; }; " + csv_);
  options.retries = 1;
  EXPECT_EQ(simulator(options).solve(std::vector{1.0, 0.5}).values.size(), 4u);
}

TEST_F(CommandSimulatorTest, RunsGoOnAfterAFailureInAnyNumberOfProcesses) {
  CommandSimulator command = simulator(shell("test {{c}} != 0.5 && " + csv_));
  std::vector<model::Run> runs;
  for (const double c : {0.25, 0.5, 0.75})
    runs.push_back({{1.0, c}, command.key(std::vector{1.0, c}), folder_.file(std::to_string(c) + ".h5")});
  std::vector<std::size_t> told;
  const auto failures = command.solve_to_files(runs, 3, [&](std::size_t n) { told.push_back(n); });
  ASSERT_EQ(failures.size(), 1u);
  EXPECT_EQ(failures[0].run, 1u);
  EXPECT_EQ(told, (std::vector<std::size_t>{1, 2}));
  EXPECT_TRUE(is_there(runs[0]));
  EXPECT_FALSE(is_there(runs[1]));
  EXPECT_EQ(read_run(runs[2]).solution.values[3], 0.75);
}

TEST_F(CommandSimulatorTest, TheKeyTellsAnotherInputFromTheSame) {
  CommandOptions options = shell(csv_);
  options.templates = {write("input.txt", "one")};
  const auto key = [&] { return simulator(options).key(std::vector{1.0, 0.5}); };
  const std::string before = key();
  EXPECT_EQ(key(), before);
  options.retries = 5;
  EXPECT_EQ(key(), before);
  write("input.txt", "two");
  EXPECT_NE(key(), before);
  EXPECT_NE(simulator(options).key(std::vector{1.0, 0.75}), key());
}

/// numpy.save of these arrays (numpy 1.24), as bytes.
std::string npy(const std::string& header, const std::vector<double>& values) {
  std::string text("\x93NUMPY\x01\x00", 8);
  std::string padded = header + std::string(63 - (10 + header.size()) % 64, ' ') + "\n";
  text += static_cast<char>(padded.size());
  text += '\0';
  text += padded;
  return text + std::string(reinterpret_cast<const char*>(values.data()), 8 * values.size());
}

TEST_F(CommandSimulatorTest, ReadsArraysOfNumpyWithNamesOrPlaces) {
  CommandOptions options = shell("cp field_{{k:.0f}}.npy result.npy; echo {{c}}");
  options.files = {write("field_100.npy", npy("{'descr': '<f8', 'fortran_order': True, 'shape': (2, 3), }",
                                              {1, 4, 2, 5, 3, 6})),
                   write("points.csv", "x,y,z,component\n0,0,0,x\n1,0,0,y\n1,2,0,z\n")};
  options.result = {.field = "result.npy", .times = {0.1, 0.2}, .names = {"u", "v", "T"}, .units = {"m"}};
  const Snapshots named = simulator(options).solve(std::vector{1.0, 0.5});
  EXPECT_EQ(named.values, (std::vector<double>{1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(named.quantities[2].name, "T");
  options.result.points = folder_.file("points.csv");
  const Snapshots placed = simulator(options).solve(std::vector{1.0, 0.5});
  EXPECT_EQ(placed.dofs.components, (std::vector<std::int64_t>{0, 1, 2}));
  EXPECT_EQ(placed.dofs.points[7], 2);
  options.result.points.clear();
  options.result.names = {"u"};
  EXPECT_THAT(message_of<DataError>([&] {
                (void)simulator(options).solve(std::vector{1.0, 0.5});
              }),
              HasSubstr("3 columns, but [offline.command] names 1"));
  options.result.times = {1};
  EXPECT_THAT(message_of<DataError>([&] {
                (void)simulator(options).solve(std::vector{1.0, 0.5});
              }),
              HasSubstr("2 rows, but [offline.command] \"times\" has 1"));
}

TEST_F(CommandSimulatorTest, FurtherScalarsComeFromAFileOfTheirOwn) {
  CommandOptions options = shell(csv_ + "; (echo 'time,energy [kN]'; echo 0.5,1; echo 1,2) > more.csv");
  options.result.outputs = "more.csv";
  const Snapshots solution = simulator(options).solve(std::vector{1.0, 0.5});
  ASSERT_EQ(solution.outputs.size(), 1u);
  EXPECT_EQ(solution.outputs[0].values, (std::vector<double>{1000, 2000}));
}

}  // namespace
}  // namespace knothe::model
