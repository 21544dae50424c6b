#include "knothe/imaging/series/picture_folder.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace knothe::imaging {
namespace {

using ::testing::ElementsAre;

std::vector<std::string> names_of(const std::vector<std::string>& paths) {
  std::vector<std::string> names;
  for (const std::string& path : paths) names.push_back(std::filesystem::path(path).filename().string());
  return names;
}

PictureFolder listed(std::initializer_list<const char*> files) {
  const files::TestFolder folder;
  for (const char* name : files) std::ofstream(folder.file(name)) << "x";
  return list_pictures(std::filesystem::path(folder.file("x")).parent_path().string());
}

TEST(PictureFolder, ReferencesAreKnownByNameInWhateverCase) {
  for (const char* reference : {"reference.tif", "Reference.TIF", "REFERENCE_1.tif"}) {
    const PictureFolder found = listed({"Frame_10.tif", "Frame_2.tif", reference});
    EXPECT_THAT(names_of(found.references), ElementsAre(reference));
    EXPECT_THAT(names_of(found.pictures), ElementsAre("Frame_2.tif", "Frame_10.tif"));
  }
}

TEST(PictureFolder, JpegsCountWhereThereIsNothingElse) {
  EXPECT_THAT(names_of(listed({"a.jpg", "b.JPEG", "c.jpg"}).pictures), ElementsAre("b.JPEG", "c.jpg"));
  EXPECT_THAT(names_of(listed({"a.png", "a.jpg", "b.png", "b.jpg"}).pictures), ElementsAre("b.png"));
  EXPECT_THROW((void)listed({"a.jpg", "b.gif"}), DataError);
}

TEST(PictureFolder, APlainPictureIsNoSeries) {
  const files::TestFolder folder;
  std::ofstream(folder.file("one.png")) << "\x89PNG";
  try {
    (void)list_pictures(folder.file("one.png"));
    FAIL();
  } catch (const DataError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr(
                                  "one.png: error: one picture; a folder, or a TIFF of several pages, holds "
                                  "a reference and at least one deformed picture"));
  }
}

}  // namespace
}  // namespace knothe::imaging
