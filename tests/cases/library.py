"""The library as others link it: installed outside the tree, by CMake and by pkg-config, with both compilers; inside another project."""
import math
import os
import pathlib
import re
import subprocess
import unittest

import analytic_model
from dic_pictures import Speckle, write_pgm
from support import Case, REPOSITORY

BUILD = pathlib.Path(os.environ["KNOTHE_BUILD"])
EXAMPLES = REPOSITORY / "examples/library"
NAMES = sorted(source.stem for source in EXAMPLES.glob("*.cpp"))
SHIFT = (1.3, -0.6)


def run(*command, **options):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=250, **options)
    if done.returncode != 0:
        raise AssertionError(f"{command} ended with {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}")
    return done.stdout


class Test(Case):
    fixture = "analytic"

    def install(self):
        prefix = self.folder / "prefix"
        run("cmake", "--install", BUILD, "--component", "library", "--prefix", prefix)
        (self.library,) = prefix.rglob("libknothe.so")
        return prefix

    def built_by_cmake(self, compiler):
        prefix = self.install()
        run("cmake", "-S", EXAMPLES, "-B", self.folder / "build", "-DCMAKE_BUILD_TYPE=Debug",
            f"-DCMAKE_CXX_COMPILER={compiler}", f"-DCMAKE_PREFIX_PATH={prefix}")
        run("cmake", "--build", self.folder / "build")
        return lambda name: [self.folder / "build" / name]

    def built_by_pkg_config(self, compiler):
        prefix = self.install()
        environment = dict(os.environ, PKG_CONFIG_PATH=str(self.library.parent / "pkgconfig"))
        self.assertEqual(run("pkg-config", "--modversion", "knothe", env=environment).strip(), self.version())
        flags = run("pkg-config", "--cflags", "--libs", "knothe", env=environment).split()
        for name in NAMES:
            run(compiler, "-std=c++20", "-Wall", "-Wextra", "-Wpedantic", "-Werror", EXAMPLES / f"{name}.cpp", "-o", prefix / name, *flags)
        return lambda name: ["env", f"LD_LIBRARY_PATH={self.library.parent}", prefix / name]

    @staticmethod
    def version():
        return re.search(r"project\(knothe VERSION ([0-9.]+)", (REPOSITORY / "CMakeLists.txt").read_text())[1]

    def check_all(self, program):
        self.check_map(run(*program("map_of_a_density")))
        self.check_assimilation(run(*program("assimilate_one_by_one"), self.folder / "model.h5"))
        self.check_correlation(program("correlate_two_pictures"))
        self.check_samples(run(*program("posterior_without_likelihood")))

    def check_map(self, printed):
        lines = printed.splitlines()
        self.assertRegex(lines[0], r"^order \d+, trusted$")
        moments = [tuple(map(float, line.split(" +- "))) for line in lines[1:3]]
        exact = [(0, 1), (0.5, math.sqrt(0.25 + 0.5))]  # y = x²/2 + e/2: mean 1/2, variance 1/2 + 1/4
        for (mean, std), (exact_mean, exact_std) in zip(moments, exact):
            self.assertAlmostEqual(mean, exact_mean, delta=0.01)
            self.assertAlmostEqual(std, exact_std, delta=0.01)
        evidence = re.match(r"log evidence (\S+), exactly (\S+)$", lines[3])
        self.assertAlmostEqual(float(evidence[1]), math.log(math.pi), delta=2e-3)

    def check_assimilation(self, printed):
        """Against quadrature of the same posterior, which shares nothing with knothe."""
        posterior = analytic_model.Posterior([(0.9, 0.45), (1.1, 0.45)], n=64)
        lines = printed.splitlines()
        self.assertEqual(len(lines), analytic_model.STEPS)
        for step, line in enumerate(lines):
            t, observations = analytic_model.time(step), []
            for i in range(9):
                point = (0.03 * i - 0.12, 0.05, 0.05)
                value = analytic_model.displacement(1, point, t, 1.05, 0.9) + 2e-6 * math.sin(7 * i + 3 * step)
                observations.append((1, point, value, 2e-6))
            posterior.add(t, observations)
            exact = posterior.summary(step)
            words = line.split()
            self.assertEqual(words[5:], ["trusted"], line)
            for k in (0, 1):
                std = math.sqrt(exact["covariance"][k][k])
                self.assertAlmostEqual(float(words[1 + 2 * k]), exact["mean"][k], delta=0.05 * std, msg=line)
                self.assertAlmostEqual(float(words[2 + 2 * k]) / std, 1, delta=0.05, msg=line)

    def check_correlation(self, program):
        speckle = Speckle()
        for name, displacement in (("reference", None), ("deformed", lambda x, y: SHIFT)):
            write_pgm(self.folder / f"{name}.pgm", speckle.picture(displacement, noise=1.0, seed=len(name)))
        lines = run(*program, self.folder / "reference.pgm", self.folder / "deformed.pgm").splitlines()
        self.assertGreater(len(lines), 20)
        misses = []
        for line in lines:
            _, _, u, _, std_u, v, _, std_v = line.split()
            misses += [(float(u) - SHIFT[0]) / float(std_u), (float(v) - SHIFT[1]) / float(std_v)]
            self.assertLess(float(std_u), 0.1)
        self.assertLess(math.sqrt(sum(m * m for m in misses) / len(misses)), 1.5)

    def check_samples(self, printed):
        for line in printed.splitlines():
            measured, mean = map(float, re.match(r"y = (\S+): p = (\S+)$", line).groups())
            grid = [i / 500 for i in range(-3000, 3001)]
            weights = [math.exp(-0.5 * (p * p + ((measured - p - 0.2 * p ** 3) / 0.4) ** 2)) for p in grid]
            exact = sum(w * p for w, p in zip(weights, grid)) / sum(weights)
            std = math.sqrt(sum(w * (p - exact) ** 2 for w, p in zip(weights, grid)) / sum(weights))
            self.assertAlmostEqual(mean, exact, delta=0.2 * std)

    def test_cmake_with_gcc(self):
        self.check_all(self.built_by_cmake("g++"))

    def test_cmake_with_clang(self):
        self.check_all(self.built_by_cmake("clang++"))

    def test_pkg_config_with_gcc(self):
        self.check_all(self.built_by_pkg_config("g++"))

    def test_pkg_config_with_clang(self):
        self.check_all(self.built_by_pkg_config("clang++"))

    def test_nothing_of_ours_leaks(self):
        prefix = self.install()
        major, minor, _ = self.version().split(".")
        self.assertIn(f"[libknothe.so.{major}.{minor}]", run("readelf", "-d", self.library))
        shown = [line.split(" ", 2)[2] for line in run("nm", "-D", "-C", "--defined-only", self.library).splitlines()]
        self.assertGreater(len(shown), 10)
        for name in shown:
            self.assertRegex(name.removeprefix("typeinfo for ").removeprefix("typeinfo name for ").removeprefix("vtable for "), r"^knothe::")
        for header in (prefix / "include").rglob("*.hpp"):
            for included in re.findall(r"#include *[<\"](.*)[>\"]", header.read_text()):
                self.assertTrue(included.startswith("knothe/") or "/" not in included and "." not in included, f"{header}: {included}")
                if included.startswith("knothe/"):
                    self.assertTrue((prefix / "include" / included).exists(), f"{header} includes {included}, which is not installed")
        for file in [*prefix.rglob("*.cmake"), *prefix.rglob("*.pc")]:
            text = file.read_text()
            for word in ("march", "EIGEN", "Eigen", "fmt", str(REPOSITORY), str(BUILD)):
                self.assertNotIn(word, text, file)

    def test_errors_are_caught_by_their_class(self):
        self.install()
        source = self.folder / "errors.cpp"
        source.write_text("""#include <iostream>
#include <knothe/knothe.hpp>
int main() {
  try { (void)knothe::solve_map({}); } catch (const knothe::UsageError& error) { std::cout << error.what() << '\\n'; }
  try { knothe::Assimilation("absent.h5", {{0, 0, 0}, {0}}, {{1e-6}}, {knothe::Prior::normal("a", 0, 1)}); }
  catch (const knothe::DataError& error) { std::cout << error.what() << '\\n'; }
  try { knothe::Correlation({8, 8, {}, 255}); } catch (const knothe::Error& error) { std::cout << error.what() << '\\n'; }
}
""")
        for compiler in ("g++", "clang++"):
            run(compiler, "-std=c++20", source, "-o", self.folder / "errors", f"-I{self.folder}/prefix/include", self.library)
            printed = run(self.folder / "errors", env=dict(os.environ, LD_LIBRARY_PATH=str(self.library.parent)), cwd=self.folder).splitlines()
            self.assertEqual(len(printed), 3, printed)
            self.assertIn("needs a dimension of at least 1", printed[0])
            self.assertIn("absent.h5", printed[1])
            self.assertIn("8 x 8 pixels with 0 grey levels", printed[2])

    def test_another_version_is_refused(self):
        prefix = self.install()
        (self.folder / "CMakeLists.txt").write_text("cmake_minimum_required(VERSION 3.25)\nproject(x LANGUAGES CXX)\nfind_package(knothe 0.3 CONFIG REQUIRED)\n")
        done = subprocess.run(["cmake", "-S", self.folder, "-B", self.folder / "b", f"-DCMAKE_PREFIX_PATH={prefix}"], capture_output=True, text=True)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn(f"version: {self.version()}", done.stderr)

    def configure_embedded(self, fetched):
        run("cmake", "-G", "Ninja", "-S", REPOSITORY / "tests/cases/embedded", "-B", self.folder / "build", f"-DKNOTHE_SOURCE={REPOSITORY}",
            f"-DKNOTHE_FETCH={fetched}")

    def test_part_of_another_project(self):
        self.configure_embedded("ON")
        run("cmake", "--build", self.folder / "build", "--target", "knothe_base")

    def test_part_of_another_project_runs(self):
        self.configure_embedded("OFF")
        subprocess.run(["cmake", "--build", str(self.folder / "build")], check=True, capture_output=True, timeout=7000)
        self.check_map(run(self.folder / "build/map_of_a_density"))

    def test_the_page_shows_the_tested_programs(self):
        page = (REPOSITORY / "docs/how-to/library.md").read_text()
        for name in NAMES:
            self.assertIn(f"{{literalinclude}} ../../examples/library/{name}.cpp\n", page, f"docs/how-to/library.md does not show {name}.cpp")


if __name__ == "__main__":
    unittest.main()
