"""`knothe infer` with a separated model: the same posterior as `knothe assimilate` from the same data, by another way."""
import json
import math
import unittest

from support import Case


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def infer(self, *arguments):
        lines = self.expect(0, "infer", self.project_name, "--json", *arguments).lines()
        self.assertEqual(len(lines), 1)
        return lines[0]

    def expect_same(self, line, judge, evidence=0.01):
        for k in range(2):
            sigma = math.sqrt(judge["covariance"][k][k])
            self.assertAlmostEqual(line["mean"][k], judge["mean"][k], delta=0.02 * sigma)
            self.assertAlmostEqual(math.sqrt(line["covariance"][k][k]) / sigma, 1, delta=0.02)
            self.assertAlmostEqual(line["maximum_a_posteriori"][k], judge["maximum_a_posteriori"][k], delta=1e-6)
        self.assertAlmostEqual(line["log_evidence"], judge["log_evidence"], delta=evidence)

    def test_all_data_at_once_as_step_by_step(self):
        last = self.assimilate()[-1]
        line = self.infer()
        self.assertTrue(line["trusted"], line["verdict"])
        self.expect_same(line, last)
        for name, k in (("Y0", 0), ("Ad", 1)):
            self.assertEqual(list(line["physical"][name]), list(last["physical"][name]))
            reference = last["physical"][name]["mean"] / last["mean"][k]
            self.assertAlmostEqual(line["physical"][name]["mean"] / line["mean"][k] / reference, 1, delta=1e-12)
        self.expect_same(self.infer("--method", "grid"), last)

    def use_observations(self, *lines):
        self.edit('data = "data.h5"\n', "")
        self.project.write_text(self.project.read_text() + "\n[observations]\n" + "\n".join(lines) + "\n")

    def observed(self, point, step, dofs):
        outcome = self.expect(0, "model", "evaluate", "model.h5", "--at", point, "--step", str(step), "--dofs",
                              ",".join(map(str, dofs)), "--json")
        return json.loads(outcome.out)["values"]

    def test_chosen_dofs_at_chosen_steps(self):
        """Exact predictions of a point, seen precisely: the most probable parameters are that point, nearly."""
        dofs, steps = [1, 4, 7, 10], [3, 6, 11]
        values = [v for step in steps for v in self.observed("Y0=1.1,Ad=0.85", step, dofs)]
        self.use_observations(f"dofs = {dofs}", f"steps = {steps}", f"values = {values}", f"std = {[1e-8] * len(values)}")
        line = self.infer()
        for found, true in zip(line["maximum_a_posteriori"], (1.1, 0.85)):
            self.assertAlmostEqual(found, true, delta=1e-3)

    def expect_refused(self, status, *texts):
        self.expect(status, "infer", self.project_name, stderr=texts)

    def test_a_step_that_is_not_there(self):
        self.use_observations("dofs = [0]", "steps = [99]", "values = [0.0]", "std = [1e-6]")
        self.expect_refused(3, f"assimilation.toml:{self.position_of('steps = ')}: error: ", "no step 99", "0 to 11")

    def test_a_dof_that_is_not_there(self):
        self.use_observations("dofs = [1000000]", "steps = [1]", "values = [0.0]", "std = [1e-6]")
        self.expect_refused(3, f"assimilation.toml:{self.position_of('dofs = [1000000]')}: error: ", "no dof 1000000")

    def test_an_output_that_is_not_there(self):
        self.use_observations('output = "reaction_farce"', "steps = [1]", "values = [0.0]", "std = [1.0]")
        self.expect_refused(3, "no output", 'did you mean "reaction_force"?')

    def test_an_output(self):
        self.use_observations('output = "reaction_force"', "steps = [5, 11]", "values = [1100.0, 1200.0]", "std = [20.0, 30.0]")
        line = self.infer("--method", "grid")
        self.expect_close_to(line, self.infer())

    def expect_close_to(self, judge, line):
        for k in range(2):
            sigma = math.sqrt(judge["covariance"][k][k])
            self.assertAlmostEqual(line["mean"][k], judge["mean"][k], delta=0.03 * sigma)
        self.assertAlmostEqual(line["log_evidence"], judge["log_evidence"], delta=0.02)

    def test_the_number_of_values(self):
        self.use_observations("dofs = [0, 1]", "steps = [1, 2]", "values = [0.0]", "std = [1e-6]")
        self.expect_refused(3, "1 values were observed", "returns 4")

    def test_neither_steps_nor_dofs(self):
        self.use_observations("values = [0.0]", "std = [1e-6]")
        self.expect_refused(3, '"steps"')

    def test_data_and_observations_are_one_too_many(self):
        with open(self.project, "a") as file:
            file.write("\n[observations]\nsteps = [3]\ndofs = [0]\nvalues = [1.0]\nstd = [0.1]\n")
        self.expect(3, "infer", self.project_name, stderr="both say what was observed: leave one of them out")

    def test_no_data(self):
        self.edit('data = "data.h5"\n', "")
        self.expect_refused(3, "this command needs observations")

    def test_kalman_filters_are_for_assimilation(self):
        self.use_observations("values = [0.0]", "std = [1e-6]", "dofs = [1]", "steps = [1]")
        self.edit('kind = "transport"', 'kind = "ekf"')
        self.expect_refused(3, "is for `knothe assimilate`")


if __name__ == "__main__":
    unittest.main()
