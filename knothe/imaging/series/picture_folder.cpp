#include "knothe/imaging/series/picture_folder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/files/csv.hpp"
#include "knothe/files/extension.hpp"
#include "knothe/files/picture.hpp"

namespace knothe::imaging {

namespace {

namespace fs = std::filesystem;

bool is_digit(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) != 0;
}

bool is_jpeg(const fs::path& path) {
  const std::string extension = files::extension_of(path);
  return extension == ".jpg" || extension == ".jpeg";
}

bool is_picture(const fs::path& path) {
  return std::ranges::count(files::picture_endings(), files::extension_of(path)) > 0;
}

/// The digits from `at` on, without leading zeros; `at` moves behind them.
std::string number_at(const std::string& text, std::size_t& at) {
  while (at < text.size() && text[at] == '0') ++at;
  const std::size_t begin = at;
  while (at < text.size() && is_digit(text[at])) ++at;
  return text.substr(begin, at - begin);
}

void read_table(const std::string& path, const fs::path& folder, PictureFolder& out) {
  const files::CsvTable table = files::CsvTable::read(path);
  out.times = table.numbers("time");
  for (Index i = 0; i < std::ssize(out.times); ++i) {
    if (i > 0 && !(out.times[i] > out.times[i - 1]))
      table.fail(
          i, "time",
          fmt::format("{} is not greater than {}: times must increase", out.times[i], out.times[i - 1]));
    const std::string name = table.texts("file")[i];
    if (name.empty()) table.fail(i, "file", "the name of a picture is missing");
    out.pictures.push_back((folder / name).string());
  }
}

/// The first page is the reference.
PictureFolder pages_of(const std::string& file) {
  PictureFolder result;
  result.pictures = files::pictures_in(file);
  if (result.pictures.size() < 2)
    throw DataError(
        fmt::format("{}: error: one picture; a folder, or a TIFF of several pages, holds a "
                    "reference and at least one deformed picture",
                    file));
  result.references = {result.pictures.front()};
  result.pictures.erase(result.pictures.begin());
  return result;
}

}  // namespace

bool is_picture_name(const std::string& name) {
  return is_picture(name) && !name.starts_with(".");
}

bool is_reference_name(const std::string& name) {
  static constexpr std::string_view k_word = "reference";
  return name.size() >= k_word.size() &&
         std::equal(k_word.begin(), k_word.end(), name.begin(),
                    [](char a, char b) { return a == std::tolower(static_cast<unsigned char>(b)); });
}

std::vector<std::string> list_references(const std::string& folder) {
  std::error_code failure;
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder, failure)) {
    const std::string name = entry.path().filename().string();
    if (is_picture_name(name) && is_reference_name(name)) names.push_back(entry.path().string());
  }
  std::sort(names.begin(), names.end(), natural_less);
  return names;
}

bool natural_less(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const std::string m = number_at(a, i), n = number_at(b, j);
      if (m.size() != n.size()) return m.size() < n.size();
      if (m != n) return m < n;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
    }
  }
  if (i < a.size() || j < b.size()) return j < b.size();
  return a < b;  // "img01" and "img1"
}

PictureFolder list_pictures(const std::string& folder, const std::vector<std::string>& wanted) {
  std::error_code failure;
  if (fs::is_regular_file(folder, failure)) return pages_of(folder);
  if (!fs::is_directory(folder, failure))
    throw DataError(fmt::format("{}: error: there is no such folder of pictures", folder));
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder, failure))
    if (entry.is_regular_file(failure) && is_picture(entry.path()) &&
        !entry.path().filename().string().starts_with("."))
      names.push_back(entry.path().filename().string());
  if (!std::all_of(names.begin(), names.end(), is_jpeg)) std::erase_if(names, is_jpeg);  // previews of others
  std::sort(names.begin(), names.end(), natural_less);
  PictureFolder result;
  const auto path_of = [&](const std::string& name) { return (fs::path(folder) / name).string(); };
  for (const std::string& name : wanted) result.references.push_back(path_of(name));
  if (wanted.empty())
    for (const std::string& name : names)
      if (is_reference_name(name)) result.references.push_back(path_of(name));
  const std::string table = path_of("pictures.csv");
  if (fs::exists(table, failure)) {
    read_table(table, folder, result);
  } else {
    for (const std::string& name : names)
      if (!is_reference_name(name)) result.pictures.push_back(path_of(name));
  }
  if (result.references.empty() && !result.pictures.empty()) {
    result.references.push_back(result.pictures.front());
    result.pictures.erase(result.pictures.begin());
    if (!result.times.empty()) result.times.erase(result.times.begin());
  }
  std::erase_if(result.pictures, [&](const std::string& path) {
    return result.times.empty() &&
           std::find(result.references.begin(), result.references.end(), path) != result.references.end();
  });
  if (result.pictures.empty())
    throw DataError(fmt::format(
        "{}: error: the folder holds {} pictures ({}): a reference and at least one deformed picture are "
        "needed",
        folder, names.size(), fmt::join(files::picture_endings(), ", ")));
  return result;
}

}  // namespace knothe::imaging
