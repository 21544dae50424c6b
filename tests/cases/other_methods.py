"""`knothe assimilate` by other methods and with robust likelihoods: the same lines, judged by quadrature."""
import math
import unittest

from support import Case


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def distance(self, lines, exact):
        """Worst shift of a mean in std, over the steps."""
        worst = 0
        for line, judge in zip(lines, exact):
            for k, mean in enumerate(judge["mean"]):
                worst = max(worst, abs(line["mean"][k] - mean) / math.sqrt(judge["covariance"][k][k]))
        return worst

    def test_every_method_prints_the_same_lines(self):
        exact = self.assimilate("--method", "grid")
        for method, bound in (("mcmc", 0.15), ("smc", 0.15), ("ekf", 1.5), ("ukf", 1.5), ("enkf", 1.5)):
            lines = self.assimilate("--method", method)
            self.assertEqual([list(line) for line in exact if not line.get("remark")][0],
                             [key for key in lines[0] if key != "remark"])
            self.assertLess(self.distance(lines, exact), bound, method)
            if method in ("mcmc", "smc"):
                for line, judge in zip(lines, exact):
                    self.assertAlmostEqual(line["log_evidence"], judge["log_evidence"], delta=0.3)
            else:  # filters say where they are wrong
                for line, judge in zip(lines, exact):
                    self.assertTrue(not line["trusted"] or self.distance([line], [judge]) < 0.25, (method, line))

    def test_gating_and_student_t_report_the_sensors(self):
        plain = self.assimilate()
        for options in ("gate = 6.0", 'likelihood = "student-t"\ndegrees_of_freedom = 30.0'):
            with self.subTest(options):
                self.edit("[method]\n", "[method]\n" + options + "\n")
                lines = self.assimilate()
                for line in lines:
                    sensors = line["sensors"]
                    self.assertEqual(sensors["indices"], list(range(24)))
                    self.assertEqual(len(sensors["test_ratio"]), 24)
                    self.assertLess(max(sensors["test_ratio"]), 6)
                self.assertLess(self.distance(lines, plain), 1e-9 if "gate" in options else 0.5)
                self.edit("[method]\n" + options + "\n", "[method]\n")

    def test_noise_level_and_offsets(self):
        self.edit("[method]\n", '[method]\nnoise_level = "unknown"\n')
        level = self.assimilate()[-1]["noise_level"]
        self.assertTrue(0.6 < level < 1.6, level)  # 288 values of the level that the file states
        self.edit('noise_level = "unknown"\n', "offset_std = 1e-6\n")
        self.assertEqual(len(self.assimilate()), 12)

    def test_the_models_own_error_goes_with_the_other_options(self):
        """It widens the posterior, whatever else the likelihood consists of."""
        def std(lines):
            return [math.sqrt(lines[-1]["covariance"][k][k]) for k in range(2)]

        for options in ("", "offset_std = 1e-6\n", "gate = 6.0\n", 'noise_level = "unknown"\n', 'bias_correction = "on"\n'):
            with self.subTest(options):
                self.edit("[method]\n", "[method]\n" + options)
                try:
                    without = std(self.assimilate())
                    self.edit("[method]\n", '[method]\ntruncation_error = "on"\n')
                    for wide, narrow in zip(std(self.assimilate()), without):
                        self.assertGreater(wide, 0.99 * narrow)
                finally:
                    self.edit('truncation_error = "on"\n', "")
                    self.edit("[method]\n" + options, "[method]\n")

    def test_what_does_not_go_together_is_named(self):
        self.edit('kind = "transport"', 'kind = "ekf"\nlikelihood = "student-t"')
        self.expect(2, "assimilate", self.project_name, stderr="Kalman filters take the data one by one")
        self.edit('kind = "ekf"\nlikelihood = "student-t"', 'kind = "ekf"\ngate = 6.0')
        self.assertEqual({line["method"] for line in self.assimilate()}, {"ekf"})  # a gate goes with every method
        self.edit('kind = "ekf"\ngate = 6.0', 'kind = "transport"\nnoise_level = "unknown"\nlikelihood = "student-t"')
        self.expect(3, "assimilate", self.project_name, stderr="links all data")

    def test_every_combination_with_bias_correction_works_or_is_refused_in_words(self):
        """noise_level, likelihood, gate, offsets, form and method beside bias_correction; the gate beside noise_level."""
        joint, linear = 'bias_correction = "on"\n', 'bias_correction = "on"\nbias_extrapolation = "linear"\n'
        one_by_one = "would be taken for outliers"
        for options, words in (
                (joint + "gate = 6.0\n", one_by_one),
                (joint + 'likelihood = "student-t"\n', one_by_one),
                (linear + "gate = 6.0\n", one_by_one),
                (joint + 'noise_level = "unknown"\n', "data cannot tell a bias from these"),
                (linear + 'noise_level = "unknown"\n', "data cannot tell a bias from these"),
                ('bias_correction = "auto"\nnoise_level = "unknown"\n', "data cannot tell a bias from these"),
                (linear + "offset_std = 1e-6\n", "noise that steps share"),
                (joint + "offset_std = 1e-6\n", None),
                ('gate = 6.0\nnoise_level = "unknown"\n', None)):
            with self.subTest(options):
                self.edit("[method]\n", "[method]\n" + options)
                if words:
                    self.expect(2, "assimilate", self.project_name, stderr=words)
                else:
                    self.assertEqual(all("noise_level" in line for line in self.assimilate()), "noise_level" in options)
                self.edit("[method]\n" + options, "[method]\n")
        self.edit("[method]\n", "[method]\n" + joint)
        self.expect(2, "assimilate", self.project_name, "--method", "ekf", stderr="take the data one by one")
        for method in ("grid", "smc"):
            self.assertEqual({line["bias_correction"] for line in self.assimilate("--method", method)}, {"on"})
        self.edit('form = "collapsed"', 'form = "composed"')
        self.expect(2, "assimilate", self.project_name, stderr='bias_extrapolation = "linear"')
        self.edit(joint, linear)
        self.assertIn("on", {line["bias_correction"] for line in self.assimilate()})

    def test_the_correction_as_published_is_another_than_with_the_modes_error(self):
        self.edit("[method]\n", '[method]\nbias_correction = "on"\nbias_extrapolation = "linear"\n')
        linear = self.assimilate()
        self.edit('"linear"', '"published"')
        published = self.assimilate()
        self.assertEqual({line["bias_correction"] for line in published}, {"off", "on"})  # nothing learnt before the first
        self.assertEqual(linear[0]["mean"], published[0]["mean"])
        self.assertNotEqual(linear[-1]["mean"], published[-1]["mean"])


if __name__ == "__main__":
    unittest.main()
