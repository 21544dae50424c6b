"""The parts of the study on a coarse beam and on terms that are known; tests/cases/reproduce.py runs it, and the whole at night."""
import json
import os
import shutil
import tempfile
import unittest
from pathlib import Path

import numpy as np

import beam
import bias
import experiment
import law_and_modes
import open_questions
import record
import selection

COARSE = beam.Case("coarse", "elements of 20 mm, 12 steps", nodes=3, element=0.02, steps=12)


def two_terms():
    """u = 2 a(x) b(t) p q + c(x) d(t) (2 - p) (3 - q): orthogonal over space and over time, so the best single one is the larger."""
    nodes, first, second = np.array([0.5, 1.0, 1.5]), np.array([1.0, 2, 0, 0]), np.array([0, 0, 1.0, 0.5])
    space = np.array([np.ones(6), np.tile([1.0, -1], 3)]) / np.sqrt(6)
    p, q = nodes[:, None], nodes[None]
    values = np.sqrt(6) * np.stack([2 * (p * q)[..., None] * first, ((2 - p) * (3 - q))[..., None] * second], -1)
    return beam.Runs(Path("none"), ["Y0", "Ad"], [nodes, nodes], np.array([0.25, 0.5, 0.75, 1.0]), np.zeros((4, 6)), space, values)


