"""docs/how-to/extend.md: each of its diffs applies to the sources and changes at most three files; built together, what they add works,
judged by formula and quadrature."""
import json
import math
import os
import pathlib
import random
import re
import shutil
import struct
import subprocess
import unittest

import analytic_model
from dic_pictures import Speckle, write_pgm
from support import FIXTURES, REPOSITORY, SOURCE, Case, python_with, read_csv, without_times, write_csv

PAGE = REPOSITORY / "docs/how-to/extend.md"
BUILD = pathlib.Path(os.environ["KNOTHE_BUILD"])
COPY = BUILD / "extensions"  # kept: a second run compiles what has changed
KINDS = ["damage law", "error that all data share", "kind of sensor", "quantity to forecast", "format of pictures", "format of exported fields"]
PRIORS = [(0.9, 0.4472135954999579), (1.1, 0.4472135954999579)]
TRUTH = (1.05, 0.9)
MIDDLE_FORCES = "import h5py, json; print(json.dumps(h5py.File('model.h5')['outputs/reaction_force'][1, 1].tolist()))"
STD = 3e-6  # m, of a displacement
TIMES = [analytic_model.time(step) for step in (2, 5, 8, 11)]


def extensions():
    """Kind → diff."""
    included = re.findall(r"^## An? ([^\n]*)\n.*?^```\{literalinclude\} (\S+)\n", PAGE.read_text(), re.M | re.S)
    return {kind: (PAGE.parent / name).read_text() for kind, name in included}


def files_of(diff):
    return sorted(set(re.findall(r"^(?:---|\+\+\+) [ab]/(.*)$", diff, re.M)))


def apply(diff, folder):
    """None, or what git says against it. Without a repository around, for paths are of the folder."""
    done = subprocess.run(["git", "apply", "-"], input=diff, cwd=folder, text=True, capture_output=True,
                          env={**os.environ, "GIT_CEILING_DIRECTORIES": str(pathlib.Path(folder).resolve().parent)})
    return done.stderr if done.returncode else None


def source_files():
    """What is built, but for generated pages: everything that is no test."""
    for top in ("apps", "cmake", "knothe", "deploy", "scripts"):
        yield from (path for path in (REPOSITORY / top).rglob("*") if path.is_file() and not path.name.endswith((".pyc", "_test.cpp")))
    yield REPOSITORY / "CMakeLists.txt"


