#include "knothe/service/site/served_site.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <future>
#include <thread>

#include "knothe/files/testing/test_folder.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/service/camera/camera_watch.hpp"

namespace knothe::service {
namespace {

namespace fs = std::filesystem;

/// A small beam: the project that tests/cases keeps for files of old versions.
class ServedSiteTest : public ::testing::Test {
 protected:
  ServedSiteTest() {
    for (const char* name : {"project.toml", "model.h5", "data.h5"})
      fs::copy(fs::path(KNOTHE_SOURCE_FOLDER) / "tests/cases/made_by_0.1.0" / name, folder_.file(name));
    project_ = project::read_project(folder_.file("project.toml"));
  }
  void SetUp() override { served_ = start(); }

  std::unique_ptr<ServedSite> start(ServedSite::Settings settings = {}) {
    auto served = std::make_unique<ServedSite>(project_, std::move(settings), metrics_);
    served->start();
    while (!served->current()->journal().ready()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return served;
  }

  static EntryRequest asked(const std::string& test) {
    EntryRequest request;
    request.author = "Ada";
    request.test = test;
    return request;
  }

  /// A datum of `step`, stored and assimilated: `of` tells specimens apart.
  void send(std::size_t step, double of) {
    const auto site = served_->current();
    Measurement datum;
    datum.key = {"camera", "s", static_cast<std::int64_t>(step)};
    datum.time = site->setup().problem.model->time[step];
    const Eigen::Vector2d parameters(of, 1.0);
    const Eigen::VectorXd values = site->setup().problem.model->predict(parameters, step);
    datum.values.assign(values.begin(), values.end());
    datum.status.assign(datum.values.size(), 0);
    std::promise<bool> stored;
    site->journal().ingest(datum, [&](const JournalWriter::Answer& answer) {
      stored.set_value(std::holds_alternative<Appended>(answer));
    });
    ASSERT_TRUE(stored.get_future().get());
    while (!site->settled()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

  [[nodiscard]] std::vector<double> mean() const {
    const auto line = served_->current()->lines().latest();
    return line ? std::vector<double>(line->mean.begin(), line->mean.end()) : std::vector<double>();
  }

  static std::string refusal(const std::function<void()>& action) {
    try {
      action();
    } catch (const RequestError& error) {
      return error.type();
    }
    return "";
  }

  files::TestFolder folder_;
  project::Project project_;
  Metrics metrics_;
  std::unique_ptr<ServedSite> served_;
};

TEST_F(ServedSiteTest, ASecondTestKnowsNothingOfTheFirst) {
  for (const std::size_t step : {0U, 1U, 2U, 3U}) send(step, 0.8);
  const auto first = mean();
  const std::int64_t last_event = served_->current()->lines().last_event();
  EXPECT_NE(metrics_.value("knothe_log_evidence", site_labels(served_->name())), 0);
  const LogbookEntry entry = served_->begin_test(asked("second"));
  EXPECT_EQ(entry.kind, EntryKind::test_begun);
  EXPECT_EQ(served_->current()->test(), "second");
  EXPECT_EQ(metrics_.value("knothe_log_evidence", site_labels(served_->name())), 0);
  EXPECT_TRUE(mean().empty());
  for (const std::size_t step : {0U, 1U, 2U, 3U}) send(step, 1.2);
  const auto second = mean();
  EXPECT_NE(second, first);
  EXPECT_GT(served_->current()->lines().line_from(0)->event, last_event);
  // A program of its own says the same, to the bit.
  served_.reset();
  fs::remove(folder_.file("project.second.journal"));
  fs::remove(folder_.file("project.second.journal-mark"));
  fs::remove(folder_.file("project.journal"));
  fs::remove(folder_.file("project.journal-mark"));
  ServedSite::Settings settings;
  settings.test = "second";
  served_ = start(settings);
  for (const std::size_t step : {0U, 1U, 2U, 3U}) send(step, 1.2);
  EXPECT_EQ(mean(), second);
}

TEST_F(ServedSiteTest, TheTestThatFollowedIsServedAfterARestart) {
  send(0, 0.8);
  served_->begin_test(asked("second"));
  send(1, 0.8);
  served_->begin_test(asked("third"));
  served_.reset();
  served_ = start();
  EXPECT_EQ(served_->current()->test(), "third");
  EXPECT_EQ(served_->resume_test(asked("second")).kind, EntryKind::test_resumed);
  EXPECT_EQ(served_->current()->lines().latest()->step, 1U);
  served_.reset();
  ServedSite::Settings settings;
  settings.test = "third";
  served_ = start(settings);
  EXPECT_EQ(served_->current()->test(), "second");
}

TEST_F(ServedSiteTest, WhatBringsDataEndsBeforeItsTestAndBeginsWithTheNext) {
  std::vector<std::string> happened;
  struct Watch {
    std::vector<std::string>& happened;
    std::string test;
    Watch(std::vector<std::string>& h, std::string t) : happened(h), test(std::move(t)) {}
    ~Watch() { happened.push_back(fmt::format("end of {}", test)); }
  };
  served_.reset();
  ServedSite::Settings settings;
  settings.watch = [&](const std::shared_ptr<Site>& site) {
    happened.push_back(fmt::format("begin of {}", site->test()));
    return ServedSite::Watches{std::make_shared<Watch>(happened, site->test())};
  };
  served_ = start(settings);
  served_->begin_test(asked("second"));
  served_->stop();
  EXPECT_EQ(happened, (std::vector<std::string>{"begin of ", "end of ", "begin of second", "end of second"}));
  EXPECT_EQ(refusal([&] { served_->begin_test(asked("third")); }), "NotReady");
}

TEST_F(ServedSiteTest, AJournalThatCannotBeWrittenLeavesEverythingAsItWas) {
  send(0, 0.8);
  const auto before = served_->current();
  fs::rename(folder_.file("project.journal"), folder_.file("away"));
  EXPECT_EQ(refusal([&] { served_->begin_test(asked("second")); }), "DiskFull");
  EXPECT_EQ(served_->current(), before);
  fs::rename(folder_.file("away"), folder_.file("project.journal"));
  // The journal that was made for nothing is used.
  served_->begin_test(asked("second"));
  EXPECT_EQ(served_->current()->test(), "second");
}

TEST_F(ServedSiteTest, TheTestBeforeIsThereForThoseWhoStillReadIt) {
  send(0, 0.8);
  auto before = served_->current();
  served_->begin_test(asked("second"));
  EXPECT_EQ(before->lines().latest()->step, 0U);
  // Its journal has one writer: this reader must go first.
  EXPECT_EQ(refusal([&] { served_->resume_test(asked("")); }), "NotReady");
  EXPECT_EQ(served_->current()->test(), "second");
  served_->begin_test(asked("third"));  // it holds up no other
  EXPECT_EQ(refusal([&] { served_->resume_test(asked("")); }), "NotReady");
  before.reset();
  served_->resume_test(asked(""));
  EXPECT_EQ(served_->current()->lines().latest()->step, 0U);
}

/// Says that it was asked for a frame, and does not answer before it is let go.
class HangingCamera final : public FrameSource {
 public:
  HangingCamera(std::promise<void>& asked, std::shared_future<void> let_go)
      : asked_(asked), let_go_(std::move(let_go)) {}
  std::optional<Frame> next(double) override {
    if (!std::exchange(was_asked_, true)) asked_.set_value();
    let_go_.wait();
    return std::nullopt;
  }
  Incomplete incomplete() override { return {}; }
  [[nodiscard]] std::string serial() const override { return "1"; }
  [[nodiscard]] std::string description() const override { return "hangs"; }
  [[nodiscard]] std::optional<double> period_s() const override { return std::nullopt; }

 private:
  std::promise<void>& asked_;
  std::shared_future<void> let_go_;
  bool was_asked_ = false;
};

TEST_F(ServedSiteTest, ACameraThatHangsIsASiteThatIsNotAlive) {
  const auto site = served_->current();
  std::promise<void> asked, let_go;
  const std::shared_future<void> gone = let_go.get_future().share();
  const auto hangs = [&] {
    const auto later = monotonic_now() + std::chrono::seconds(61);
    return site->health().pulses().complaint(later).find("the watch of the camera has not moved on for ") !=
           std::string::npos;
  };
  {
    const CameraWatch watch(site, metrics_, [&](const project::CameraOptions&) {
      return std::make_unique<HangingCamera>(asked, gone);
    });
    asked.get_future().wait();
    EXPECT_TRUE(hangs());
    let_go.set_value();
  }
  EXPECT_FALSE(hangs()) << "it has ended in order";
}

}  // namespace
}  // namespace knothe::service