class Test(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = Path(tempfile.mkdtemp(prefix="knothe-study-"))
        cls.options = beam.Options(cls.folder, quick=True, repetitions=1)
        cls.subject = experiment.Subject(COARSE, cls.options)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder, ignore_errors=True)

    def complete(self, figure):
        """Every row says something in each column, every number is finite, no cell is empty where there need not be."""
        self.assertTrue(figure.setting and figure.panels and figure.rows)
        for row in figure.row_records():
            for key in ("quantity", "unit", "paper", "here", "why"):
                self.assertTrue(row[key], row)
        json.dumps(figure.record([]), allow_nan=False)
        return figure

    def test_stress_is_the_laws_closed_form(self):
        strain = np.linspace(0, 4e-4, 4001)
        for threshold, brittleness in ((1, 1), (0.5, 1.5)):
            stress = law_and_modes.stress(strain, threshold, brittleness)
            lame, shear = 30e9 * 0.23 / (1.23 * 0.54), 15e9 / 1.23
            energy = 0.5 * (lame + 2 * shear) * strain**2
            damage = np.where(energy > 216 * threshold, 1 - 1 / (1 + 2.25e-3 * brittleness * (energy - 216 * threshold)), 0)
            # Tension along x with sides that contract by nu: (1 - D) (lambda tr + 2 mu e).
            np.testing.assert_allclose(stress, (1 - damage) * (lame * (1 - 2 * 0.23) + 2 * shear) * strain, rtol=1e-12)

    def test_smoothed_is_the_mean_of_neighbours_and_of_fewer_at_the_ends(self):
        self.assertEqual(experiment.smoothed([1, 2, 6, 4], 3), [1.5, 3, 4, 5])
        self.assertEqual(experiment.smoothed([1, 2], 1), [1, 2])

    def test_numbers_are_printed_as_in_the_reports(self):
        self.assertEqual([record.readable(v) for v in (0, 9.999, 1234, 0.00123, -5e-7, 2e7)],
                         ["0", "10.0", "1234", "0.00123", "−5.00·10⁻⁷", "2.00·10⁷"])
        self.assertEqual(record.with_uncertainty(1.0032, 0.0101), "1.003 ± 0.010")

    def test_modes_are_found_one_by_one_and_in_the_beginning(self):
        runs = two_terms()
        two = beam.one_by_one(runs, 2)
        self.assertLess(runs.largest(runs.coefficients - runs.values(two)), 1e-5)
        one = runs.coefficients - runs.values(beam.one_by_one(runs, 1))
        self.assertAlmostEqual(runs.largest(one), 1.5 * 2.5, delta=1e-5)  # what is left is the second term
        early = beam.fitted_to_beginning(runs, 3, 2)  # describes all four steps, so it is right in the last too
        self.assertLess(runs.largest(runs.coefficients - runs.values(early)), 1e-5)

    def test_a_bias_that_grows_along_a_line_is_taken_away(self):
        random = np.random.default_rng(1)
        seen, noise = random.standard_normal((8, 6)), 1e-9 * random.standard_normal((8, 6))
        exact = seen + 1e-3 * (1 + np.arange(8.0))[:, None]
        less = bias.less_true_residual(seen, exact, exact + noise)
        np.testing.assert_array_equal(less[0], (exact + noise)[0])  # nothing learnt before the first
        self.assertLess(np.abs(less[2:] - seen[2:]).max(), 1e-7)

    def test_models_are_kept_and_those_of_another_case_are_not(self):
        path = self.subject.beam.paper
        before = os.stat(path).st_mtime_ns
        self.assertEqual(os.stat(beam.Beam(COARSE, self.options).paper).st_mtime_ns, before)
        other = beam.Beam(beam.Case("coarse", "described otherwise", nodes=3, element=0.02, steps=12), self.options)
        self.assertFalse(other.kept(path, other.identity))
        errors = [beam.error_of(getattr(self.subject.beam, name))[0] for name in ("paper", "three_best", "three")]
        self.assertTrue(0 < errors[0] < errors[1] <= errors[2] * (1 + 1e-9), errors)

    def test_the_model_of_all_runs_is_the_full_order_solution_at_a_node(self):
        truth = np.array([0.5, 1.5])
        exact = open_questions.solution(self.subject, truth)
        seen = experiment.predicted(self.subject.beam.runs.path, self.subject.sensors, truth)
        self.assertLess(np.abs(seen - exact).max(), 1e-9)  # m, a thousandth of the noise

    def test_the_same_seed_gives_the_same_run_and_the_truth_is_found(self):
        run, again = self.subject.assimilate(marginals=True), self.subject.assimilate()
        np.testing.assert_array_equal(run.means, again.means)
        self.assertEqual(len(self.subject.sensors), 60)
        self.assertTrue(np.all(run.off_by()[-1] < 4) and np.all(run.std < run.stds[0]))
        for k in range(2):
            self.assertAlmostEqual(run.mode_of_marginal(k), run.mean[k], delta=2 * run.std[k])
        composed = self.subject.assimilate(**experiment.PAPER)
        self.assertLess(np.max(np.abs(composed.mean - run.mean) / run.std), 0.1)

    def test_the_camera_and_what_is_chosen_by_its_matrix(self):
        camera = selection.camera_of(COARSE, 1)
        self.assertGreater(len(camera.points), 300)
        self.assertFalse(np.any((np.abs(camera.points[:, 0]) < 0.01) & (camera.points[:, 1] < 0.02)))
        self.assertLess(np.abs(camera.matrix - camera.matrix.T).max(), 1e-12 * np.abs(camera.matrix).max())
        self.assertAlmostEqual(np.median(np.sqrt(np.diag(camera.covariance))), 1e-6, delta=1e-12)
        np.testing.assert_allclose(camera.precision @ camera.covariance, np.eye(len(camera.matrix)), atol=1e-8)
        chosen, weighted = camera.select_as_published(self.subject.model, 5)
        self.assertEqual(len(set(chosen)), 30)
        self.assertGreaterEqual(np.abs(weighted[chosen]).min(), np.delete(np.abs(weighted), chosen).max())
        self.assertEqual(list(camera.at_random(7)), list(camera.at_random(7)))
        self.assertNotEqual(list(camera.at_random(7)), list(camera.at_random(8)))
        rows = selection.rows_of(camera.precision)
        np.testing.assert_allclose(rows.toarray(), camera.precision, rtol=1e-9, atol=1e-9 * camera.precision.max())

    def test_the_onset_study_has_a_median_for_every_onset_and_treatment(self):
        figure = self.complete(bias.bias_onset(self.subject, self.options))
        self.assertEqual(figure.data["onset"], [15, 25, 35, 50, 65])
        self.assertEqual(len(figure.tables[0][2]), 30)
        for name in bias.TREATMENTS:
            low, middle, high, worst = (np.array(figure.data[f"{key}_{name}"]) for key in
                                        ("last_low", "last_median", "last_high", "worst_median"))
            self.assertTrue(np.all(low <= middle) and np.all(middle <= high) and np.all(middle <= worst), name)

    def test_decompositions_are_judged_by_the_uncompressed_snapshots(self):
        figure = self.complete(open_questions.decompositions(self.subject, self.options))
        self.assertEqual(figure.data["truth_is_node"], [1, 0, 0])
        errors = figure.data["error_um, uncompressed snapshots"]
        self.assertTrue(errors[0] < 1e-3 < min(errors[1:]), errors)
        self.assertEqual(figure.data["worst_shift_std, uncompressed snapshots"], [0, 0, 0])
        self.assertTrue(all(shift > 0 for shift in figure.data["worst_shift_std, m = 3"]))

    def test_figures_are_complete_and_the_files_hold_them(self):
        figures = [law_and_modes.figure_5(self.options), law_and_modes.figures_6_7(self.subject), law_and_modes.figures_10_12(self.subject),
                   selection.figures_16_17(self.subject, self.options)]
        for figure in figures:
            self.complete(figure)
        about = {"program": "knothe", "quick": True, "seed": 1, "repetitions": 1, "reference": COARSE.what, "elapsed_s": 1.0}
        file = record.write(self.folder / "out", figures, about)
        written = json.loads(Path(file).read_text())
        self.assertEqual([figure["figure"] for figure in written["figures"]], ["5", "6-7", "10-12", "16-17"])
        drawings = [drawing for figure in written["figures"] for panel in figure["panels"] for drawing in panel["drawings"]]
        self.assertEqual(len(written["faces"]), 2)  # the beam's, and what the camera sees
        for drawing in drawings:
            if drawing["kind"] == "chart":
                for curve in drawing["curves"]:
                    self.assertEqual(len(curve["x"]), len(curve["y"]))
                    self.assertEqual(curve["x"], sorted(curve["x"]))
            else:
                face = written["faces"][drawing["face"]]
                values = drawing["value"] if "value" in drawing else drawing["field"]["x"]
                self.assertEqual(len(values), len(face["points"]))
                self.assertTrue(all(0 <= i < len(values) for cell in face["cells"] for i in cell))
        # Shown is what was computed: the law's closed form, and the dofs that were chosen.
        curve = drawings[0]["curves"][2]
        np.testing.assert_allclose(curve["y"], 1e-6 * law_and_modes.stress(1e-4 * np.array(curve["x"])), rtol=1e-4, atol=1e-9)
        self.assertEqual(sum(len(drawing.get("sensors", [])) for drawing in drawings), 30)
        beam.run("report", self.folder / "out", "-o", self.folder / "out" / "reproduce.html")
        text = (self.folder / "out" / "reproduce.html").read_text()
        for words in ("Fig. 5 of the paper", "Fig. 10-12 of the paper", "why they differ", f"Figure {len(drawings)}.", "</html>"):
            self.assertIn(words, text)
        self.assertNotIn(f"Figure {len(drawings) + 1}.", text)

    def test_densities_are_thinned_to_the_last(self):
        points = np.linspace(0, 1, 5)
        entry = record.Densities("d", "x", "–", [(points, points + i) for i in range(100)], truth=1).record([])
        self.assertEqual([step["step"] for step in entry["steps"]][-2:], [95, 99])
        self.assertLessEqual(len(entry["steps"]), 30)
        self.assertEqual(entry["steps"][-1]["density"], [99, 99.25, 99.5, 99.75, 100])


if __name__ == "__main__":
    unittest.main()