class Test(Case):
    def test_each_diff_applies_and_changes_at_most_three_files(self):
        self.assertEqual(list(extensions()), KINDS)
        for kind, diff in extensions().items():
            with self.subTest(kind):
                files = files_of(diff)
                self.assertLessEqual(len(files), 3, files)
                for name in files:  # one after the other, as a reader who takes all of them
                    if (REPOSITORY / name).exists() and not (self.folder / name).exists():
                        (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
                        shutil.copy(REPOSITORY / name, self.folder / name)
                self.assertIsNone(apply(diff, self.folder))

    def test_what_they_add_works(self):
        self.build()
        for kind in KINDS:
            with self.subTest(kind):
                for file in [*self.folder.iterdir()]:
                    (shutil.rmtree if file.is_dir() else os.unlink)(file)
                self.random = random.Random(5)
                getattr(self, "check_" + kind.replace(" ", "_"))()

    def build(self):
        """The programs of a copy of the sources with all the diffs, in a folder of their own."""
        staged = self.folder / "staged"
        for path in source_files():
            (staged / path.relative_to(REPOSITORY)).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, staged / path.relative_to(REPOSITORY))
        for diff in extensions().values():
            self.assertIsNone(apply(diff, staged))
        wanted = {path.relative_to(staged) for path in staged.rglob("*") if path.is_file()}
        for path in [path for path in COPY.rglob("*") if path.is_file() and path.relative_to(COPY).parts[0] != "build"]:
            if path.relative_to(COPY) not in wanted:
                path.unlink()
        for name in wanted:  # what is the same keeps its time
            (COPY / name).parent.mkdir(parents=True, exist_ok=True)
            if not (COPY / name).exists() or (COPY / name).read_bytes() != (staged / name).read_bytes():
                shutil.copy(staged / name, COPY / name)
        shutil.rmtree(staged)
        folder = COPY / "build" / BUILD.name
        grouped = re.search(r"^KNOTHE_UNITY:STRING=(.*)$", (BUILD / "CMakeCache.txt").read_text(), re.M)[1]
        options = ["-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG", "-DBUILD_TESTING=OFF", "-DKNOTHE_PYTHON=OFF"]
        for command in (["cmake", "-G", "Ninja", "-S", COPY, "-B", folder, *options, f"-DKNOTHE_UNITY={grouped}"],
                        ["cmake", "--build", folder, "--target", "programs"]):
            done = subprocess.run(command, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stdout[-6000:] + done.stderr[-2000:])
        self.program = folder / "bin/knothe"
        printed = self.expect(0, "check", "--options").out
        for word in ("linear", "data.expansion_std", "transducer", "opening"):
            self.assertIn(word, printed)

    def run_knothe(self, *arguments, **options):
        return super().run_knothe(*arguments, program=self.program, **options)

    # The formula's model, measured at nodes by displacements of STD.

    def begin(self, extra="", forecasts=False):
        self.project_name = "assimilation.toml"
        text = (SOURCE / self.project_name).read_text().replace('data = "data.h5"\n', "")
        if not forecasts:
            text = text[:text.index("[forecast.force]")]
        self.project.write_text(text.replace("[parameters]", f'[data]\nfile = "data.csv"\n{extra}[parameters]'))
        for name in ("model.h5", "data.csv"):
            (self.folder / name).symlink_to(FIXTURES / "analytic" / name)
        self.sensors = read_csv(self.folder / "data.csv")[:24]

    def measure(self, error=lambda c, point: 0.0, rows_beside=lambda t: []):
        """Writes data.csv; returns for each time [(component, point, value, std)]."""
        rows, data = [], []
        for t in TIMES:
            data.append([])
            for sensor in self.sensors:
                c, point = "xyz".index(sensor["component"]), tuple(float(sensor[k]) for k in "xyz")
                value = analytic_model.displacement(c, point, t, *TRUTH) + error(c, point) + self.random.gauss(0, STD)
                data[-1].append((c, point, value, STD))
                rows.append({**sensor, "time": repr(t), "value": repr(value), "std": STD})
            rows += [{"time": repr(t), "sensor": name, "component": name, "value": repr(value), "std": std} for name, value, std in rows_beside(t)]
        write_csv(self.folder / "data.csv", rows)
        return data

    def check_damage_law(self):
        """By one line the beam bears more than by two that begin steeper and end later; before damage both are the elastic beam."""
        self.project_name = "offline.toml"
        text = (SOURCE / self.project_name).read_text()
        law = re.sub(r"(?s)\[offline\.parameters\.Ad\]\nreference = 2.25e-3", "[offline.parameters.Gf]\nreference = 100.0", text)
        law = law.replace("Ad = 1.2", "Gf = 1.2")
        law = law.replace("crack_lengths = 0\n", 'crack_lengths = 0\ndamage = { law = "LAW", regularisation = "crack-band" }\n')
        forces = {}
        for name in ("bilinear", "linear"):
            self.project.write_text(law.replace("LAW", name))
            self.assertTrue(self.expect(0, "offline", self.project_name, "-o", "model.h5", "--json").lines()[-1]["done"])
            printed = subprocess.run([python_with("h5py"), "-c", MIDDLE_FORCES], cwd=self.folder, capture_output=True, text=True, check=True)
            forces[name] = json.loads(printed.stdout)
        self.assertEqual(len(forces["linear"]), 20)
        self.assertAlmostEqual(forces["linear"][0] / forces["bilinear"][0], 1, delta=1e-4)
        self.assertGreater(max(forces["linear"]), 1.05 * max(forces["bilinear"]))
        self.assertLess(forces["linear"][-1], forces["bilinear"][-1])

    def check_error_that_all_data_share(self):
        """Integrated out by the formula: the likelihood is a normal one in the expansion, at each point of the parameters."""
        std, expansion = 3e-5, 4e-5
        self.begin(f"expansion_std = {std}\n")
        data = self.measure(lambda c, point: expansion * point[c])
        judge, exact = analytic_model.Posterior(PRIORS, 64), []
        square, of_lift, of_shapes = 0.0, 0.0, []  # Σ b²/σ², Σ b (y - lift)/σ², [(factors of t, Σ b s/σ²)]
        for i, (t, observations) in enumerate(zip(TIMES, data)):
            judge.add(t, observations)
            sums = [0.0] * 3
            for c, point, value, sigma in observations:
                elastic, s = analytic_model.shapes(c, point)
                b = std * point[c]
                square += (b / sigma) ** 2
                of_lift += b * (value - 4e-4 * t * elastic) / sigma ** 2
                sums = [total + b * one / sigma ** 2 for total, one in zip(sums, s)]
            of_shapes.append((t, sums))
            plain = judge.log_weights
            judge.log_weights = []
            for weight, (y0, ad) in zip(plain, judge.points):
                along = of_lift - sum(f * s for t, sums in of_shapes for f, s in zip(analytic_model.factors(t, y0, ad), sums))
                judge.log_weights.append(weight + 0.5 * along ** 2 / (1 + square) - 0.5 * math.log(1 + square))
            exact.append(judge.summary(i))
            judge.log_weights = plain
        self.expect_agreement(self.assimilate(), exact)
        self.edit(f"expansion_std = {std}\n", "")  # without it the expansion is taken for a parameter
        last = self.assimilate()[-1]
        self.assertGreater(abs(last["mean"][1] - TRUTH[1]) / last["covariance"][1][1] ** 0.5, 3)

    def check_kind_of_sensor(self):
        start, end, std = (-0.05, 0.0, 0.0), (0.03, 0.05, 0.0), 2e-6
        self.begin(f'[data.sensors.gauge]\nkind = "transducer"\nfrom = {list(start)}\nto = {list(end)}\n')
        length = math.dist(start, end)

        def reading(t, y0, ad):
            return sum((b - a) / length * analytic_model.displacement(c, end, t, y0, ad) for c, (a, b) in enumerate(zip(start, end)))

        values = [reading(t, *TRUTH) + self.random.gauss(0, std) for t in TIMES]
        data = self.measure(rows_beside=lambda t: [("gauge", values[TIMES.index(t)], std)])
        judge, exact = analytic_model.Posterior(PRIORS, 64), []
        for i, (t, observations) in enumerate(zip(TIMES, data)):
            judge.add(t, observations)
            judge.add_number(values[i], std, lambda y0, ad, t=t: reading(t, y0, ad))
            exact.append(judge.summary(i))
        self.expect_agreement(self.assimilate(), exact)
        self.edit(f"to = {list(end)}", f"to = {list(start)}")
        self.expect(3, "check", self.project_name, stderr="[data.sensors.gauge]: its stand is where it measures")

    def check_quantity_to_forecast(self):
        point = (0.06, 0.0, 0.0)
        self.begin(forecasts=True)
        self.project.write_text(self.project.read_text() + f'\n[forecast.mouth]\nquantity = "opening"\npoint = {list(point)}\nhorizon = 1.0\n')
        judge = analytic_model.Posterior(PRIORS, 64)
        for t, observations in zip(TIMES, self.measure()):
            judge.add(t, observations)
        mean, std = judge.moments_of(lambda y0, ad: sum(s * analytic_model.displacement(0, (s * point[0], *point[1:]), 1.0, y0, ad) for s in (1, -1)))
        found = self.assimilate("-o", "results")[-1]["forecast"]["mouth"]
        self.assertLess(abs(found["mean"] - mean), 0.02 * std)
        self.assertAlmostEqual(found["std"] / std, 1, delta=0.02)
        summary = (self.folder / "results/summary.json").read_text()
        self.assertIn('"quantity":"opening"', summary)
        self.edit(f"point = {list(point)}\n", "")
        self.expect(3, "check", self.project_name, stderr='[forecast.mouth] needs "point" = [x, y, z]')

    def check_format_of_pictures(self):
        """The same pictures as PGM and as PFM give the same lines."""
        for name, displacement in (("reference", None), ("moved", lambda x, y: (0.4 + 0.004 * (x - 80), -0.3))):
            rows = Speckle().picture(displacement)
            write_pgm(self.folder / f"{name}.pgm", rows)
            levels = b"".join(struct.pack(f"<{len(row)}f", *row) for row in reversed(rows))
            (self.folder / f"{name}.pfm").write_bytes(b"Pf\n%d %d\n-1.0\n" % (len(rows[0]), len(rows)) + levels)
        lines = {}
        for ending in ("pgm", "pfm"):
            found = self.expect(0, "dic", f"reference.{ending}", f"moved.{ending}", "--element-size", 15, "--roi", "12,12,147,107", "--json").lines()
            lines[ending] = [{key: value for key, value in without_times(line).items() if key != "picture"} for line in found]
        self.assertTrue(lines["pgm"][0]["converged"])
        self.assertEqual(lines["pfm"], lines["pgm"])
        (self.folder / "cut.pfm").write_bytes((self.folder / "moved.pfm").read_bytes()[:5000])
        self.assertIn("cut.pfm: error: pixels are missing", self.run_knothe("dic", "reference.pfm", "cut.pfm").err)

    def check_format_of_exported_fields(self):
        """Found by its columns: the same lines as where the columns are declared, and a lost point is left out."""
        self.begin()
        (self.folder / "dic").mkdir()
        points = [(-0.12 + 0.03 * i, 0.05 * j) for j in range(3) for i in range(9)]
        for step, t in enumerate(TIMES):
            lines = ["px,py,du,dv,quality"]
            for k, (x, y) in enumerate(points):
                u, v = (analytic_model.displacement(c, (x, y, 0.05), t, *TRUTH) + self.random.gauss(0, STD) for c in (0, 1))
                lines.append(f"{1000 + x / 1e-4!r},{1000 - y / 1e-4!r},{u / 1e-4!r},{-v / 1e-4!r},{0.1 if k == step else 0.9}")
            (self.folder / f"dic/{step}.csv").write_text("\n".join(lines) + "\n")
        fields = f'[data.fields]\nfiles = "dic/*.csv"\nscale = 1e-4\norigin = [1000, 1000]\nstd = {STD}\ntimes = {TIMES}\n'
        self.edit('[data]\nfile = "data.csv"\n', fields)
        self.assertIn("0.csv: lab-dic, 27 points, 1 lost (quality < 0.5), px", self.expect(0, "check", self.project_name).out)
        found = self.assimilate()
        declared = ('format = "table"\nunits = "px"\npositions = "reference"\ny = "down"\nlost = ["quality < 0.5"]\n'
                    'columns = { x = "px", y = "py", u = "du", v = "dv" }\n')
        self.edit(fields, fields + declared)
        self.assertEqual(without_times(found), without_times(self.assimilate()))


if __name__ == "__main__":
    unittest.main()
