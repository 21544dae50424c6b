"""Mistakes in a project file: exit status 3, `file:line:column: error: …`, all at once."""
import re
import unittest

from support import Case


class Test(Case):
    project_name = "project_file.toml"

    def expect_error(self, old, new, at, *texts):
        """With `old` replaced by `new`, the only complaint is at the text `at`."""
        self.edit(old, new)
        outcome = self.expect(3, "check", self.project_name, stderr=texts)
        self.assertTrue(outcome.err.startswith(f"{self.project_name}:{self.position_of(at)}: error: "), outcome.err)
        self.assertEqual(outcome.err.count("\n"), 1, outcome.err)

    def test_the_short_form_of_data_beside_its_tables_is_explained(self):
        self.edit("[parameters]", "[data.std]\nreaction_force = 2.0\n\n[parameters]", 1)
        self.expect(3, "check", self.project_name, stderr=[self.position_of("reaction_force = 2.0"), "not valid TOML", 'as [data] and `file = "FILE"`'])

    def test_a_valid_file_is_valid(self):
        self.assertIn("valid", self.expect(0, "check", self.project_name).out)

    def test_a_missing_file_is_named(self):
        for command in (["check", "none.toml"], ["assimilate", "none.toml"], ["forecast", "none.toml"]):
            self.expect(3, *command, stderr=["none.toml", "No such file"])

    def test_a_folder_is_no_project_file(self):
        self.expect(3, "check", ".", stderr="cannot read the project file")

    def test_a_misspelt_key_gets_the_nearest_one(self):
        self.expect_error("tolerance =", "tolerence =", "tolerence", 'unknown key "tolerence"', 'did you mean "tolerance"?')

    def test_a_misspelt_table_gets_the_nearest_one(self):
        self.expect_error("[simulate]", "[simulat]", "simulat]", '"simulat"', 'did you mean "simulate"?')

    def test_a_misspelt_key_of_a_prior_gets_the_nearest_one(self):
        self.edit("lower = 0.6", "lowr = 0.6")
        self.expect(3, "check", self.project_name, stderr=[f":{self.position_of('lowr')}: error: ", 'did you mean "lower"?'])

    def test_a_wrong_type_is_told_with_what_is_needed(self):
        self.expect_error("max_order = 8", 'max_order = "eight"', '"eight"', "method.max_order", "integer ≥ 0", "eight")

    def test_an_order_that_no_map_has_is_refused(self):
        self.expect_error("max_order = 8", "max_order = 1000", "max_order", "method.max_order", "at most 23")

    def test_a_number_for_a_text_is_refused(self):
        self.expect_error('model = "model.h5"', "model = 5", "5", '"model"', "not 5")

    def test_a_negative_standard_deviation_is_refused(self):
        self.expect_error("std = 0.45", "std = -0.45", "-0.45", "parameters.Y0.std", "positive", "-0.45")

    def test_a_negative_noise_is_refused(self):
        self.expect_error("noise_std = 1e-6", "noise_std = -1e-6", "-1e-6", "simulate.noise_std", "positive")

    def test_infinite_and_nan_are_no_numbers(self):
        self.expect_error("mean = 0.9", "mean = nan", "nan", "parameters.Y0.mean", "finite")

    def test_an_unknown_choice_lists_the_choices(self):
        self.expect_error('kind = "transport"', 'kind = "transprt"', '"transprt"', "method.kind", '"transport", "grid"',
                          'did you mean "transport"?')

    def test_a_prior_needs_its_own_keys(self):
        self.expect_error("mean = 0.9, std = 0.45", "mean = 0.9", "{ prior", "parameters.Y0", 'needs "std"')

    def test_a_uniform_prior_needs_increasing_ends(self):
        self.expect_error("upper = 1.4", "upper = 0.4", "upper = 0.4", "parameters.Ad", '"upper" must be greater than "lower"')

    def test_a_required_key_is_asked_for(self):
        self.expect_error('quantity = "crack_length"\n', "", "[forecast.crack]", "forecast.crack", "quantity")

    def test_broken_toml_is_told_by_position(self):
        self.edit("seed = 1", "seed = = 1")
        outcome = self.expect(3, "check", self.project_name, stderr="not valid TOML")
        line = self.position_of("seed = =").partition(":")[0]
        self.assertTrue(outcome.err.startswith(f"{self.project_name}:{line}:"), outcome.err)

    def test_several_errors_are_told_at_once_in_order(self):
        self.edit("std = 0.45", "std = -1")
        self.edit('form = "collapsed"', 'form = "colapsed"')
        self.edit("steps = 20", "steps = 0")
        self.edit("noise_std", "noise_sdt")
        lines = self.expect(3, "check", self.project_name).err.splitlines()
        self.assertEqual(len(lines), 4, lines)
        for line, text in zip(lines, ["parameters.Y0.std", 'did you mean "collapsed"?', "offline.steps", 'did you mean "noise_std"?']):
            self.assertRegex(line, rf"^{self.project_name}:\d+:\d+: error: ")
            self.assertIn(text, line)
        numbers = [int(re.match(r"[^:]+:(\d+):", line).group(1)) for line in lines]
        self.assertEqual(numbers, sorted(numbers))

    def test_the_project_files_error_comes_before_the_models(self):
        self.edit("seed = 1", "sede = 1")
        self.expect(3, "assimilate", self.project_name, stderr='did you mean "seed"?')

    def test_every_error_names_the_file_as_it_was_given(self):
        self.edit("seed = 1", "sede = 1")
        outcome = self.expect(3, "check", self.project)
        self.assertTrue(outcome.err.startswith(f"{self.project}:"), outcome.err)

    def test_what_a_command_needs_and_the_file_lacks_is_told(self):
        self.project.write_text("# empty\n")
        self.expect(0, "check", self.project_name)
        self.expect(3, "assimilate", self.project_name, stderr=["this command needs a model", 'model = "MODEL.h5"'])


if __name__ == "__main__":
    unittest.main()
