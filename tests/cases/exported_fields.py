"""Displacement fields that other programs exported, from the file to the posterior; judged by quadrature of the model's formula."""
import math
import random
import re
import shutil
import unittest

import analytic_model
from support import DATA, REPOSITORY, Case

PRIORS = [(0.9, 0.4472135954999579), (1.1, 0.4472135954999579)]
TRUTH = (1.05, 0.9)
STD = 3e-6
FACE = 0.05  # z, m
POINTS = [(-0.12 + 0.03 * i, 0.05 * j) for j in range(3) for i in range(9)]  # nodes of the model: the formula is exact there
STEPS = (2, 5, 8, 11)
SAMPLES = DATA.parent / "cases" / "exports"


class Judge(analytic_model.Posterior):
    """With errors of each step besides: `columns` of F, of independent standard normal numbers that are integrated out."""

    def add_with(self, t, observations, columns):
        w = 1 / observations[0][3] ** 2
        rows = [shapes_and_residual(t, o) for o in observations]
        vectors = [[s[i] for s, _ in rows] for i in range(3)] + [[r for _, r in rows]]

        def dot(a, b):
            return w * sum(x * y for x, y in zip(a, b))

        inner, determinant = [[dot(a, b) for b in vectors] for a in vectors], 1.0
        for k, column in enumerate(columns):  # one after the other: Sherman and Morrison
            projections = [dot(column, v) for v in vectors]
            scale = 1 + dot(column, column)
            determinant *= scale
            inner = [[inner[a][b] - projections[a] * projections[b] / scale for b in range(4)] for a in range(4)]
            # What follows sees the precision that is left: columns are orthogonal here.
            for other in columns[k + 1:]:
                assert abs(dot(column, other)) < 1e-6 * scale
        constant = -0.5 * inner[3][3] - 0.5 * math.log(determinant) - len(rows) * math.log(observations[0][3] * math.sqrt(2 * math.pi))
        for index, (y0, ad) in enumerate(self.points):
            f = analytic_model.factors(t, y0, ad)
            quadratic = sum(f[i] * f[j] * inner[i][j] for i in range(3) for j in range(3))
            self.log_weights[index] += constant + sum(f[i] * inner[i][3] for i in range(3)) - 0.5 * quadratic


