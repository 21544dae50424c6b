"""`knothe select`: the lines, judged by brute force with the derivatives that `knothe model evaluate` prints."""
import itertools
import math
import unittest

import analytic_model
from support import Case

KEYS = ["rank", "dof", "point", "component", "score", "sensitivity", "signal_to_noise", "posterior_std", "reason"]


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def choose(self, options):
        self.project.write_text(self.project.read_text() + "\n[select]\n" + options)
        lines = self.expect(0, "select", self.project_name, "--json").lines()
        last = lines.pop()
        self.assertIs(last["done"], True)
        self.assertEqual([line["rank"] for line in lines], list(range(len(lines))))
        for line in lines:
            self.assertEqual(list(line), KEYS)
            self.assertTrue(line["reason"])
        self.assertEqual(last["dofs"], [line["dof"] for line in lines])
        page = (self.folder / "results" / "selection.html").read_text()
        self.assertTrue(page.lower().startswith("<!doctype html>"))
        self.assertRegex(page, rf">{len(lines)} of {last['candidates']} dofs chosen<.*: standard deviation \S+ from the chosen dofs, \S+ from all; prior ")
        self.assertNotIn("Result: ", page.partition("<script")[0])
        return lines, last

    def gradients(self, step, y0=1.0, ad=1.0):
        (line,) = self.expect(0, "model", "evaluate", "model.h5", "--at", f"Y0={y0!r},Ad={ad!r}", "--step", step,
                              "--derivatives", "--json").lines()
        return line["gradient"]

    def test_the_papers_product_ranks_by_the_sensitivities_at_the_middle_step(self):
        lines, last = self.choose('criterion = "product"\ncount = 10\ncandidates = "model"\n')
        gradient = self.gradients(6)
        outer = [i for i in range(analytic_model.DOFS) if self.on_face(i)]
        self.assertEqual(last["candidates"], len(outer))
        best = sorted((abs(gradient[i][0] * gradient[i][1]) for i in outer), reverse=True)[:10]
        for line, exact in zip(lines, best):
            ours = abs(gradient[line["dof"]][0] * gradient[line["dof"]][1])
            self.assertAlmostEqual(ours / exact, 1, delta=1e-6)
        scores = [line["score"] for line in lines]
        self.assertEqual(scores, sorted(scores, reverse=True))

    def on_face(self, i):
        component, point = analytic_model.dof(i)
        outermost = max(analytic_model.dof(j)[1][2] for j in range(analytic_model.DOFS))
        return component in (0, 1) and point[2] == outermost

    def test_d_optimal_is_the_greedy_choice_over_all_steps(self):
        lines, last = self.choose('criterion = "d-optimal"\ncount = 3\ncandidates = "model"\n')
        prior = last["prior_std"]
        steps = [self.gradients(t) for t in range(analytic_model.STEPS)]
        outer = [i for i in range(analytic_model.DOFS) if self.on_face(i)]
        f = [1.0, 0.0, 1.0]
        for line in lines:
            def determinant(i):
                a = [f[0], f[1], f[2]]
                for g in steps:
                    u, v = g[i][0] * prior["Y0"] / 3e-6, g[i][1] * prior["Ad"] / 3e-6
                    a = [a[0] + u * u, a[1] + u * v, a[2] + v * v]
                return a[0] * a[2] - a[1] ** 2, a
            best = max(determinant(i)[0] for i in outer if i not in [x["dof"] for x in lines[:line["rank"]]])
            ours, g = determinant(line["dof"])
            self.assertAlmostEqual(ours / best, 1, delta=1e-6)
            self.assertAlmostEqual(line["score"], 0.5 * math.log(ours / (f[0] * f[2] - f[1] ** 2)), delta=1e-6)
            f = g
            self.assertAlmostEqual(line["posterior_std"]["Y0"] / (prior["Y0"] * math.sqrt(f[2] / ours)), 1, delta=1e-6)
        self.assertLess(last["posterior_std_all"]["Y0"], lines[-1]["posterior_std"]["Y0"])

    def test_candidates_are_those_of_the_data_and_keep_their_distance(self):
        lines, last = self.choose("count = 100\nmin_distance = 0.03\n")
        self.assertEqual((last["candidates"], last["candidates_from"]), (24, "data"))
        self.assertGreater(len(lines), 1)
        for a, b in itertools.combinations(lines, 2):
            self.assertGreaterEqual(math.dist(a["point"], b["point"]), 0.03 - 1e-9)

    def test_information_gain_and_words(self):
        self.choose('criterion = "information-gain"\ncount = 4\n')
        text = self.expect(0, "select", self.project_name).out
        self.assertIn("most informative about", text)
        self.assertIn("4 of 24 dofs by information-gain", text)

    def test_mistakes_are_named(self):
        self.project.write_text(self.project.read_text() + "\n[select]\nstep = 99\n")
        self.expect(3, "select", self.project_name, stderr="select.step = 99: the model has steps 0 to 11")
        self.edit("step = 99", "at = { Y = 1 }")
        self.expect(3, "select", self.project_name, stderr='select.at.Y is not a parameter of the model')
        self.edit("{ Y = 1 }", "{ Y0 = 7 }")
        self.expect(3, "select", self.project_name, stderr="select.at.Y0 = 7 lies outside the model's box, 0.5 to 1.5")


if __name__ == "__main__":
    unittest.main()
