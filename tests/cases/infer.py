"""`knothe infer`: exact answers through all methods, and all kinds of models and priors."""
import math
import unittest

from infer_support import InferCase, conjugate, diagonal, quadrature
from umbridge_server import Density, EightSchools, Growth, Linear, Linear3

KEYS = ["method", "parameters", "wall_clock", "mean", "covariance", "maximum_a_posteriori", "quantiles", "skewness", "kurtosis",
        "mean_error", "deviation_error", "map_order",
        "variance_diagnostic", "tolerance_reached", "ess", "trusted", "verdict", "edge_mass", "log_evidence", "log_evidence_error",
        "model_evaluations", "model_calls", "elapsed_us", "samples_file", "distinct_draws", "physical", "computation", "doubts", "fit_probability"]
MAP_KEYS = KEYS + ["map_file"]
LINEAR = conjugate(Linear.matrix, [1.2, 0.4, 0.1], diagonal([0.3, 0.5, 0.4]), [0.5, -0.5], [1.0, 2.0])


class Test(InferCase):
    def expect_linear(self, line, **tolerances):
        mean, covariance, evidence = LINEAR
        self.expect_close(line, mean, covariance, evidence, **tolerances)
        self.assertTrue(line["trusted"], line["verdict"])
        for k in range(2):
            sigma = math.sqrt(covariance[k][k])
            tolerance = max(0.02, 5 * tolerances.get("mean_tolerance", 0)) * sigma
            self.assertAlmostEqual(line["maximum_a_posteriori"][k], mean[k], delta=1e-5 * sigma)
            for level, normal in zip(range(5), (-1.959964, -0.67449, 0, 0.67449, 1.959964)):
                self.assertAlmostEqual(line["quantiles"]["values"][k][level], mean[k] + normal * sigma, delta=2 * tolerance)

    def test_linear_by_a_map_from_values_alone(self):
        self.serve("linear")
        line = self.infer()
        self.assertEqual(list(line), MAP_KEYS)
        self.expect_linear(line)
        self.assertEqual(line["map_order"], 1)
        self.assertTrue(line["verdict"].startswith("Trusted: "))
        self.assertLess(line["model_evaluations"], 8000)  # with the particles that look for other modes
        self.assertEqual(line["model_evaluations"], self.server_calls()["/Evaluate"])
        for k in range(2):
            self.assertAlmostEqual(line["skewness"][k], 0, delta=0.02)
            self.assertAlmostEqual(line["kurtosis"][k], 3, delta=0.03)

    def test_linear_far_from_the_prior(self):
        """A hundred prior deviations off: particles that look for other modes must not have to come all the way."""
        self.serve("linear")
        values = [120.0, 4.0, 1.0]
        self.set_observations(f"values = {values}", "std = [0.3, 0.5, 0.4]")
        mean, covariance, evidence = conjugate(Linear.matrix, values, diagonal([0.3, 0.5, 0.4]), [0.5, -0.5], [1.0, 2.0])
        line = self.infer()
        self.expect_close(line, mean, covariance, evidence)
        self.assertEqual(line["map_order"], 1)
        self.assertTrue(line["trusted"], line["verdict"])
        self.assertLess(line["model_evaluations"], 20000)

    def expect_wrong_derivatives(self, kind, feature):
        """The banana of `expect_banana`, whose server has forgotten a sign: said, and the answer as right as ever."""
        line = self.expect_banana("wrongslope+" + kind)
        self.assertEqual(len(line["warnings"]), 1, line["warnings"])
        self.assertRegex(line["warnings"][0], rf"{feature} is wrong: at x = .* it says .* along x where differences say .*; "
                                              "it is not used, differences take its place")
        outcome = self.expect(0, "infer", self.project_name, "--method", "grid")
        self.assertIn(f"knothe: warning: ", outcome.err)

    def test_a_wrong_gradient_is_found_and_not_used(self):
        self.expect_wrong_derivatives("gradient", "Gradient")

    def test_a_wrong_jacobian_is_found_and_not_used(self):
        self.expect_wrong_derivatives("jacobian", "ApplyJacobian")

    def test_linear_by_a_map_with_gradients(self):
        self.serve("linear+gradient")
        line = self.infer()
        self.expect_linear(line)
        self.assertEqual(line["model_calls"]["gradient"], self.server_calls()["/Gradient"])

    def test_linear_by_a_map_with_jacobians(self):
        self.serve("linear+jacobian")
        line = self.infer()
        self.expect_linear(line)
        self.assertEqual(line["model_calls"]["apply_jacobian"], self.server_calls()["/ApplyJacobian"])
        self.assertEqual(line["model_evaluations"], self.server_calls()["/Evaluate"])

    def test_every_kind_of_call_is_counted_as_the_server_counts(self):
        self.serve("linear+hessian")
        for method in ("transport", "grid", "mcmc", "smc"):
            before = self.server_calls()
            said = self.infer("--method", method)["model_calls"]
            after = self.server_calls()
            for key, route in (("evaluate", "/Evaluate"), ("gradient", "/Gradient"), ("apply_jacobian", "/ApplyJacobian"),
                               ("apply_hessian", "/ApplyHessian")):
                self.assertEqual(said[key], after.get(route, 0) - before.get(route, 0), (method, key))
        self.assertRegex(self.expect(0, "infer", self.project_name).out, r"\d+ model evaluations, \d+ gradients, \d+ Jacobian products, ")

    def test_observations_that_do_not_fit_are_named(self):
        """Trusted speaks of the computation: the sentence says why the result may be wrong."""
        self.serve("linear")
        self.set_observations("values = [1.2, 40.0, -35.0]", "std = [0.3, 0.5, 0.4]")
        line = self.infer()
        self.assertTrue(line["trusted"], line["verdict"])
        self.assertIn("But the observations do not fit the model: at the most probable parameters χ² is ", line["verdict"])
        self.assertLess(line["fit_probability"], 1e-9)
        outcome = self.expect(0, "infer", self.project_name, "-o", "R")
        self.assertEqual(outcome.out.splitlines()[-2], "Result: do not use")
        self.expect(0, "report", "R", "-o", "R.html")
        page = (self.folder / "R.html").read_text()
        for text in ("Result: do not use<", "<p>The observations do not fit the model: ", "<p>Computation trusted: "):
            self.assertIn(text, page)
        self.set_observations("values = [1.2, 0.4, 0.1]", "std = [0.3, 0.5, 0.4]")
        self.assertGreater(self.infer()["fit_probability"], 0.01)

    def test_a_prior_that_ends_before_the_answer_is_named(self):
        self.serve("linear")
        self.set_priors('a = { prior = "uniform", lower = -100.0, upper = -2.0 }', 'b = { prior = "normal", mean = -0.5, std = 2.0 }')
        line = self.infer("--method", "smc")
        self.assertGreater(line["edge_mass"][0], 0.9)
        self.assertRegex(line["verdict"], r"But \d+ % of the posterior of a lies next to the end of its prior, -2, which cuts it off: ")
        self.assertEqual(line["edge_mass"][1], 0)  # a prior without ends
        # In the outer 2 % of a wide prior, and yet many standard deviations from its end.
        self.set_priors('a = { prior = "uniform", lower = 0.0, upper = 1000.0 }', 'b = { prior = "normal", mean = -0.5, std = 2.0 }')
        self.set_observations("values = [3.2, 2.4, 2.1]", "std = [0.03, 0.05, 0.04]")
        line = self.infer("--method", "smc")
        self.assertGreater(line["edge_mass"][0], 0.9)
        self.assertNotIn("next to the end", line["verdict"])

    def test_all_draws_are_distinct(self):
        self.serve("linear")
        for method in ("transport", "grid", "smc"):
            self.assertEqual(self.infer("--method", method)["distinct_draws"], 4000, method)

    def test_derivatives_may_be_declined(self):
        self.serve("linear+hessian")
        self.edit('name = "forward"', 'name = "forward"\nderivatives = "none"')
        self.expect_linear(self.infer())
        self.assertEqual([k for k in self.server_calls() if k in ("/Gradient", "/ApplyJacobian", "/ApplyHessian")], [])

    def test_linear_by_a_grid(self):
        self.serve("linear")
        self.expect_linear(self.infer("--method", "grid"), mean_tolerance=1e-4, std_tolerance=1e-4, evidence_tolerance=1e-4)

    def test_linear_by_chains(self):
        self.serve("linear+gradient")
        line = self.infer("--method", "mcmc")
        self.assertEqual(list(line), KEYS + ["r_hat", "effective_sizes", "std_errors", "acceptance"])
        self.expect_linear(line, mean_tolerance=0.12, std_tolerance=0.1, evidence_tolerance=0.1)
        self.assertEqual(line["model_evaluations"], self.server_calls()["/Evaluate"])

    def test_linear_by_particles(self):
        self.serve("linear")
        line = self.infer("--method", "smc")
        self.expect_linear(line, mean_tolerance=0.12, std_tolerance=0.1, evidence_tolerance=0.25)

    def expect_few_calls(self, line, mean, std):
        """Right within what is stated, and with at most 20,000 calls of all kinds, as the server counts them."""
        self.assertEqual((line["method"], line["trusted"]), ("smc", True), line["verdict"])
        for k, (exact, sigma) in enumerate(zip(mean, std)):
            self.assertAlmostEqual(line["mean"][k], exact, delta=0.1 * sigma)
            self.assertAlmostEqual(math.sqrt(line["covariance"][k][k]), sigma, delta=0.05 * sigma)
        calls = self.server_calls()
        made = sum(calls.get(route, 0) for route in ("/Evaluate", "/Gradient", "/ApplyJacobian", "/ApplyHessian"))
        self.assertEqual(made, sum(line["model_calls"].values()))
        self.assertLess(made, 20000)

    def test_ten_parameters_cost_less_than_20000_calls(self):
        """Eight schools. Given the first two coordinates the others are Gaussian: mean and std of those by a grid."""
        self.serve("eightschools+gradient")
        self.set_priors(*(f'z{k} = {{ prior = "normal", mean = 0.0, std = 1.0 }}' for k in range(10)))
        self.edit('name = "forward"', 'name = "posterior"\nkind = "density"')
        self.set_observations()
        sums = [[0.0] * 3 for _ in range(2)]
        n = 160
        for i in range(n):
            for j in range(n):
                z = (-5 + 10 * (i + 0.5) / n, -6 + 9 * (j + 0.5) / n)
                tau = math.exp(1 + z[1])
                value = -0.5 * (z[0] ** 2 + z[1] ** 2)
                for y, s in zip(EightSchools.effects, EightSchools.errors):
                    variance = s * s + tau * tau
                    value -= 0.5 * ((y - 5 * z[0]) ** 2 / variance + math.log(variance))
                for k in range(2):
                    for power in range(3):
                        sums[k][power] += math.exp(value) * z[k] ** power
        mean = [s[1] / s[0] for s in sums]
        self.expect_few_calls(self.infer("--method", "auto"), mean, [math.sqrt(s[2] / s[0] - m * m) for s, m in zip(sums, mean)])

    def expect_growth(self, model, truth, priors):
        """y = a (1 − e^{−b t}) + c + d t: given b linear in the others, hence one integral over b. `priors` [mean, std] of the others."""
        std, size = 0.05, len(truth)
        values = Growth().value([*truth, 0.0, 0.0, 0.0][:4], {})
        self.serve(model)
        b_prior = 'b = { prior = "lognormal", mu = 0.0, sigma = 0.5 }'
        lines = [f'{name} = {{ prior = "normal", mean = {mean}, std = {s} }}' for name, (mean, s) in zip("acd", priors)]
        self.set_priors(lines[0], b_prior, *lines[1:])
        self.set_observations(f"values = {values}", f"std = {[std] * 8}")
        total, first, second = 0.0, [0.0] * size, [0.0] * size
        for i in range(400):
            z = -5 + 10 * (i + 0.5) / 400
            b = math.exp(0.5 * z)
            matrix = [[1 - math.exp(-b * t), 1.0, t][:size - 1] for t in Growth.times]
            mean, covariance, evidence = conjugate(matrix, values, diagonal([std] * 8), [m for m, _ in priors], [s for _, s in priors])
            weight = math.exp(evidence - 0.5 * z * z)
            total += weight
            means = [mean[0], b, *mean[1:]]
            squares = [covariance[0][0], 0.0, *(covariance[k][k] for k in range(1, size - 1))]
            for k in range(size):
                first[k] += weight * means[k]
                second[k] += weight * (squares[k] + means[k] ** 2)
        mean = [x / total for x in first]
        self.expect_few_calls(self.infer("--method", "auto"), mean, [math.sqrt(x / total - m * m) for x, m in zip(second, mean)])

    def test_four_parameters_from_values_alone_cost_less_than_20000_calls(self):
        self.expect_growth("growth", [2.0, 0.8, 0.3, 0.1], [(1.5, 1.0), (0.0, 0.5), (0.0, 0.3)])

    def test_three_parameters_from_values_alone_cost_less_than_20000_calls(self):
        self.expect_growth("growth3", [2.0, 0.8, 0.3], [(1.5, 1.0), (0.0, 0.5)])

    def expect_few_calls_in_the_plane(self, model, values, std, log_density, box):
        """Two parameters with the priors N(0, 1)."""
        self.serve(model)
        self.set_priors('x = { prior = "normal", mean = 0.0, std = 1.0 }', 'y = { prior = "normal", mean = 0.0, std = 1.0 }')
        self.set_observations(f"values = {values}", f"std = {std}")
        _, mean, covariance = quadrature(lambda x, y: log_density(x, y) - 0.5 * x * x - 0.5 * y * y, box, 800)
        line = self.infer("--method", "auto")
        self.expect_few_calls(line, mean, [math.sqrt(covariance[k][k]) for k in (0, 1)])
        return line

    def test_a_banana_from_values_alone_costs_less_than_20000_calls(self):
        self.expect_few_calls_in_the_plane("banana", [0.5, -0.3], [1.0, 0.1],
                                           lambda x, y: -0.5 * (x - 0.5) ** 2 - 50 * (y - x * x + 0.3) ** 2, ((-3, 3), (-2, 5)))

    def test_both_of_two_modes_cost_less_than_20000_calls(self):
        line = self.expect_few_calls_in_the_plane("twomodes", [2.0, 0.0], [0.3, 0.5],
                                                  lambda x, y: -0.5 * ((x * x - 2) / 0.3) ** 2 - 2 * y * y, ((-3, 3), (-4, 4)))
        self.assertGreater(line["quantiles"]["values"][0][3], 1.2)
        self.assertLess(line["quantiles"]["values"][0][1], -1.2)

    def test_one_parameter_costs_less_than_20000_calls(self):
        values, std = Growth().value([2.0, 0.8, 0.3, 0.0], {}), 0.2
        self.serve("growth1")
        self.set_priors('b = { prior = "lognormal", mu = 0.0, sigma = 0.5 }')
        self.set_observations(f"values = {values}", f"std = {[std] * 8}")
        sums = [0.0] * 3
        for i in range(4000):
            z = -6 + 12 * (i + 0.5) / 4000
            b = math.exp(0.5 * z)
            predicted = Growth().value([2.0, b, 0.3, 0.0], {})
            weight = math.exp(-0.5 * z * z - 0.5 * sum(((y - p) / std) ** 2 for y, p in zip(values, predicted)))
            for power in range(3):
                sums[power] += weight * b ** power
        mean = sums[1] / sums[0]
        self.expect_few_calls(self.infer("--method", "auto"), [mean], [math.sqrt(sums[2] / sums[0] - mean * mean)])

    def test_a_full_covariance_of_the_noise(self):
        self.serve("linear")
        covariance = [[0.09, 0.06, 0.0], [0.06, 0.25, -0.05], [0.0, -0.05, 0.16]]
        self.set_observations("values = [1.2, 0.4, 0.1]", f"covariance = {covariance}")
        mean, exact, evidence = conjugate(Linear.matrix, [1.2, 0.4, 0.1], covariance, [0.5, -0.5], [1.0, 2.0])
        self.expect_close(self.infer(), mean, exact, evidence)

    def test_three_parameters_in_two_vectors(self):
        self.serve("linear3+hessian")
        self.set_priors("a = { prior = \"normal\", mean = 0.5, std = 1.0 }", "b = { prior = \"normal\", mean = 0.0, std = 2.0 }",
                        "c = { prior = \"normal\", mean = -1.0, std = 0.7 }")
        values, std = [1.2, 0.4, 0.1, -0.8], [0.3, 0.5, 0.4, 0.6]
        self.set_observations(f"values = {values}", f"std = {std}")
        mean, covariance, evidence = conjugate(Linear3.matrix, values, diagonal(std), [0.5, 0.0, -1.0], [1.0, 2.0, 0.7])
        self.expect_close(self.infer(), mean, covariance, evidence)
        self.expect_close(self.infer("--method", "grid"), mean, covariance, evidence, 1e-3, 1e-3, 1e-3)

    def test_config_is_passed_through(self):
        self.serve("linear")
        self.edit('name = "forward"', 'name = "forward"\nconfig = { scale = 2.0, note = ["kept", { as = "it is" }] }')
        matrix = [[2 * a for a in row] for row in Linear.matrix]
        mean, covariance, evidence = conjugate(matrix, [1.2, 0.4, 0.1], diagonal([0.3, 0.5, 0.4]), [0.5, -0.5], [1.0, 2.0])
        self.expect_close(self.infer(), mean, covariance, evidence)

    def expect_banana(self, model):
        """(x, y − x²) observed as (0.5, 0) ± (0.4, 0.3), prior N(0, 1) and N(0, 2²)."""
        self.serve(model)
        self.set_priors("x = { prior = \"normal\", mean = 0.0, std = 1.0 }", "y = { prior = \"normal\", mean = 0.0, std = 2.0 }")
        self.set_observations("values = [0.5, 0.0]", "std = [0.4, 0.3]")

        def log_density(x, y):
            return (-0.5 * ((x - 0.5) / 0.4) ** 2 - 0.5 * ((y - x * x) / 0.3) ** 2 - 0.5 * x * x - 0.125 * y * y
                    - math.log(0.4 * 0.3 * 2) - 2 * math.log(2 * math.pi))

        evidence, mean, covariance = quadrature(log_density, ((-3, 4), (-3, 9)))
        line = self.infer()
        self.assertTrue(line["trusted"], line["verdict"])
        self.expect_close(line, mean, covariance, evidence, 0.02, 0.02, 0.01)
        return line

    def test_banana_from_values_alone(self):
        line, judge = self.expect_banana("banana"), self.infer("--method", "grid")
        for k in range(2):
            self.assertAlmostEqual(line["skewness"][k], judge["skewness"][k], delta=0.05)
            self.assertAlmostEqual(line["kurtosis"][k] / judge["kurtosis"][k], 1, delta=0.05)

    def test_banana_with_hessians(self):
        line = self.expect_banana("banana+hessian")
        self.assertEqual(line["model_calls"]["apply_hessian"], self.server_calls()["/ApplyHessian"])

    def test_uniform_and_lognormal_priors(self):
        self.serve("identity")
        self.set_priors("u = { prior = \"uniform\", lower = 0.0, upper = 2.0 }", "l = { prior = \"lognormal\", mu = 0.0, sigma = 0.25 }")
        self.set_observations("values = [1.7, 1.3]", "std = [0.4, 0.2]")

        def log_density(u, c):
            return (-0.5 * ((u - 1.7) / 0.4) ** 2 - 0.5 * ((c - 1.3) / 0.2) ** 2 - math.log(0.4 * 0.2) - math.log(2 * math.pi)
                    - math.log(2) - 0.5 * (math.log(c) / 0.25) ** 2 - math.log(c * 0.25) - 0.5 * math.log(2 * math.pi))

        evidence, mean, covariance = quadrature(log_density, ((0, 2), (0.2, 3)), 600)
        for method in ("transport", "grid"):
            line = self.infer("--method", method)
            self.assertTrue(line["trusted"], line["verdict"])
            self.expect_close(line, mean, covariance, evidence, 0.02, 0.02, 0.01)
            self.assertAlmostEqual(line["maximum_a_posteriori"][0], 1.7, delta=1e-4)

    def test_the_most_probable_point_may_be_at_an_end_of_the_prior(self):
        self.serve("identity")
        self.set_priors("u = { prior = \"uniform\", lower = 0.0, upper = 2.0 }", "v = { prior = \"normal\", mean = 0.0, std = 1.0 }")
        self.set_observations("values = [2.5, 0.0]", "std = [0.4, 1.0]")
        self.assertEqual(self.infer()["maximum_a_posteriori"][0], 2.0)

    def use_density(self):
        self.edit('name = "forward"', 'name = "posterior"\nkind = "density"')
        self.set_observations()

    def expect_density(self, model):
        self.serve(model)
        self.use_density()
        (a, b), (_, c) = Density.precision
        determinant = a * c - b * b
        covariance = [[c / determinant, -b / determinant], [-b / determinant, a / determinant]]
        line = self.infer()
        self.expect_close(line, Density.mean, covariance, 3 + math.log(2 * math.pi) - 0.5 * math.log(determinant))
        self.assertTrue(line["trusted"], line["verdict"])
        for k in range(2):
            self.assertAlmostEqual(line["maximum_a_posteriori"][k], Density.mean[k], delta=1e-3)

    def test_a_density_from_values_alone(self):
        self.expect_density("density")

    def test_a_density_with_gradients(self):
        self.expect_density("density+gradient")

    def test_a_density_with_hessians(self):
        self.expect_density("density+hessian")

    def test_priors_are_not_added_to_a_density(self):
        """Gamma(3, rate 2) and beta(2, 3), on supports given by lognormal and uniform priors."""
        self.serve("exponential")
        self.use_density()
        self.set_priors("g = { prior = \"lognormal\", mu = 0.3, sigma = 0.6 }", "h = { prior = \"uniform\", lower = 0.0, upper = 1.0 }")
        line = self.infer()
        exact = math.log(2 / 8) + math.log(1 * 2 / 24)  # Γ(3)/2³, B(2, 3)
        self.expect_close(line, [1.5, 0.4], [[0.75, 0.0], [0.0, 0.04]], exact, 0.02, 0.02, 0.01)
        self.assertTrue(line["trusted"], line["verdict"])
        self.assertAlmostEqual(line["maximum_a_posteriori"][0], 1.0, delta=1e-3)
        self.assertAlmostEqual(line["maximum_a_posteriori"][1], 1 / 3, delta=1e-3)

    def test_two_modes_are_not_trusted(self):
        self.serve("twomodes")
        self.set_priors("x = { prior = \"normal\", mean = 0.0, std = 1.0 }", "y = { prior = \"normal\", mean = 0.0, std = 1.0 }")
        self.set_observations("values = [2.0, 0.0]", "std = [0.1, 0.5]")
        line = self.infer(status=6)
        self.assertFalse(line["trusted"])
        self.assertTrue(line["verdict"].startswith("Not trusted: "))
        self.assertIn("second mode", line["verdict"])

    def test_comparison_prints_a_table_and_two_sentences(self):
        self.serve("linear")
        outcome = self.expect(0, "infer", self.project_name, "--compare", "transport,grid")
        self.assertIn("grid minus transport, in units of the posterior std", outcome.out)
        self.assertIn("std ratio", outcome.out)
        self.expect(0, "report", "results", "-o", "both.html")
        page = (self.folder / "both.html").read_text()
        for text in ("Two methods compared", "grid minus transport", "transport: Computation trusted: ", "Marginal of a", "<svg"):
            self.assertIn(text, page)
        self.assertIn("The two agree: means differ by at most 0.0", outcome.out)
        sentences = outcome.out.splitlines()[-2:]
        self.assertTrue(sentences[0].startswith("transport: Trusted") and sentences[1].startswith("grid: Trusted"), outcome.out)

    def test_trusted_answers_that_contradict_each_other_end_with_8(self):
        """The server's model is another one for the second run."""
        self.serve("moving")
        lines = self.expect(8, "infer", self.project_name, "--json", "--compare", "transport,grid").lines()
        self.assertEqual([line["trusted"] for line in lines[:2]], [True, True])
        self.assertEqual(lines[2]["comparison"]["agreement"], "contradict")
        outcome = self.expect(8, "infer", self.project_name, "--compare", "smc,grid")
        self.expect(0, "report", "results", "-o", "two.html")
        page = (self.folder / "two.html").read_text()
        self.assertIn("smc and grid contradict each other: ", page)
        self.assertIn("Result: do not use", page)
        self.assertIn("The two contradict each other, so that one of them is wrong: means differ by at most", outcome.out)

    def answer_of_one(self, model, *arguments, status=0, parameters="a"):
        self.serve(model)
        self.use_density()
        self.set_priors(*(f'{name} = {{ prior = "normal", mean = 0.0, std = 2.0 }}' for name in parameters))
        if "transport" in arguments:  # 100,000 by default
            self.edit("[method]", "[method]\nevaluations = 20000")
        line = self.infer(*arguments, status=status)
        calls = self.server_calls()
        self.assertLessEqual(sum(calls.get(route, 0) for route in ("/Evaluate", "/Gradient")), 20000)
        return line, [math.sqrt(line["covariance"][k][k]) for k in range(len(parameters))]

    def test_a_density_with_a_kink(self):
        line, std = self.answer_of_one("laplace", "--method", "auto")
        self.assertAlmostEqual(line["mean"][0], 1.7, delta=0.1)
        self.assertAlmostEqual(std[0], math.sqrt(2), delta=0.05 * math.sqrt(2))
        self.assertAlmostEqual(line["maximum_a_posteriori"][0], 1.7, delta=1e-3)

    def test_a_density_that_ends_at_its_mode(self):
        line, std = self.answer_of_one("halfnormal", "--method", "auto")
        self.assertAlmostEqual(line["mean"][0], 0.7979, delta=0.06)
        self.assertAlmostEqual(std[0], 0.6028, delta=0.03)
        self.assertAlmostEqual(line["log_evidence"], math.log(math.sqrt(math.pi / 2)), delta=0.05)

    def test_a_flat_density_by_a_map_is_answered_within_the_budget(self):
        line, std = self.answer_of_one("disc", "--method", "transport", status=(0, 6), parameters="ab")
        for s in std:
            self.assertAlmostEqual(s, 0.5, delta=0.1)

    def test_a_map_of_a_heavy_tail_is_not_trusted(self):
        line, _ = self.answer_of_one("cauchy", "--method", "transport", status=6)
        self.assertTrue(line["verdict"].startswith("Not trusted: "), line["verdict"])

    def test_the_budget_is_kept_and_goes_on(self):
        self.serve("banana")
        self.set_observations("values = [0.5, 0.0]", "std = [0.4, 0.3]")
        self.edit("[method]", "[method]\nevaluations = 3000")
        line = self.infer("--method", "smc", status=6)
        self.assertIn("The budget of 3000 calls is spent: evaluations = 6000 goes on from here.", line["verdict"])
        made = self.server_calls()["/Evaluate"]
        self.assertLessEqual(made, 3000)
        self.edit("evaluations = 3000", "evaluations = 20000")
        line = self.infer("--method", "smc")
        self.assertTrue(line["trusted"], line["verdict"])
        self.assertLess(line["model_evaluations"], self.server_calls()["/Evaluate"])  # the first run's are reused
        self.assertLess(self.server_calls()["/Evaluate"], 20000)

    def test_comparison_as_json(self):
        self.serve("linear")
        lines = self.expect(0, "infer", self.project_name, "--json", "--compare", "grid,transport").lines()
        self.assertEqual([line.get("method") for line in lines], ["grid", "transport", None])
        comparison = lines[2]["comparison"]
        self.assertEqual(comparison["methods"], ["grid", "transport"])
        for k in range(2):
            sigma = math.sqrt(lines[0]["covariance"][k][k])
            self.assertAlmostEqual(comparison["mean_difference"][k], (lines[1]["mean"][k] - lines[0]["mean"][k]) / sigma, delta=0.01)
            self.assertAlmostEqual(comparison["std_ratio"][k], 1, delta=0.02)
        self.assertAlmostEqual(comparison["log_evidence_difference"], 0, delta=0.01)

    def test_connections_that_the_server_closes_are_opened_again(self):
        self.serve("linear", "close")
        self.expect_linear(self.infer("--method", "grid"))

    def test_several_connections_give_the_same_bits(self):
        self.serve("linear")
        one = self.infer()
        self.edit('name = "forward"', 'name = "forward"\nconnections = 3')
        several = self.infer()
        for line in (one, several):
            del line["elapsed_us"], line["wall_clock"]
        self.assertEqual(one, several)

    def test_results_and_report(self):
        self.serve("banana")
        self.set_observations("values = [0.5, 0.0]", "std = [0.4, 0.3]")
        line = self.infer("-o", "R")
        self.expect_nothing_but(self.folder / "R", ["inference.json", "map.h5", "samples.nc"])
        self.assertEqual(line["map_file"], "R/map.h5")
        self.assertEqual(line["samples_file"], "R/samples.nc")
        self.expect(0, "report", "R", "-o", "R.html")
        page = (self.folder / "R.html").read_text()
        for text in ("Result: usable<", "Computation trusted: ", "Pull-back", "Draws of the posterior, pair by pair", "Time per phase", "order", "<svg"):
            self.assertIn(text, page)

    def test_the_sentence_is_the_last_line(self):
        self.serve("linear")
        outcome = self.expect(0, "infer", self.project_name)
        self.assertEqual(outcome.out.splitlines()[-2], "Result: usable")
        self.assertTrue(outcome.out.splitlines()[-1].startswith("Trusted: "), outcome.out)


if __name__ == "__main__":
    unittest.main()
