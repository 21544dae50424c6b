#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <sstream>

#include "apps/knothe/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/program.hpp"

namespace knothe::commands {
namespace {

std::string sibling_program() {
  return program_beside("knothe-offline");
}

}  // namespace

bool sibling_installed() {
  const std::string program = sibling_program();
  if (program.find('/') != std::string::npos) return true;
  const char* path = std::getenv("PATH");
  std::istringstream folders(path == nullptr ? "" : path);
  for (std::string folder; std::getline(folders, folder, ':');)
    if (access((folder + "/" + program).c_str(), X_OK) == 0) return true;
  return false;
}

int run_sibling(const std::vector<std::string>& words) {
  const std::string program = sibling_program();
  std::vector<char*> arguments = {const_cast<char*>(program.c_str())};
  for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  // The sibling takes this process's place: signals and exit statuses are then its own, with nobody in
  // between.
  std::fflush(nullptr);
  execvp(program.c_str(), arguments.data());
  if (errno != ENOENT) throw system_error("could not run", program);
  throw Error(ExitStatus::internal,
              fmt::format("`knothe {}` is done by knothe-offline, which is not installed: install the "
                          "package of that name, or build it with -DKNOTHE_OFFLINE=ON (needs libdeal.ii-dev; "
                          "`make build` does both) and put it beside knothe",
                          words.front()));
}

}  // namespace knothe::commands
