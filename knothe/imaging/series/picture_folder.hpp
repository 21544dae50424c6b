#pragma once
/// @file The pictures of a test as they lie in a folder.
#include <string>
#include <vector>

namespace knothe::imaging {

struct PictureFolder {
  std::vector<std::string> references;  ///< paths
  std::vector<std::string> pictures;    ///< paths, in the order of time
  std::vector<double> times;            ///< one per picture, or empty
};

/// What is in a folder, or the pages of a TIFF, the first of which is the reference. Pictures (.tif, .tiff,
/// .png, .bmp, .pgm; .jpg and .jpeg where there are no others) are taken in the order of their names, numbers
/// in them by value ("img2" before "img10"); names that begin with "reference", in whatever case, are the
/// references, otherwise the first picture is. Where the folder has a table `pictures.csv` with the columns
/// `time,file`, it gives the pictures and their times (a file it names that is not there is a missing
/// picture). `wanted` (may be empty): names of references to use instead, relative to the folder. Errors:
/// DataError for a folder that is not there or holds too few pictures, and for the table.
[[nodiscard]] PictureFolder list_pictures(const std::string& folder,
                                          const std::vector<std::string>& wanted = {});

/// Pictures in a folder whose names begin with "reference": paths. Empty also where there is no such folder.
[[nodiscard]] std::vector<std::string> list_references(const std::string& folder);

/// Whether a name ends like a picture's.
[[nodiscard]] bool is_picture_name(const std::string& name);

/// Whether a name begins with "reference", in whatever case.
[[nodiscard]] bool is_reference_name(const std::string& name);

/// "img2" < "img10".
[[nodiscard]] bool natural_less(const std::string& a, const std::string& b);

}  // namespace knothe::imaging
