/// @file `knothe reproduce`: runs the published study, a program in Python (studies/reproduction).
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "apps/knothe-offline/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/program.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::offline_commands {
namespace {

namespace fs = std::filesystem;

/// Where this program's prefix is: the folder of bin/, share/ and, in a build tree, python/.
fs::path prefix() {
  return fs::read_symlink("/proc/self/exe").parent_path().parent_path();
}

/// A build tree has its own package for Python.
void prefer_package_of_build_tree() {
  const fs::path package = prefix() / "python";
  if (!fs::exists(package / "knothe" / "__init__.py")) return;
  const char* others = std::getenv("PYTHONPATH");
  const std::string path = others == nullptr ? package.string() : package.string() + ":" + others;
  setenv("PYTHONPATH", path.c_str(), 1);
}

bool has_modules(const std::string& python) {
  try {
    ProgramCall call;
    call.words = {python, "-c", "import numpy, h5py, knothe"};
    return run_program(call).status == 0;
  } catch (const IoError&) {
    return false;  // there is no such program
  }
}

/// $KNOTHE_PYTHON, or the first of the usual ones, if it has what the study imports.
std::string interpreter(const fs::path& study) {
  std::vector<std::string> candidates = {"python3", "/usr/bin/python3"};
  if (const char* chosen = std::getenv("KNOTHE_PYTHON")) candidates = {chosen};
  for (const std::string& python : candidates)
    if (has_modules(python)) return python;
  throw Error(ExitStatus::internal,
              fmt::format("the published study is a program in Python, and {} has not all of numpy, h5py "
                          "and the package knothe: install them (Debian: python3-knothe, "
                          "python3-h5py) and run `knothe reproduce` again, name another "
                          "interpreter by the environment variable KNOTHE_PYTHON, or run it by hand: "
                          "KNOTHE={} python3 {} --quick",
                          fmt::join(candidates, ", "), program_beside("knothe"), study.string()));
}

}  // namespace

int reproduce(const ReproduceArguments& arguments) {
  files::require_writable_folder(arguments.output);
  const fs::path study = prefix() / "share" / "knothe" / "studies" / "reproduction";
  if (!fs::exists(study / "__main__.py"))
    throw Error(ExitStatus::internal,
                fmt::format("the published study is not installed: there is no {}", study.string()));
  prefer_package_of_build_tree();
  setenv("KNOTHE", program_beside("knothe").c_str(), 1);
  std::vector<std::string> words = {interpreter(study),
                                    "-B",
                                    study.string(),
                                    "-o",
                                    arguments.output,
                                    "--seed",
                                    std::to_string(arguments.seed)};
  if (arguments.quick) words.emplace_back("--quick");
  if (arguments.json) words.emplace_back("--json");
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  // Python takes this process's place: signals and exit status are then its own.
  std::fflush(nullptr);
  execvp(pointers[0], pointers.data());
  throw system_error("could not run", words.front());
}

}  // namespace knothe::offline_commands
