"""The examples of the package's docstrings and docs/how-to/python.md run; figures, stubs, and the package as it is installed."""
import ast
import doctest
import importlib.util
import inspect
import os
import pathlib
import re
import subprocess
import sys
import unittest

try:
    import h5netcdf  # noqa: F401, xarray reads results by it
    import matplotlib.pyplot as pyplot
    import numpy as np
    import xarray  # noqa: F401
except ImportError as missing:
    print(f"skipped: {sys.executable} has no {missing.name} (Debian: python3-{missing.name})")
    sys.exit(77)

from support import REPOSITORY, CaseInItsFolder

sys.path.insert(0, str(REPOSITORY / "bench"))
import drawn_rigs
import knothe
import knothe.calibration
import knothe.modes
import knothe.plot
import knothe.states
from knothe import _knothe

PROJECT = """model = "model.h5"
data = "data.csv"
results = "results"
[parameters]
E = { prior = "normal", mean = 1.0, std = 0.3 }
F = { prior = "normal", mean = 1.0, std = 0.3 }
"""


def bar(e, f, x, t):
    return 1e-3 * np.outer(t, x * (2 - x)) / e + 1e-3 * f * np.outer(t ** 2, x)


class FieldOn(knothe.Model):
    """A model of which only the mesh is asked."""

    def __init__(self, nodes, cells):
        self.mesh = nodes, cells, "HEXAHEDRON"

    def _mesh(self):
        return self.mesh


