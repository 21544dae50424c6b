#include "knothe/likelihood/data/measurements.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/files/hdf5.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::likelihood {
namespace {

using files::message_of;

/// Two steps of three dofs with the precision [[2 −1 0][−1 2 −1][0 −1 2]].
void write(const std::string& path, double shared_reference, const std::string& step = "",
           const std::function<void(files::Hdf5Writer&)>& more = {}) {
  files::Hdf5Writer file(path);
  const std::vector<double> values = {0, 1, 2, 3, 4, 5}, points(9, 0.0), time = {0.5, 1};
  const std::vector<std::int64_t> components = {0, 1, 2}, indices = {0, 1, 0, 1, 2, 1, 2},
                                  rows = {0, 2, 5, 7};
  const std::vector<double> data = {2, -1, -1, 2, -1, -1, 2};
  file.write("/time", time, {2}, {"1", ""});
  file.write("/values", values, {2, 3}, {"m", ""});
  file.write("/dofs/points", points, {3, 3}, {"m", ""});
  file.write_integers("/dofs/component", components, {3}, {"1", ""});
  for (const std::string& group : {std::string("/noise/precision"), "/noise/precision_steps/" + step}) {
    if (group.ends_with("/")) continue;
    std::vector<double> scaled = data;
    if (group != "/noise/precision") {
      for (double& value : scaled) value *= 3;
    }
    file.write(group + "/data", scaled, {7}, {"1/m2", ""});
    file.write_integers(group + "/indices", indices, {7}, {"1", ""});
    file.write_integers(group + "/indptr", rows, {4}, {"1", ""});
  }
  if (shared_reference != 0) file.number_attribute("/noise/precision", "shared_reference", shared_reference);
  if (more) more(file);
  file.close();
}

TEST(Measurements, PrecisionOfStepsAndSharedReferenceAreRead) {
  const files::TestFolder folder;
  const std::string path = folder.file("d.h5");
  write(path, 2, "1");
  const Measurements m = read_measurements(path);
  EXPECT_EQ(m.noise.shared_reference(), 2);
  EXPECT_FALSE(has_own_noise(m.noise, 0));
  ASSERT_TRUE(has_own_noise(m.noise, 1));
  EXPECT_EQ(m.noise.measurement().precision().coeff(1, 2), -1);
  EXPECT_EQ(m.noise.at_step(1).precision().coeff(1, 1), 6);
}

/// The same with two errors that all data share; entry k is k µm.
void write_with_shared_errors(const std::string& path, const std::vector<std::string>& names,
                              std::size_t rows = 3) {
  write(path, 2, "", [&](files::Hdf5Writer& file) {
    std::vector<double> effects(2 * rows * 2);
    for (std::size_t k = 0; k < effects.size(); ++k) effects[k] = 1e-3 * k;
    file.write("/noise/shared_errors", effects, {2, rows, 2}, {"mm", ""});
    file.texts_attribute("/noise/shared_errors", "names", names);
  });
}

TEST(Measurements, ErrorsThatAllDataShareAreRead) {
  const files::TestFolder folder;
  const std::string path = folder.file("d.h5");
  write_with_shared_errors(path, {"camera0.fx", "camera1.tz"});
  const NoiseModel noise = read_measurements(path).noise;
  EXPECT_EQ(noise.shared_reference(), 2);
  ASSERT_EQ(lasting_count(noise), 2);
  EXPECT_EQ(noise.lasting().errors[1].name, "camera1.tz");
  EXPECT_EQ(noise.lasting().errors[1].std, 1);
  // Of the second time, third dof, second error: entry 11, in m.
  EXPECT_NEAR(noise.lasting().factors[1](2, 1), 11e-6, 1e-18);
  EXPECT_NEAR(noise.lasting().factors[0](1, 0), 2e-6, 1e-18);
  // A load cell behind the dofs has no part in them.
  const NoiseModel wider = noise.with_scalars(Eigen::VectorXd::Constant(1, 2.0));
  ASSERT_EQ(wider.lasting().factors[1].rows(), 4);
  EXPECT_EQ(wider.lasting().factors[1].row(3).norm(), 0);
  EXPECT_EQ(wider.lasting().factors[1].topRows(3), noise.lasting().factors[1]);

  for (const auto& [rows, names, complaint] :
       {std::tuple(2, std::vector<std::string>{"a", "b"},
                   "noise/shared_errors must have the shape [2, 3, q]"),
        std::tuple(3, std::vector<std::string>{"a"},
                   "the attribute names of noise/shared_errors must have 2 texts")}) {
    write_with_shared_errors(path, names, rows);
    const std::string message = message_of<DataError>([&] { (void)read_measurements(path); });
    EXPECT_NE(message.find("d.h5: " + std::string(complaint)), std::string::npos) << message;
  }
}

TEST(Measurements, WhatIsWrittenIsRead) {
  const files::TestFolder folder;
  write(folder.file("d.h5"), 3);
  const Measurements m = read_measurements(folder.file("d.h5"));
  write_measurements(folder.file("e.h5"), m, "", 1);
  const Measurements again = read_measurements(folder.file("e.h5"));
  EXPECT_EQ(again.values, m.values);
  EXPECT_EQ(again.noise.shared_reference(), 3);
  EXPECT_EQ(Eigen::MatrixXd(again.noise.measurement().precision()),
            Eigen::MatrixXd(m.noise.measurement().precision()));
}

TEST(Measurements, OfQuantitiesAloneHaveNoDisplacements) {
  const files::TestFolder folder;
  Measurements m;
  m.time = {1, 2, 3};
  m.values.resize(0, 3);
  m.noise = NoiseModel::independent(Eigen::VectorXd());
  m.series["drift"] = {{0.1, 0.2, 0.3}, 0.01, {0.5, 0.0, 0.7}};
  write_measurements(folder.file("d.h5"), m, "", 1);
  const Measurements read = read_measurements(folder.file("d.h5"));
  EXPECT_EQ(read.values.rows(), 0);
  EXPECT_EQ(read.values.cols(), 3);
  EXPECT_TRUE(read.sensors.empty());
  EXPECT_EQ(read.series.at("drift").values, (std::vector<double>{0.1, 0.2, 0.3}));
  EXPECT_EQ(read.series.at("drift").std, 0.01);
  EXPECT_EQ(read.series.at("drift").shared_std, (std::vector<double>{0.5, 0.0, 0.7}));
}

TEST(Measurements, ASeriesMayHaveAnErrorThatAllTimesShare) {
  const files::TestFolder folder;
  const auto read = [&](const std::string& rows) {
    const std::string path = folder.file("d.csv");
    std::ofstream(path) << "time,sensor,x,y,z,component,value,std,shared_std\n" << rows;
    return read_measurements(path);
  };
  const auto series = read("1,cell,,,,force,5,0.1,0.4\n2,cell,,,,force,6,0.1,\n3,cell,,,,force,7,0.1,0.5\n")
                          .series.at("force");
  EXPECT_EQ(series.shared_std, (std::vector<double>{0.4, 0.0, 0.5}));
  EXPECT_NE(message_of<DataError>([&] {
              (void)read("1,cell,,,,force,5,0.1,-1\n");
            }).find("a standard deviation is not negative"),
            std::string::npos);
  EXPECT_NE(message_of<DataError>([&] {
              (void)read("1,s,0,0,0,y,5,0.1,0.4\n");
            }).find("an error that is shared is one of a series, not of displacements"),
            std::string::npos);
}

TEST(Measurements, ATableIsReadAsItWasWritten) {
  const files::TestFolder folder;
  Measurements m;
  m.time = {0.25, 1.0 / 3};
  m.values.resize(2, 2);
  m.values << 1e-4, -1.0 / 7, std::numeric_limits<double>::quiet_NaN(), 2.5e-5;
  m.sensors.add(std::array{0.1, 0.2, 0.0}, 0), m.sensors.add(std::array{0.3, 1.0 / 3, 0.0}, 1);
  m.noise = NoiseModel::independent(Eigen::Vector2d(1e-6, 3e-6));
  m.series["force"] = {{10, std::numeric_limits<double>::quiet_NaN()}, 0.5};
  m.series["gauge"] = {{1, 2}, 0.5, {0.25, 0}};
  write_measurements(folder.file("d.csv"), m, "", 1);
  const Measurements read = read_measurements(folder.file("d.csv"));
  EXPECT_EQ(read.time, m.time);
  EXPECT_EQ(read.sensors.points, m.sensors.points);
  EXPECT_EQ(read.sensors.components, m.sensors.components);
  EXPECT_EQ(read.values.row(0), m.values.row(0));
  EXPECT_TRUE(std::isnan(read.values(1, 0)));
  EXPECT_EQ(read.values(1, 1), 2.5e-5);
  EXPECT_EQ(read.noise.measurement().standard_deviations(), m.noise.measurement().standard_deviations());
  EXPECT_EQ(read.series.at("force").values[0], 10);
  EXPECT_TRUE(std::isnan(read.series.at("force").values[1]));
  EXPECT_TRUE(read.series.at("force").shared_std.empty());
  EXPECT_EQ(read.series.at("gauge").shared_std, m.series["gauge"].shared_std);
  write(folder.file("e.h5"), 0);
  EXPECT_NE(message_of<UsageError>([&] {
              write_measurements(folder.file("e.csv"), read_measurements(folder.file("e.h5")), "", 1);
            }).find("no correlated noise: write HDF5"),
            std::string::npos);
}

TEST(Measurements, TheUnitOfTheNoiseIsSaidWhereThatOfTheValuesIsNotMetres) {
  const files::TestFolder folder;
  const std::vector<double> two = {1, 2}, points(6, 0.0);
  const std::vector<std::int64_t> components = {0, 1};
  const auto read = [&](const std::string& unit_of_noise) {
    files::Hdf5Writer file(folder.file("d.h5"));
    file.write("/time", {two.data(), 1}, {1}, {"1", ""});
    file.write("/values", two, {1, 2}, {"mm", ""});
    file.write("/dofs/points", points, {2, 3}, {"m", ""});
    file.write_integers("/dofs/component", components, {2}, {"1", ""});
    file.write("/noise/std", two, {2}, {unit_of_noise, ""});
    file.close();
    return read_measurements(folder.file("d.h5"));
  };
  EXPECT_NEAR(read("um").noise.measurement().standard_deviations()[1], 2e-6, 1e-12);
  EXPECT_NE(message_of<DataError>([&] {
              (void)read("");
            }).find("d.h5: values is in mm, and noise/std has no attribute units: say which it is in"),
            std::string::npos);
}

/// A file that was put together from two copies, one of which went through another program.
TEST(Measurements, TimesThatDifferByRoundingAreRefusedAsOneDatum) {
  const files::TestFolder folder;
  for (const std::string& name : {std::string("d.h5"), std::string("d.csv")}) {
    for (const std::size_t twice : {0u, 2u, 4u}) {
      Measurements m;
      m.time = {0.1, 0.2, 0.3, 0.4, 0.5};
      m.time.insert(m.time.begin() + static_cast<std::ptrdiff_t>(twice) + 1,
                    std::nextafter(m.time[twice], 1.0));
      m.values.resize(0, 6);
      m.noise = NoiseModel::independent(Eigen::VectorXd());
      m.series["drift"] = {{0, 1, 2, 3, 4, 5}, 0.01, {}};
      if (name == "d.h5") {
        write_measurements(folder.file(name), m, "", 1);
      } else {
        std::ofstream table(folder.file(name));
        table.precision(17);
        table << "time,drift\n";
        for (const double time : m.time) table << time << ",1\n";
      }
      const std::string message = message_of<DataError>([&] { (void)read_measurements(folder.file(name)); });
      EXPECT_NE(
          message.find(fmt::format("time[{}] = {} and time[{}] = {} differ by rounding only: a datum is "
                                   "there twice",
                                   twice, m.time[twice], twice + 1, m.time[twice + 1])),
          std::string::npos)
          << message;
    }
  }
}

TEST(Measurements, BadNoiseIsNamed) {
  const files::TestFolder folder;
  const std::string path = folder.file("d.h5");
  write(path, 1.5);
  EXPECT_EQ(message_of<DataError>([&] { (void)read_measurements(path); }),
            path +
                ": the attribute shared_reference of noise/precision is 1.5: it is the number of reference "
                "pictures, 1 or more");
  const std::string other = folder.file("e.h5");
  write(other, 0, "7");
  EXPECT_EQ(message_of<DataError>([&] { (void)read_measurements(other); }),
            other + ": noise/precision_steps/7: the name is a step, 0 to 1");
}

}  // namespace
}  // namespace knothe::likelihood
