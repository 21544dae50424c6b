"""The loader takes the best variant of a program's code that the machine can run (cmake/KnotheDispatch.cmake), in a program of one line."""
import os
import subprocess
import unittest

from support import REPOSITORY, Case

LOADER = "/lib64/ld-linux-x86-64.so.2"
PROJECT = f"""
cmake_minimum_required(VERSION 3.25)
project(small LANGUAGES CXX)
set(CMAKE_CXX_VISIBILITY_PRESET hidden)
set(KNOTHE_INSTALL ON)
include({REPOSITORY}/cmake/KnotheUnity.cmake)
include({REPOSITORY}/cmake/KnotheDispatch.cmake)
add_executable(small small.cpp)
target_link_libraries(small PRIVATE m)
knothe_dispatch(small main small-code)
if(KNOTHE_ARCH)
  target_compile_options(small_code PRIVATE -march=${{KNOTHE_ARCH}})
else()
  install(TARGETS small)
endif()
"""
PROGRAM = """
#include <cstdio>
[[gnu::visibility("default")]] int main() {
#if defined(__AVX512VL__)
  std::puts("x86-64-v4");
#elif defined(__AVX2__)
  std::puts("x86-64-v3");
#else
  std::puts("none");
#endif
}
int nobody_calls() { return 1; }
"""


@unittest.skipUnless(os.path.exists(LOADER), "not an x86-64 machine")
class Test(Case):
    def run_tool(self, *command):
        done = subprocess.run(list(map(str, command)), cwd=self.folder, capture_output=True, text=True, timeout=250)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def test_the_best_that_the_machine_can_run_is_taken(self):
        (self.folder / "CMakeLists.txt").write_text(PROJECT)
        (self.folder / "small.cpp").write_text(PROGRAM)
        for arch in ("", "x86-64-v3", "x86-64-v4"):
            self.run_tool("cmake", "-S", ".", "-B", f"build{arch}", f"-DKNOTHE_ARCH={arch}", "-DKNOTHE_DISPATCH=ON", "-DCMAKE_BUILD_TYPE=Release",
                          f"-DCMAKE_INSTALL_PREFIX={self.folder}/installed")
            self.run_tool("cmake", "--build", f"build{arch}")
            self.run_tool("cmake", "--install", f"build{arch}")
        program = self.folder / "installed/bin/small"
        supported = [arch for arch in ("x86-64-v4", "x86-64-v3") if f"{arch} (supported" in self.run_tool(LOADER, "--help")]
        for arch in [*supported, "none"]:
            self.assertEqual(self.run_tool(LOADER, "--glibc-hwcaps-mask", arch, program).strip(), arch)
        self.assertEqual(self.run_tool(program).strip(), [*supported, "none"][0])
        (code,) = (self.folder / "installed").glob("lib*/**/knothe/libsmall-code.so")
        shown = [line.split()[-1] for line in self.run_tool("nm", "-D", "--defined-only", code).splitlines()]
        self.assertEqual(shown, ["main"])


if __name__ == "__main__":
    unittest.main()
