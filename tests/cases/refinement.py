"""The full-order model asked where the posterior is. The judge is the posterior by full-order runs on a dense grid around it: a
model of its own, made by `knothe offline` on that box."""
import json
import os
import random
import unittest

from support import Case, by_form

TRUTHS = int(os.environ.get("KNOTHE_REFINEMENT_TRUTHS", "1"))
RUNS = int(os.environ.get("KNOTHE_REFINEMENT_RUNS", "14"))  # method.verify_runs


class Test(Case):
    project_name = "refinement.toml"

    def assimilate(self, project, results):
        outcome = self.run_knothe("assimilate", project, "--json", "-o", results)
        self.assertIn(outcome.status, (0, 8), str(outcome))
        return outcome.lines(), outcome.err

    @staticmethod
    def moments(line):
        return line["mean"], [line["covariance"][a][a] ** 0.5 for a in range(len(line["mean"]))]

    def judged(self, line):
        """Mean and standard deviation by full-order runs on a dense grid that reaches six standard deviations of `line`."""
        text = self.project.read_text().replace(f'verify = "full-order"\nverify_runs = {RUNS}\n', "").replace("model.h5", "dense.h5")
        mean, std = self.moments(line)
        head, first, second = text.split("[offline.parameters.")
        parts = []
        for a, (part, nodes) in enumerate(((first, by_form(11, 17)), (second, by_form(9, 13)))):
            lower, upper = max(0.5, mean[a] - 6 * std[a]), min(1.5, mean[a] + 6 * std[a])
            parts.append(part.replace("lower = 0.5", f"lower = {lower}").replace("upper = 1.5", f"upper = {upper}")
                         .replace("nodes = 5", f"nodes = {nodes}"))
        (self.folder / "dense.toml").write_text("[offline.parameters.".join([head, *parts]))
        self.expect(0, "offline", "dense.toml", "-o", "dense.h5", timeout=3600)
        return self.moments(self.assimilate("dense.toml", "dense/")[0][-2])

    def test_the_posterior_becomes_that_of_the_full_order_model(self):
        self.expect(0, "offline", self.project_name, "-o", "model.h5")
        self.edit('verify = "full-order"', f'verify = "full-order"\nverify_runs = {RUNS}')
        draw = random.Random(12)
        truths = [(1.07, 0.93)] + [(draw.uniform(0.7, 1.3), draw.uniform(0.7, 1.3)) for _ in range(TRUTHS - 1)]
        farthest, offs, wides = 0, [], []
        for k, truth in enumerate(truths):
            self.project.write_text(self.project.read_text().replace(
                "truth = { Y0 = %s, Ad = %s }" % truths[max(0, k - 1)], "truth = { Y0 = %s, Ad = %s }" % truth))
            self.expect(0, "simulate", self.project_name, "-o", "data.h5", "--seed", str(k + 1))
            lines, _ = self.assimilate(self.project_name, "results/")
            last, run = lines[-2], lines[-1]
            self.assertGreater(last["model_version"], 0)
            summary = json.loads((self.folder / "results" / "summary.json").read_text())
            self.assertLess(25 + summary["refinement"]["full_order_runs"], 26 + RUNS)  # 40
            (mean, std), (exact, exact_std) = self.moments(last), self.judged(last)
            off = [abs(m - e) / s for m, e, s in zip(mean, exact, exact_std)]
            wide = [abs(s / e - 1) for s, e in zip(std, exact_std)]
            level = run["verdict"]["level"]
            print(truth, "mean off by", off, "std by", wide, level)
            farthest = max(farthest, summary["refinement"]["moved_std"])
            offs.append(max(off))
            wides.append(max(wide))
            self.assertLess(max(off), 0.3 if level == "ok" else 0.5, truth)
            self.assertLess(max(wide), 0.25 if level == "ok" else 0.4, truth)
        for name, errors, limits in (("mean", offs, (0.1,)), ("std", wides, (0.05, 0.1))):
            counts = ", ".join(f"within {limit}: {sum(e < limit for e in errors)}" for limit in limits)
            print(f"{name} of {TRUTHS}: rms {(sum(e * e for e in errors) / TRUTHS) ** 0.5:.3f}, largest {max(errors):.3f}, {counts}")
        self.assertGreater(farthest, 0.2)  # or there was nothing to refine
        self.assertGreaterEqual(sum(off < 0.1 for off in offs), 0.5 * TRUTHS)

    def test_refine_by_hand(self):
        self.edit('verify = "full-order"\n', "")
        self.expect(0, "offline", self.project_name, "-o", "model.h5")
        self.expect(0, "simulate", self.project_name, "-o", "data.h5", "--seed", "1")
        before = self.assimilate(self.project_name, "results/")[0][-2]
        self.assertNotIn("model_version", before)
        said = self.expect(0, "offline", self.project_name, "--refine", "results", "-o", "fine.h5").out
        self.assertIn("fine.h5: ", said)
        self.assertIn("refined by 5 full-order solutions around the posterior of step 29", said)
        self.edit('model = "model.h5"', 'model = "fine.h5"')
        after = self.assimilate(self.project_name, "fine/")[0][-2]
        self.assertNotEqual(after["mean"], before["mean"])
        self.edit('model = "fine.h5"', 'model = "model.h5"')
        again = self.expect(0, "offline", self.project_name, "--refine", "fine", "-o", "fine.h5").out
        self.assertRegex(again, "refined by ([6-9]|10) full-order solutions")

    def test_what_it_needs_is_said(self):
        self.expect(0, "offline", self.project_name, "-o", "model.h5")
        self.expect(0, "simulate", self.project_name, "-o", "data.h5", "--seed", "1")
        text = self.project.read_text()
        self.project.write_text(text[:text.index("[offline]")])
        self.expect(3, "assimilate", self.project_name, stderr="the table [offline] that the model was made from")
        other = text.replace("element = 0.01", "element = 0.02")
        self.project.write_text(other)
        last = self.assimilate(self.project_name, "results/")[0][-1]
        said = " ".join(r["message"] for r in last["verdict"]["reasons"] if r["code"] == "model")
        self.assertIn("the full-order model could not be used", said)
        self.assertIn("a full-order solution does not fit the reduced model: it has", said)


if __name__ == "__main__":
    unittest.main(verbosity=2)