def shapes_and_residual(t, observation):
    c, point, value, _ = observation
    elastic, s = analytic_model.shapes(c, point)
    return s, value - 4e-4 * t * elastic


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def setUp(self):
        super().setUp()
        self.random = random.Random(11)
        self.edit('data = "data.h5"\n', "")
        (self.folder / "dic").mkdir()
        self.edit("[parameters]", "[data.fields]\n[parameters]")
        self.declared = ""

    def declare(self, text):
        """The table [data.fields]."""
        self.edit(f"[data.fields]\n{self.declared}[parameters]", f"[data.fields]\n{text}[parameters]")
        self.declared = text

    def measure(self, motion=lambda: (0, 0, 0), lost=lambda k, step: False):
        """What is measured, in metres in the model: at each step observations (component, point, value, std), two a point."""
        self.steps = []
        for step in STEPS:
            t, rows = analytic_model.time(step), []
            shift_x, shift_y, turn = motion()
            for k, (x, y) in enumerate(POINTS):
                point = (x, y, FACE)
                u = analytic_model.displacement(0, point, t, *TRUTH) + shift_x - turn * (y - 0.05) + self.random.gauss(0, STD)
                v = analytic_model.displacement(1, point, t, *TRUTH) + shift_y + turn * x + self.random.gauss(0, STD)
                rows.append((x, y, u, v, lost(k, step)))
            self.steps.append((step, t, rows))

    @staticmethod
    def observations(rows):
        return [(c, (x, y, FACE), (u, v)[c], STD) for x, y, u, v, is_lost in rows if not is_lost for c in (0, 1)]

    def write_vic(self, unit=1e3):
        """VIC-3D's table: mm, origin of the field at (-120, -50) mm of the model, lost points with sigma -1 and zeros."""
        for step, _, rows in self.steps:
            lines = [' "X",  "Y",  "Z",  "U",  "V",  "W",  "sigma",  "x",  "y"']
            for k, (x, y, u, v, is_lost) in enumerate(rows):
                numbers = (0,) * 6 + (-1,) if is_lost else (unit * (x + 0.12), unit * (y + 0.05), 0, unit * u, unit * v, 0, 0.012)
                lines.append(",".join(repr(number) for number in (*numbers, 100 + 20 * (k % 9), 350 - 20 * (k // 9))))
            (self.folder / f"dic/plate-{step:04}_0.csv").write_text("\n".join(lines) + "\n\n")
        table = ["File;TimeStamp;Force [kN]"] + [f"C:\\grab\\plate-{s:04}_0.tif;{100 + t!r};{analytic_model.reaction_force(t, *TRUTH) / 1e3!r}"
                                                 for s, t, _ in self.steps]
        (self.folder / "steps.csv").write_text("\n".join(table) + "\n")

    def judged(self, columns=(), numbers=()):
        judge, lines = Judge(PRIORS), []
        for i, (_, t, rows) in enumerate(self.steps):
            judge.add_with(t, self.observations(rows), columns)
            for number in numbers:
                judge.add_number(number(t), 40.0, lambda y0, ad, t=t: analytic_model.reaction_force(t, y0, ad))
            lines.append(judge.summary(i))
        return lines

    VIC = 'files = "dic"\nunits = "mm"\norigin = [120, 50]\nstd = 3e-6\nsteps = "steps.csv"\ntime_zero = 100\n'

    def test_fields_with_lost_points_and_a_force_give_the_posterior_of_quadrature(self):
        self.measure(lost=lambda k, step: k == 7 or (k + step) % 9 == 0)
        self.write_vic()
        self.declare(self.VIC + '[data.fields.series]\nreaction_force = "Force"\n[data.std]\nreaction_force = 40.0\n')
        out = self.expect(0, "check", self.project_name).out
        for step, t, rows in self.steps:
            lost = sum(row[4] for row in rows)
            self.assertIn(f"plate-{step:04}_0.csv: vic-3d, 27 points, {lost} lost (sigma < 0), mm, positions of the reference, y up, time", out)
        self.assertIn("data: 53 sensors at 4 times, inside the model", out)  # one point is lost in all
        self.expect_agreement(self.assimilate(), self.judged(numbers=[lambda t: analytic_model.reaction_force(t, *TRUTH)]))

    def test_a_force_recorded_beside_the_fields_at_its_own_rate(self):
        self.measure()
        self.write_vic()
        rows = [(t / 48, analytic_model.reaction_force(t / 48, *TRUTH)) for t in range(1, 49)]
        (self.folder / "dic/machine.csv").write_text("time,reaction_force [kN]\n" + "".join(f"{t!r},{f / 1e3!r}\n" for t, f in rows))
        self.declare(self.VIC)
        self.edit("[data.fields]", '[data]\nfile = "dic/machine.csv"\n[data.std]\nreaction_force = 0.04\n[data.fields]')
        self.expect_agreement(self.assimilate(), self.judged(numbers=[lambda t: analytic_model.reaction_force(t, *TRUTH)]))
        (self.folder / "dic/machine.csv").write_text("time,reaction_force\n7,1\n8,2\n")
        self.expect(4, "assimilate", self.project_name, stderr=["machine.csv: its times, 7 to 8, and those of the fields, 0.25 to 1", "none in common"])

    def test_a_field_in_pixels_turned_against_the_model_with_a_rigid_motion_of_each_picture(self):
        """Registered by three points; each picture moved by 20 µm and 0.02°, which the standard deviation alone cannot explain."""
        degree = math.pi / 180
        self.measure(lambda: (self.random.gauss(0, 2e-5), self.random.gauss(0, 2e-5), self.random.gauss(0, 0.02 * degree)))
        angle, scale = 30 * degree, 5e-5

        def pixel(x, y):  # y down
            return (800 + (x * math.cos(angle) + y * math.sin(angle)) / scale, 600 - (y * math.cos(angle) - x * math.sin(angle)) / scale)

        for step, t, rows in self.steps:
            lines = ["x,y,u,v,ZNCC,"]
            for x, y, u, v, _ in rows:
                a, b = pixel(x, y), pixel(x + u, y + v)
                lines.append(f"{a[0]!r},{a[1]!r},{b[0] - a[0]!r},{b[1] - a[1]!r},0.99,")
            lines.insert(3, "1.0,1.0,0.5,0.5,-4.0,")  # lost, and nowhere near the body
            (self.folder / f"dic/{t:.12f}_r16.csv").write_text("\r\n".join(lines) + "\r\n")
        corners = [(-0.12, 0.0), (0.12, 0.0), (0.0, 0.1)]
        declared = (f'files = "dic/*.csv"\ntime = "name"\nstd = 3e-6\nmotion_std = [2e-5, 0.02]\nscale = 5e-5\n'
                    f'points = {[list(pixel(*c)) for c in corners]}\nmodel_points = {[list(c) for c in corners]}\n')
        self.declare(declared)
        middle = [sum(p[k] for p in POINTS) / len(POINTS) for k in (0, 1)]
        columns = [[2e-5 * (c == k) for _ in POINTS for c in (0, 1)] for k in (0, 1)]
        columns.append([0.02 * degree * a for x, y in POINTS for a in (middle[1] - y, x - middle[0])])
        lines = self.assimilate()
        self.expect_agreement(lines, self.judged(columns))
        # With a motion towards the camera besides.
        self.declare(declared.replace("[2e-5, 0.02]", "[2e-5, 0.02, 3e-4]"))
        columns.append([3e-4 * a for x, y in POINTS for a in (x - middle[0], y - middle[1])])
        self.expect_agreement(self.assimilate(), self.judged(columns))
        # Without it the pictures contradict the model.
        self.declare(declared.replace("motion_std = [2e-5, 0.02]\n", ""))
        self.assertEqual(self.assimilate(status=8)[-1]["verdict"]["level"], "reject")
        # Upside down, the points do not fit each other; in another scale neither.
        self.declare(declared + 'y = "up"\n')
        self.expect(3, "assimilate", self.project_name, stderr=["the points do not fit each other", "data.fields.y"])
        self.declare(declared.replace("scale = 5e-5", "scale = 5e-4"))
        self.expect(3, "assimilate", self.project_name, stderr=["0.1 times as far apart", "data.fields.scale"])

    def test_infer_and_select_read_the_same_fields(self):
        self.measure(lost=lambda k, step: (3 * k + step) % 7 == 0)
        self.write_vic()
        self.declare(self.VIC)
        line = self.expect(0, "infer", self.project_name, "--json").lines()[-1]
        exact = self.judged()[-1]
        for k in (0, 1):
            std = exact["covariance"][k][k] ** 0.5
            self.assertLess(abs(line["mean"][k] - exact["mean"][k]), 0.02 * std)
            self.assertLess(abs(line["covariance"][k][k] ** 0.5 / std - 1), 0.02)
        chosen = self.expect(0, "select", self.project_name, "--json").lines()
        self.assertTrue(chosen)
        # With a motion of each field it is the last step of `assimilate`.
        self.declare(self.VIC + "motion_std = [1e-5, 0.01]\n")
        self.expect_same_as_the_last_step()

    def test_noise_from_pictures_at_rest_and_points_of_a_region(self):
        self.measure()
        rest = [(-1, 0.0, [(x, y, self.random.gauss(0, STD), self.random.gauss(0, STD), False) for x, y in POINTS]) for _ in range(3)]
        for k in range(3):
            self.steps.append((90 + k, 0.0, rest[k][2]))
        self.write_vic()
        self.steps = self.steps[:4]
        names = [f"plate-{90 + k:04}_0.csv" for k in range(3)]
        declared = self.VIC.replace("std = 3e-6", f"static = {names}".replace("'", '"')) + "region = [-0.065, 0, 0.065, 1]\nmin_distance = 0.04\n"
        self.declare(declared)
        line = self.assimilate()[-1]
        squares = [value ** 2 for _, _, rows in rest for row in rows for value in row[2:4]]
        std = math.sqrt(sum(squares) / len(squares))
        inside = [p for p in POINTS if abs(p[0]) <= 0.065]
        kept = []
        for p in POINTS:
            if all(math.hypot(p[0] - q[0], p[1] - q[1]) > 0.04 for q in kept):
                kept.append(p)
        kept = [p for p in kept if p in inside]
        self.assertEqual(line["used"], 2 * len(kept))
        judge = Judge(PRIORS)
        for _, t, rows in self.steps:
            judge.add(t, [(c, p, value, std) for c, p, value, _ in self.observations(rows) if p[:2] in kept])
        exact = judge.summary(3)
        self.expect_agreement([line], [exact])

    def test_what_is_not_said_is_asked_for(self):
        self.measure()
        self.write_vic()
        for leave_out, status, texts in (
                ('units = "mm"\n', 4, ["plate-0002_0.csv: vic-3d does not say the unit of its positions", "data.fields.units"]),
                ("origin = [120, 50]\n", 3, ["where the field is in the model", "model_points", self.position_of("[data.fields]")[:-1]]),
                ("std = 3e-6\n", 3, ['needs "std" or "static"']),
                ('steps = "steps.csv"\n', 4, ["does not say its time", "data.fields.steps"]),
                ('files = "dic"\n', 3, ['[data.fields] lacks "files"'])):
            self.declare(self.VIC.replace(leave_out, ""))
            self.expect(status, "assimilate", self.project_name, stderr=texts)
        for add, status, texts in (
                ('format = "vic3d"\n', 3, ['must be "auto" or one of vic-3d', 'not "vic3d"']),
                ('lost = ["sigma"]\n', 3, ["COLUMN < NUMBER"]),
                ('[data.fields.columns]\nw = "W"\n', 3, ['"w" is none of x, y, u, v, id']),
                ('[data.fields.series]\nreaction_force = "Stroke"\n', 3, ['state "Stroke"']),
                ("motion_std = [1e-5]\n", 3, ['"data.fields.motion_std" must be [m, degrees] or [m, degrees, relative], none negative']),
                ("region = [1, 1, 2, 2]\n", 4, ["no point is in data.fields.region"])):
            self.declare(self.VIC + add)
            self.expect(status, "assimilate", self.project_name, stderr=texts)
        self.declare(self.VIC.replace('"dic"', '"dic/*.txt"'))
        self.expect(4, "assimilate", self.project_name, stderr="dic/*.txt: no file is there")
        self.declare(self.VIC.replace("[120, 50]", "[0, 0]"))
        self.expect(4, "assimilate", self.project_name, stderr=["dic: 17 of 27 points lie outside the model's mesh: check data.fields.points", "data.fields.region"])

    def test_the_page_works_as_it_stands(self):
        page = (REPOSITORY / "docs/how-to/fields-of-other-programs.md").read_text()
        self.measure(lost=lambda k, step: k % 10 == step)
        self.write_vic()
        project, = re.findall(r"^ *```toml\n(.*?)^ *```$", page, re.M | re.S)[:1]
        (self.folder / "steps.csv").write_text("time,file\n" + "".join(f"{t!r},plate-{s:04}_0\n" for s, t, _ in self.steps))
        (self.folder / "page.toml").write_text(project)
        out = self.expect(0, "check", "page.toml").out
        shown, = re.findall(r"^ *(dic/plate-0002_0.csv: .*?)\n *```$", page, re.M | re.S)
        self.assertIn(re.sub(r"\s+", " ", shown), re.sub(r"\s+", " ", out))
        outcome = self.run_knothe("assimilate", "page.toml", "--json")
        self.assertEqual(outcome.status, 0, str(outcome))
        last = outcome.lines()[-2]
        for k, name in enumerate(("Y0", "Ad")):
            self.assertLess(abs(last["mean"][k] - TRUTH[k]), 4 * last["covariance"][k][k] ** 0.5, name)

    def test_the_samples_are_shown_by_check_as_their_truth_says(self):
        if not SAMPLES.exists():
            self.skipTest(f"{SAMPLES} is not there: set KNOTHE_DATA to the folder of recorded data beside it")
        # x from -0.01 to 0.01 m, y from 0.05 to 0.06 m of the model; times of the model.
        common = 'origin = [10, -50]\nstd = 1e-5\n'
        pixels = 'scale = 5e-5\npoints = [[100, 350], [500, 350], [500, 150]]\nmodel_points = [[-0.01, 0.05], [0.01, 0.05], [0.01, 0.06]]\nstd = 1e-5\n'
        for name, files, declared, texts in (
                ("gom_csv", "*.csv", common + "times = [0.25, 0.5, 0.75]\n", ["gom, 15 points, 0 lost", "gom, 13 points, 0 lost", "gom, 10 points, 10 lost"]),
                ("gom_points_csv", "*26.csv", common + 'times = [0.5]\nreference = "dic/plate_T1_0001.csv"\n', ["gom, 13 points, 0 lost"]),
                ("davis_csv", "*.csv", common + 'steps = "dic/load.csv"\ntime_zero = 0.001\n', ["davis, 13 points, 0 lost", "time 0.5"]),
                ("matchid_2024", "*.tiff.csv", common.replace("-50", "50") + 'steps = "dic/Image.csv"\ntime_zero = 408.75\n', ["matchid, 15 points, 2 lost", "time 0.5"]),
                ("dice_txt", "*", pixels + "times = [0.5]\n", ["dice, 15 points, 2 lost (SIGMA < 0, GAMMA < 0, BETA < 0), px"]),
                ("istra4d_hdf5", "*", pixels.replace("350", "-350").replace("150", "-150") + "times = [0.25, 0.5]\n", ["istra4d, 15 points, 2 lost"])):
            with self.subTest(name):
                shutil.rmtree(self.folder / "dic")
                shutil.copytree(SAMPLES / name, self.folder / "dic", copy_function=shutil.copyfile)
                (self.folder / "dic").chmod(0o755)
                if name == "matchid_2024":
                    (self.folder / "dic/Image_0000_0.tiff.csv").unlink()
                self.declare(f'files = "dic/{files}"\n' + declared)
                out = self.expect(0, "check", self.project_name).out
                for text in texts:
                    self.assertIn(text, out)


if __name__ == "__main__":
    unittest.main()
