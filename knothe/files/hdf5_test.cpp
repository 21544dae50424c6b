#include "knothe/files/hdf5.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <hdf5.h>
#include <sys/resource.h>

#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <limits>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/testing/test_folder.hpp"

/// Read by the leak sanitizer: the library loses a kilobyte when a file cannot be made or closed (1.10.8).
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libhdf5";
}

namespace knothe::files {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

void write_example(const std::string& path) {
  Hdf5Writer file(path);
  const std::vector<double> values{1.0, 2.0, 3.0, -4.0, 0.1, 1e-300};
  const std::vector<std::int64_t> integers{7, -9000000000};
  const std::vector<std::string> names{"Y0", "Ā_d"};
  file.write("/modes/space", values, {2, 3}, {"m", "space modes"});
  file.write_integers("/dofs/component", integers, {2}, {"1", "component"});
  file.texts_attribute("/", "parameters", names);
  file.text_attribute("/", "form", "tree");
  file.text_attribute("/", "project", std::string(100000, 'p'));
  file.text_attribute("/", "empty", "");
  file.number_attribute("/modes", "error", 1.25e-3);
  file.close();
}

TEST(Hdf5, RoundTrip) {
  const TestFolder folder;
  write_example(folder.file("a.h5"));
  const Hdf5Reader file(folder.file("a.h5"));
  EXPECT_EQ(file.shape("/modes/space"), (Shape{2, 3}));
  EXPECT_THAT(file.read("/modes/space", {2, 3}), ElementsAre(1.0, 2.0, 3.0, -4.0, 0.1, 1e-300));
  EXPECT_THAT(file.read_slab("/modes/space", {1, 1}, {1, 2}), ElementsAre(0.1, 1e-300));
  EXPECT_THAT(file.read_integers("/dofs/component"), ElementsAre(7, -9000000000));
  EXPECT_THAT(file.texts_attribute("/", "parameters"), ElementsAre("Y0", "Ā_d"));
  EXPECT_EQ(file.text_attribute("/", "form"), "tree");
  EXPECT_EQ(file.text_attribute("/", "project"), std::string(100000, 'p'));
  EXPECT_EQ(file.text_attribute("/", "empty"), "");
  EXPECT_EQ(file.number_attribute("/modes", "error"), 1.25e-3);
  EXPECT_EQ(file.labels("/modes/space").units, "m");
  EXPECT_EQ(file.labels("/modes/space").long_name, "space modes");
  EXPECT_TRUE(file.has("/modes"));
  EXPECT_FALSE(file.has("/other/deep"));
  EXPECT_TRUE(file.has_attribute("/", "form"));
  EXPECT_FALSE(file.has_attribute("/modes/space", "form"));
  EXPECT_THAT(file.members("/"), ElementsAre("dofs", "modes"));
}

TEST(Hdf5, SameContentSameBytes) {
  const TestFolder folder;
  write_example(folder.file("a.h5"));
  write_example(folder.file("b.h5"));
  EXPECT_EQ(read_text(folder.file("a.h5")), read_text(folder.file("b.h5")));
}

TEST(Hdf5, SinglePrecisionKeepsSevenDigits) {
  const TestFolder folder;
  const std::vector<double> values{0.1, -3.0e5};
  Hdf5Writer file(folder.file("a.h5"));
  file.write_single_precision("/v", values, {2}, {});
  file.close();
  EXPECT_THAT(Hdf5Reader(folder.file("a.h5")).read("/v"),
              ElementsAre(static_cast<double>(0.1F), static_cast<double>(-3.0e5F)));
}

TEST(Hdf5, FilesThatAreNoneAreNamed) {
  const TestFolder folder;
  const auto open = [&](const std::string& name) {
    return message_of<DataError>([&] { const Hdf5Reader file(folder.file(name)); });
  };
  EXPECT_THAT(open("none.h5"), HasSubstr(folder.file("none.h5") + ": No such file"));
  std::ofstream(folder.file("text.h5")) << "time,value\n";
  EXPECT_THAT(open("text.h5"), HasSubstr("text.h5: not an HDF5 file"));
  std::ofstream(folder.file("empty.h5")).close();
  EXPECT_THAT(open("empty.h5"), HasSubstr("not an HDF5 file (it is empty)"));
  EXPECT_THAT(open("."), HasSubstr("is a folder"));
  write_example(folder.file("a.h5"));
  std::filesystem::resize_file(folder.file("a.h5"), 3000);
  EXPECT_THAT(open("a.h5"), HasSubstr("a.h5: the file is truncated"));
}

TEST(Hdf5, WrongContentsAreNamed) {
  const TestFolder folder;
  write_example(folder.file("a.h5"));
  const Hdf5Reader file(folder.file("a.h5"));
  EXPECT_THAT(message_of<DataError>([&] { (void)file.read("/modes/time"); }),
              HasSubstr("a.h5: data set /modes/time is missing"));
  EXPECT_THAT(message_of<DataError>([&] { (void)file.read("/modes"); }),
              HasSubstr("/modes is not a data set"));
  EXPECT_THAT(message_of<DataError>([&] { (void)file.read("/modes/space", Shape{6}); }),
              HasSubstr("data set /modes/space has shape (2, 3), expected (6)"));
  EXPECT_THAT(message_of<DataError>([&] {
                (void)file.read_slab("/modes/space", {1, 2}, {1, 2});
              }),
              HasSubstr("has no slab of (1, 2) entries from (1, 2)"));
  EXPECT_THAT(message_of<DataError>([&] { (void)file.read_integers("/modes/space"); }),
              HasSubstr("does not hold integers"));
  EXPECT_THAT(message_of<DataError>([&] { (void)file.text_attribute("/", "basis"); }),
              HasSubstr("attribute basis of / is missing"));
  EXPECT_THAT(message_of<DataError>([&] { (void)file.number_attribute("/", "form"); }),
              HasSubstr("attribute form of / must be one number"));
  EXPECT_THAT(message_of<DataError>([&] { (void)file.text_attribute("/modes", "error"); }),
              HasSubstr("attribute error of /modes must be text"));
}

/// Each way in which HDF5 can have its values in another file.
TEST(Hdf5, WhatIsInAnotherFileIsRefused) {
  const TestFolder folder;
  const std::string path = folder.file("model.h5"), other = folder.file("other.h5");
  write_example(other);
  std::ofstream(folder.file("raw")) << std::string(48, 'x');
  write_example(path);
  {
    const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    H5Lcreate_external(other.c_str(), "/modes/space", file, "/linked", H5P_DEFAULT, H5P_DEFAULT);
    H5Lcreate_external(other.c_str(), "/modes", file, "/group", H5P_DEFAULT, H5P_DEFAULT);
    H5Lcreate_soft("/group/space", file, "/soft", H5P_DEFAULT, H5P_DEFAULT);
    H5Lcreate_soft("/modes/space", file, "/inside", H5P_DEFAULT, H5P_DEFAULT);
    const hsize_t shape[2] = {2, 3};
    const hid_t space = H5Screate_simple(2, shape, nullptr);
    const hid_t outside = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_external(outside, folder.file("raw").c_str(), 0, 48);
    H5Dclose(H5Dcreate2(file, "/raw", H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, outside, H5P_DEFAULT));
    const hid_t virtually = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_virtual(virtually, space, other.c_str(), "/modes/space", space);
    H5Dclose(H5Dcreate2(file, "/virtual", H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, virtually, H5P_DEFAULT));
    H5Fclose(file);
  }
  const Hdf5Reader file(path);
  EXPECT_EQ(file.read("/inside"), file.read("/modes/space"));
  for (const char* name : {"/linked", "/group/space", "/soft", "/raw", "/virtual"}) {
    try {
      (void)file.read(name);
      ADD_FAILURE() << name;
    } catch (const DataError& error) {
      EXPECT_THAT(error.what(), HasSubstr("model.h5: ")) << name;
      EXPECT_THAT(error.what(), HasSubstr("is in another file")) << name;
    }
  }
  EXPECT_THROW((void)file.has("/linked"), DataError);
  EXPECT_THROW((void)file.members("/group"), DataError);
}

TEST(Hdf5, NanIsRefusedByFullIndex) {
  const TestFolder folder;
  std::vector<double> values(2 * 3 * 4 * 5 * 6, 1.0);
  values[((((1 * 3 + 2) * 4 + 3) * 5) + 4) * 6 + 5] = std::numeric_limits<double>::quiet_NaN();
  values[0] = 2.0;
  Hdf5Writer writer(folder.file("a.h5"));
  writer.write("/snapshots", values, {2, 3, 4, 5, 6}, {"m", "u"});
  writer.close();
  const Hdf5Reader file(folder.file("a.h5"));
  EXPECT_THAT(message_of<DataError>([&] { (void)file.read("/snapshots"); }),
              HasSubstr("snapshots[1,2,3,4,5] is NaN"));
  EXPECT_THAT(message_of<DataError>([&] {
                (void)file.read_slab("/snapshots", {1, 2, 0, 0, 0}, {1, 1, 4, 5, 6});
              }),
              HasSubstr("snapshots[1,2,3,4,5] is NaN"));
  EXPECT_TRUE(std::isnan(file.read("/snapshots", true).back()));
}

TEST(Hdf5, ScalesReadBackAttached) {
  const TestFolder folder;
  const std::vector<double> values(6, 1.0);
  Hdf5Writer file(folder.file("a.h5"));
  file.write("/v", values, {2, 3}, {});
  file.write("/x", std::vector<double>{0.0, 1.0, 2.0}, {3}, {});
  file.attach_scale("/v", 1, "/x");
  EXPECT_THAT(message_of<IoError>([&] { file.attach_scale("/v", 0, "/none"); }),
              HasSubstr("dimension scale /none"));
  file.close();
  EXPECT_EQ(Hdf5Reader(folder.file("a.h5")).text_attribute("/x", "CLASS"), "DIMENSION_SCALE");
}

/// A disk that is full after `bytes`; undone at the end of the scope.
class SmallDisk {
 public:
  explicit SmallDisk(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit small{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &small);
  }
  ~SmallDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit before_{};
  void (*handler_)(int);
};

TEST(Hdf5, FullDiskIsAnErrorAndLeavesNoFile) {
  const TestFolder folder;
  const std::vector<double> large(100000, 1.0);
  for (const rlim_t room : {rlim_t{0}, rlim_t{2048}, rlim_t{50000}, rlim_t{800100}}) {
    const SmallDisk disk(room);
    const std::string message = message_of<IoError>([&] {
      write_atomically(folder.file("a.h5"), [&](const std::string& temporary) {
        Hdf5Writer file(temporary);
        file.write("/v", large, {large.size()}, {"m", "v"});
        file.write("/w", std::span(large).first(10), {10}, {"m", "w"});
        file.close();
      });
    });
    EXPECT_THAT(message, HasSubstr("File too large")) << room;
    EXPECT_EQ(folder.number_of_files(), 0U) << room;
  }
}

/// A whole process: what a program does after a full disk, up to its exit status.
[[noreturn]] void fill_the_disk_and_exit() {
  const TestFolder folder;
  const std::vector<double> large(100000, 1.0);
  int status = 0;
  {
    const SmallDisk disk(50000);
    try {
      write_atomically(folder.file("a.h5"), [&](const std::string& temporary) {
        Hdf5Writer file(temporary);
        file.write("/v", large, {large.size()}, {"m", "v"});
        file.close();
      });
    } catch (const IoError& error) {
      status = static_cast<int>(error.status());
    }
  }
  write_example(folder.file("b.h5"));  // and the next file, once there is room, is fine
  if (Hdf5Reader(folder.file("b.h5")).read("/modes/space").size() != 6) status = 99;
  std::filesystem::remove_all(folder.file(""));
  std::exit(status);
}

TEST(Hdf5, AFullDiskEndsTheProgramWithItsExitStatusAndNoCrash) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(fill_the_disk_and_exit(), ::testing::ExitedWithCode(5), "");
}

TEST(Hdf5, DiskFullNamesTheRemedy) {
  const std::vector<double> large(100000, 1.0);
  const std::string message = message_of<IoError>([&] {
    Hdf5Writer file("/dev/full");
    file.write("/v", large, {large.size()}, {"m", "v"});
    file.close();
  });
  EXPECT_THAT(message, HasSubstr("/dev/full: could not write"));
  EXPECT_THAT(message, HasSubstr("No space left on device (disk full"));
}

}  // namespace
}  // namespace knothe::files