class Test(CaseInItsFolder):
    def setUp(self):
        super().setUp()
        self.addCleanup(pyplot.close, "all")

    def make_project(self):
        """model.h5, project.toml, data.csv and results/ of the bar that all examples share."""
        x = t = np.linspace(0.2, 1.0, 5)
        nodes = np.linspace(0.5, 1.5, 9)
        knothe.offline(lambda e, f: bar(e, f, x, t), {"E": nodes, "F": nodes}, t, "model.h5", points=np.c_[x, 0 * x, 0 * x])
        values = bar(0.9, 1.1, x, t) + 1e-5 * np.random.default_rng(1).standard_normal((5, 5))
        rows = [f"{t[i]},s{k},{x[k]},0,0,y,{values[i, k]},1e-5" for i in range(5) for k in range(5)]
        (self.folder / "data.csv").write_text("time,sensor,x,y,z,component,value,std\n" + "\n".join(rows) + "\n")
        (self.folder / "project.toml").write_text(PROJECT)
        self.expect(0, "assimilate", "project.toml", "-o", "results")

    def examples(self):
        """What has a docstring and is public: classes with their methods, functions, figures."""
        objects = [(name, getattr(knothe, name)) for name in knothe.__all__ if callable(getattr(knothe, name))]
        for module in (knothe.plot, knothe.states, knothe.modes, knothe.calibration):
            objects += [(f"{module.__name__.split('.')[1]}.{name}", f) for name, f in vars(module).items()
                        if not name.startswith("_") and (name in module.__all__ if hasattr(module, "__all__") else
                                                         inspect.isfunction(f) and f.__module__ == module.__name__)]
        for name, each in objects:
            yield name, each
            if isinstance(each, type):
                members = ((k, getattr(each, k)) for k in vars(each) if not k.startswith("_") or k == "__call__")
                yield from ((f"{name}.{k}", member) for k, member in members if callable(member) or isinstance(member, property))

    def test_every_example_of_the_docstrings_runs(self):
        self.make_project()
        model = knothe.Model.load("model.h5")
        twin = knothe.Twin(model=model, sensors=knothe.Sensors(model.points, "y"), std=1e-5,
                           parameters={"E": knothe.Normal(1, 0.3), "F": knothe.Normal(1, 0.3)},
                           forecasts={"tip": {"quantity": "displacement", "point": [1.0, 0, 0], "component": "y",
                                              "horizon": 1.0, "threshold": 2.2e-3}})
        for datum in knothe.Twin("project.toml").data:
            result = twin.assimilate(knothe.Datum(datum.step, datum.values))
        given = {"knothe": knothe, "np": np, "twin": twin, "result": result}
        observed, target, sizes, _ = drawn_rigs.rig(1)
        of_a_rig = {"observed": observed, "target": target, "rig": knothe.calibration.calibrate(observed, target, sizes)}
        faults, count = [], 0
        for name, each in self.examples():
            shared = dict(given)
            if name.startswith(("Displacements", "Correlation.", "plot.field")):
                shared["picture"] = self.speckle
                shared["correlation"] = knothe.Correlation(self.speckle(0), element_size=24)
                shared["moved"] = shared["correlation"].correlate(self.speckle(0.3))
            if name.startswith(("calibration.", "plot.calibration")):
                shared.update(of_a_rig)
            for test in doctest.DocTestFinder(recurse=False).find(each, name, globs=shared):
                said = []
                doctest.DocTestRunner(verbose=False).run(test, out=said.append)
                faults += ["".join(said)] if said else []
                count += len(test.examples)
        self.assertFalse(faults, "\n".join(faults))
        self.assertGreater(count, 150)

    @staticmethod
    def speckle(shift):
        spots = np.random.default_rng(1).uniform(0, 96, (2, 400))
        y, x = np.mgrid[:96, :96]
        near = (x - spots[0, :, None, None] - shift) ** 2 + (y - spots[1, :, None, None]) ** 2
        return 20 + 25 * np.exp(-near / 8).sum(0)

    def test_what_is_public_is_documented_with_an_example(self):
        for name, each in self.examples():
            if isinstance(each, type) and issubclass(each, BaseException):
                continue
            with self.subTest(name):
                self.assertIn(">>> ", inspect.getdoc(each) or "")

    @staticmethod
    def section(text, title):
        """The lines below a title of numpydoc, those of the same indentation: names or types."""
        found = re.search(rf"^{title}\n-+\n(.*?)(?=^\S[^\n]*\n--+$|\Z)", text, re.M | re.S)
        return [line for line in found[1].splitlines() if line and not line.startswith(" ")] if found else []

    def test_every_parameter_and_what_is_returned_is_documented(self):
        """Of functions and methods; a class that is made by its user lists the parameters of its constructor."""
        library_makes = {"Fit", "InferenceResult", "Model", "ObservedModel", "Posterior", "Results", "StepResult", "TransportMap",
                         "calibration.Calibration", "modes.Baseline", "modes.Health", "states.StateEstimate", "states.StateForecast"}
        count = 0
        for name, each in self.examples():
            is_class = isinstance(each, type)
            if isinstance(each, property) or is_class and (issubclass(each, BaseException) or name in library_makes):
                continue
            text = inspect.getdoc(each) or ""
            if is_class and re.search(r"^Attributes\n-+$", text, re.M) and not self.section(text, "Parameters"):
                continue  # a record
            signature = inspect.signature(each)
            with self.subTest(name):
                documented = [word.strip() for line in self.section(text, "Parameters") for word in line.split(" : ")[0].split(",")]
                self.assertEqual(documented, [parameter for parameter in signature.parameters if parameter != "self"])
                count += 1
                if not is_class and signature.return_annotation not in (None, "None"):
                    self.assertTrue(self.section(text, "Returns"), "no section Returns")
        self.assertGreater(count, 45)

    def test_the_page_runs_from_top_to_bottom(self):
        self.make_project()
        page = (REPOSITORY / "docs/how-to/python.md").read_text()
        blocks = re.findall(r"^```py\n(.*?)^```", page, re.M | re.S)
        (self.folder / "density.c").write_text(re.search(r"^```c\n(.*?)^```", page, re.M | re.S)[1])
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "density.c", "-o", "density.so"], cwd=self.folder, check=True)
        self.assertGreater(len(blocks), 8)
        done = subprocess.run([sys.executable, "-c", "\n".join(blocks)], capture_output=True, text=True, timeout=250)
        self.assertEqual(done.returncode, 0, done.stderr[-3000:])
        for figure in ("pair", "marginals", "fan", "verdict", "residuals", "field"):
            content = (self.folder / f"{figure}.png").read_bytes()
            self.assertTrue(content.startswith(b"\x89PNG") and len(content) > 5000, figure)
        kept = os.environ.get("KNOTHE_KEEP_FIGURES")
        for figure in self.folder.glob("*.png") if kept else ():
            (pathlib.Path(kept) / figure.name).write_bytes(figure.read_bytes())

    def test_a_field_is_drawn_on_the_mesh(self):
        """Two hexahedra: the outer face has two quadrilaterals, coloured between their six nodes."""
        nodes = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1, 2)], dtype=float)
        at = lambda x, y, z: x + 3 * y + 6 * z
        cells = np.array([[at(x + dx, dy, dz) for dz in (0, 1) for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1))] for x in (0, 1)])
        seen, faces, of_dof = knothe.plot._seen_cells(FieldOn(nodes, cells), nodes, 2)
        self.assertEqual({tuple(point) for point in seen}, {(x, y, 1.0) for x in (0, 1, 2) for y in (0, 1)})
        self.assertEqual({frozenset(map(tuple, seen[face])) for face in faces},
                         {frozenset((x + dx, dy, 1.0) for dx in (0, 1) for dy in (0, 1)) for x in (0, 1)})
        np.testing.assert_array_equal(nodes[of_dof], seen)
        axes = pyplot.figure().gca()
        knothe.plot._draw_cells(axes, seen[:, :2], faces, np.arange(6.0), "u")
        self.assertEqual(len(axes.collections[-1].get_paths()), 2)

    def test_a_load_curve_has_measured_band_and_forecast(self):
        t = np.linspace(0.25, 1, 4)
        spring = knothe.offline(lambda k: (np.outer(t, [1.0]) / k, {"force": 100 * t * k, "stroke": 1e-3 * t}), {"k": np.linspace(0.5, 1.5, 9)}, t,
                                "spring.h5", points=[[0, 0, 0]], outputs={"force": "N", "stroke": "m"})
        twin = knothe.Twin(model=spring, sensors=knothe.Sensors([[0, 0, 0]], "y"), std=0.01, parameters={"k": knothe.Normal(1, 0.2)})
        for step in (0, 1):
            result = twin.assimilate(knothe.Datum(step, [t[step] / 1.1]))
        axes = knothe.plot.load_displacement(result, spring, output="force", over="stroke")
        self.assertEqual((axes.get_xlabel(), axes.get_ylabel()), ("stroke [mm]", "force [N]"))
        lines = {line.get_label(): line.get_xydata() for line in axes.lines}
        np.testing.assert_allclose(lines["median"][:, 0], [0.25, 0.5])
        np.testing.assert_allclose(lines["forecast"][:, 0], [0.5, 0.75, 1.0])
        np.testing.assert_allclose(lines["forecast"][:, 1], 110 * t[1:], rtol=3 * float(result.std[0]))
        with self.assertRaises(knothe.UsageError) as caught:
            knothe.plot.load_displacement(result, spring)
        self.assertIn('no output "reaction_force"; there are', str(caught.exception))

    def test_a_pair_has_the_regions_that_hold_half_and_most_of_the_draws(self):
        draws = np.random.default_rng(1).multivariate_normal([0, 0], [[1, 0.8], [0.8, 1]], 700).T
        axes = pyplot.figure().gca()
        knothe.plot._draw_regions(axes, *draws)
        outer = axes.collections[0].get_paths()[0]
        inside = outer.contains_points(draws.T).mean()
        self.assertLess(abs(inside - 0.95), 0.02)
        self.assertEqual([line.get_label() for line in axes.lines], ["50 %", "95 %"])

    def test_figures_refuse_what_is_not_there(self):
        self.make_project()
        twin = knothe.Twin("project.toml")
        result = twin.assimilate(next(twin.data))
        for call, text in ((lambda: knothe.plot.fan([result], "G"), "there are E, F"),
                           (lambda: knothe.plot.marginals(result, truth={"G": 1.0}), "there are E, F"),
                           (lambda: knothe.plot.fan([], "E"), "no steps")):
            with self.assertRaises(knothe.UsageError) as caught:
                call()
            self.assertIn(text, str(caught.exception))

    def test_the_stubs_name_what_the_module_has(self):
        tree = ast.parse((REPOSITORY / "python/knothe/_knothe.pyi").read_text())

        def names(body):
            found = {}
            for node in body:
                if isinstance(node, ast.FunctionDef):
                    found[node.name] = [a.arg for a in node.args.args if a.arg != "self"]
                elif isinstance(node, ast.ClassDef):
                    found[node.name] = names(node.body)
                elif isinstance(node, ast.AnnAssign):
                    found[node.target.id] = None
            return {name: entry for name, entry in found.items() if name == "__init__" or not name.startswith("_")}

        stubs = names(tree.body)
        self.assertEqual(set(stubs), {name for name in dir(_knothe) if not name.startswith("_")})
        for name, entry in stubs.items():
            for member, arguments in entry.items() if isinstance(entry, dict) else [(None, entry)]:
                native = getattr(_knothe, name) if member is None else getattr(getattr(_knothe, name), member)
                signature = re.match(r"\w+\((.*?)\) ->", native.__doc__ or "", re.S)
                if arguments and signature:
                    for argument in arguments:
                        self.assertRegex(signature[1], rf"\b{argument}: ", f"{name}.{member}")
            if isinstance(entry, dict):
                public = {m for m in vars(getattr(_knothe, name)) if not m.startswith("_")}
                self.assertEqual(public, set(entry) - {"__init__"}, name)

    def test_stubtest_finds_nothing(self):
        """What is left out: metaclasses of pybind11 and of TypedDict, a type that only checkers import, and names of Python's own library."""
        if importlib.util.find_spec("mypy") is None:
            self.skipTest(f"{sys.executable} has no mypy (Debian: python3-mypy)")
        (self.folder / "mypy.ini").write_text("[mypy]\nignore_missing_imports = True\n")
        classes = "|".join(name for name, each in vars(_knothe).items() if isinstance(each, type))
        (self.folder / "allowed.txt").write_text(f"knothe\\._knothe\\.({classes})\nknothe\\.plot\\.Axes\n"
                                                 "knothe\\..*\\.(Callable|Iterable|Mapping|Protocol|Sequence)(\\..*)?\n"
                                                 "knothe\\..*\\.(Inference|Step)Record\n")
        done = subprocess.run([sys.executable, "-m", "mypy.stubtest", "knothe", "--concise", "--mypy-config-file", "mypy.ini", "--allowlist",
                               "allowed.txt"], capture_output=True, text=True, timeout=280,
                              env={**os.environ, "MYPYPATH": os.environ.get("PYTHONPATH", "").split(os.pathsep)[0]})
        self.assertEqual((done.returncode, done.stdout), (0, ""), done.stderr)

    def test_priors_of_several_kinds_have_a_type_in_common(self):
        if importlib.util.find_spec("mypy") is None:
            self.skipTest(f"{sys.executable} has no mypy (Debian: python3-mypy)")
        (self.folder / "user.py").write_text(
            'import knothe\n\npriors = {"a": knothe.Normal(0, 1), "b": knothe.Uniform(0, 2), "c": knothe.Lognormal(0, 0.2)}\n'
            'found = knothe.infer(lambda p: p, priors, observed=[1.0, 1.0, 1.0], std=0.1)\nreveal_type(priors)\n'
            'twin: knothe.Twin = knothe.Twin("project.toml")\n')
        done = subprocess.run([sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports", "--follow-imports=silent", "user.py"],
                              capture_output=True, text=True, timeout=280,
                              env={**os.environ, "MYPYPATH": os.environ.get("PYTHONPATH", "").split(os.pathsep)[0]})
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertRegex(done.stdout, r"dict\[.*str, knothe\._values\.Prior\]")

    def test_the_installed_package_is_whole(self):
        subprocess.run(["cmake", "--install", os.environ["KNOTHE_BUILD"], "--component", "python", "--prefix", self.folder / "usr"],
                       check=True, capture_output=True)
        (package,) = self.folder.glob("usr/lib/python3/dist-packages/knothe")
        self.assertTrue((package / "py.typed").exists() and (package / "_knothe.pyi").exists())
        done = subprocess.run([sys.executable, "-c", "import knothe; print(knothe.__file__, knothe.__version__)"],
                              env={**os.environ, "PYTHONPATH": str(package.parent)}, capture_output=True, text=True)
        self.assertEqual(done.stdout.split(), [str(package / "__init__.py"), knothe.__version__], done.stderr)


if __name__ == "__main__":
    unittest.main()
