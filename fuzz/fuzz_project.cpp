/// @file Project files.
#include "fuzz/support.hpp"
#include "knothe/project/project_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  knothe::fuzz::refuse_or_accept(
      [&] { (void)knothe::project::parse_project(knothe::fuzz::text_of(data, size), "fuzz.toml"); });
  return 0;
}
