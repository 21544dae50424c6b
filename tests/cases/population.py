"""`knothe population`: results of several specimens, and the prior of the next (the mathematics: population_test.cpp)."""
import json
import re
import unittest

from infer_support import InferCase
from support import REPOSITORY

SPECIMENS = {"A": [1.2, 0.4, 0.1], "B": [1.0, 0.7, -0.3], "C": [1.5, 0.3, 0.4]}
TABLE = ("Population of 2 specimens", "  a: mean ", "a new specimen's b: ", "correlation of b and a: ", "  B: a ", "log Bayes factor", "Trusted")
KEYS = ["parameters", "coordinates", "priors", "mean", "spread", "correlation", "new_specimen", "specimens", "log_bayes_factor", "method",
        "trusted", "verdict"]


class Test(InferCase):
    def setUp(self):
        super().setUp()
        self.serve("linear")
        self.set_observations("values = [1.2, 0.4, 0.1]", "std = [0.1, 0.1, 0.1]")
        self.observed = "values = [1.2, 0.4, 0.1]"

    def infer_specimen(self, name, folder=None):
        values = f"values = {SPECIMENS[name]}"
        self.edit(self.observed, values)
        self.observed = values
        self.infer("-o", folder or name)

    def population(self, *arguments):
        lines = self.expect(0, "population", *arguments, "--json").lines()
        self.assertEqual(len(lines), 1)
        return lines[0]

    def test_the_next_specimen_takes_it_as_prior_and_joins_it(self):
        for name in SPECIMENS:
            self.infer_specimen(name)
        text = self.expect(0, "population", "A", "B", "-o", "two").out
        for part in TABLE:
            self.assertIn(part, text)
        found = json.loads((self.folder / "two" / "population.json").read_text())
        self.assertEqual(list(found), KEYS + ["created_by"])
        self.assertEqual((found["parameters"], found["coordinates"]), (["a", "b"], ["own", "own"]))
        self.assertEqual(found["priors"], {"mean": [[0.5, 1.0], [-0.5, 2.0]], "spread": [1.0, 2.0]})
        self.assertEqual([specimen["name"] for specimen in found["specimens"]], ["A", "B"])
        for specimen in found["specimens"]:
            self.assertTrue(specimen["belongs"], specimen)
            for k in range(2):
                self.assertLess(specimen["std"][k], specimen["own"]["std"][k])
        # C by its own prior or by that of the population: the same population of three.
        three = self.population("A", "B", "C")
        for name in "ab":
            line = next(line for line in self.project.read_text().splitlines() if line.startswith(f"{name} = "))
            self.edit(line, f'{name} = {{ prior = "posterior", of = "two" }}')
        self.infer_specimen("C", "C-of-two")
        again = self.population("A", "B", "C-of-two")
        for part in ("mean", "spread"):
            for k in range(2):
                self.assertAlmostEqual(again[part]["mean"][k], three[part]["mean"][k], delta=0.2 * three[part]["std"][k])

    def test_the_command_of_the_page(self):
        page = (REPOSITORY / "docs/how-to/next-specimen.md").read_text()
        (command,) = re.findall(r"^```sh\nknothe (population .*)\n```$", page, re.M)
        for name, place in zip(SPECIMENS, re.findall(r"(specimen-\d)/results", command)):
            (self.folder / place).mkdir()
            self.infer_specimen(name, f"{place}/results")
        self.assertIn("Population of 3 specimens", self.expect(0, *command.split()).out)
        self.assertTrue((self.folder / "population" / "samples.nc").is_file())

    def test_stated_priors_and_the_logarithm(self):
        self.set_priors('a = { prior = "lognormal", mu = 0.0, sigma = 0.5 }', 'b = { prior = "normal", mean = 0.0, std = 1.0 }')
        for name in "AB":
            self.infer_specimen(name)
        found = self.population("A", "B", "--mean", "a", 0.1, 0.2, "--spread", "a", 0.05, "--spread", "b", 0.3)
        self.assertEqual(found["coordinates"], ["logarithm", "own"])
        self.assertEqual(found["priors"], {"mean": [[0.1, 0.2], [0.0, 1.0]], "spread": [0.05, 0.3]})
        self.assertLess(found["spread"]["mean"][0], 0.1)
        self.assertGreater(found["new_specimen"]["quantiles"]["values"][0][0], 0.5)  # of a itself

    def test_priors_that_are_narrower_than_the_population_are_told(self):
        self.set_priors(*(f'{name} = {{ prior = "normal", mean = {mean}, std = 0.05 }}' for name, mean in (("a", 0.5), ("b", -0.5))))
        for name in "AB":
            self.infer_specimen(name)
        outcome = self.expect(0, "population", "A", "B", "--spread", "a", 50)
        said = "the population of a is wider than the prior of {}, whose data are known only within that: repeat its inference with a wider prior"
        for name in "AB":
            self.assertIn(said.format(name), re.sub(r"\s+", " ", outcome.out + outcome.err))

    def test_what_is_wrong_is_told(self):
        for name in "AB":
            self.infer_specimen(name)
        self.expect(2, "population", "A", stderr="a population needs the results of at least two specimens, not 1")
        self.expect(2, "population", "A", "B", "A", stderr="A is given twice")
        self.expect(2, "population", "A", "B", "--spread", "aa", 1, stderr='a prior is stated for "aa", but the specimens share a, b (did you mean "a"?)')
        self.expect(2, "population", "A", "B", "--spread", "a", -1, stderr='the prior stated for "a" needs a positive number, not -1')
        self.expect(4, "population", "A", "C", stderr="C: ")
        self.population("A", "B", "-o", "two")
        self.expect(4, "population", "A", "two", stderr="two: does not hold the prior of its posterior")


if __name__ == "__main__":
    unittest.main()
