"""`knothe infer` with servers that go wrong and projects that make no sense: the right exit status, within the timeout, in words."""
import re
import signal
import subprocess
import time
import unittest

from infer_support import InferCase
from support import KNOTHE


class Test(InferCase):
    def expect_refused(self, status, *texts, arguments=()):
        self.expect(status, "infer", self.project_name, *arguments, stderr=texts)

    def expect_project_refused(self, *texts, key=None, after=""):
        """Refused before the server is asked anything: there is none."""
        place = [f"infer.toml:{self.position_of(key, after)}: error: "] if key else []
        self.expect_refused(3, *place, *texts)

    def test_no_server(self):
        self.edit("PORT", "1")
        self.expect_refused(4, "http://127.0.0.1:1", "cannot connect", "Connection refused", "is it running?")

    def test_an_unknown_host(self):
        self.edit("127.0.0.1:PORT", "no-such-host.invalid:4242")
        self.edit("timeout = 20", "timeout = 5")  # where names are asked of somebody who does not answer
        self.expect_refused(4, "no-such-host.invalid")

    def test_a_server_that_hangs(self):
        self.serve("linear", "hang", 10)
        self.edit("timeout = 20", "timeout = 1.5")
        self.expect_refused(4, "/Evaluate", "no answer within 1.5 s", "at a = ")

    def test_a_server_that_dies_in_the_middle(self):
        self.serve("linear", "die", 100)
        self.expect_refused(4, "closed the connection", "it may have died", "at a = ")

    def test_a_wrong_size(self):
        self.serve("linear", "wrong-size", 3)
        self.expect_refused(4, "output[0] has 4 entries", "must have 3", "at a = ")

    def test_nan(self):
        self.serve("linear", "nan", 3)
        self.expect_refused(4, "/Evaluate at a = ", "not JSON", "no NaN", "[[NaN, 0.0, 0.0]]")

    def test_null(self):
        self.serve("linear", "null", 3)
        self.expect_refused(4, "output[0][0] is null, not a finite number")

    def test_the_servers_own_words(self):
        self.serve("linear", "error", 3)
        self.expect_refused(4, "the server says: InvalidInput: the mesh is inverted at element 17", "at a = ")

    def test_an_answer_that_is_not_json(self):
        self.serve("linear", "not-json", 3)
        self.expect_refused(4, "HTTP status 502", "Bad gateway")

    def test_an_old_protocol(self):
        self.serve("linear", "old-protocol")
        self.expect_refused(4, "version 0.9 of the UM-Bridge protocol", "1.0")

    def test_an_unknown_model(self):
        self.serve("linear")
        self.edit('name = "forward"', 'name = "foward"')
        self.expect_refused(4, 'no model "foward" (did you mean "forward"?)', '"forward", "another"')

    def test_several_models_and_no_name(self):
        self.serve("linear")
        self.edit('name = "forward"\n', "")
        self.expect_refused(4, "several models", '"forward", "another"')

    def test_too_few_parameters(self):
        self.serve("linear3")
        self.expect_refused(3, "infer.toml:3:1: error: ", "[parameters] has 2 parameters", "takes 3 values", "2, 1")

    def test_too_few_observations(self):
        self.serve("linear")
        self.set_observations("values = [1.2, 0.4]", "std = [0.3, 0.5]")
        self.expect_refused(3, "2 values were observed", "returns 3")

    def test_a_density_of_several_numbers(self):
        self.serve("linear")
        self.edit('name = "forward"', 'name = "forward"\nkind = "density"')
        self.set_observations()
        self.expect_refused(3, 'kind = "density" means one number', "returns 3")

    def test_a_density_with_observations(self):
        self.edit('name = "forward"', 'name = "forward"\nkind = "density"')
        self.expect_project_refused("[observations] cannot be combined with", key="[observations]")

    def test_a_covariance_that_is_not_symmetric(self):
        self.set_observations("values = [1.0, 2.0]", "covariance = [[1.0, 0.5], [0.4, 1.0]]")
        self.expect_project_refused("not symmetric: [1][0] is 0.4, [0][1] is 0.5", key="covariance")

    def test_a_singular_covariance(self):
        self.set_observations("values = [1.0, 2.0]", "covariance = [[1.0, 1.0], [1.0, 1.0]]")
        self.expect_project_refused("singular", "positive definite", key="covariance")

    def test_an_indefinite_covariance(self):
        self.set_observations("values = [1.0, 2.0]", "covariance = [[1.0, 2.0], [2.0, 1.0]]")
        self.expect_project_refused("indefinite", key="covariance")

    def test_a_covariance_that_is_not_square(self):
        self.set_observations("values = [1.0, 2.0]", "covariance = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]")
        self.expect_project_refused("not square", "row 0 has 3 entries", key="covariance")

    def test_a_covariance_of_the_wrong_size(self):
        self.set_observations("values = [1.0, 2.0]", "covariance = [[1.0]]")
        self.expect_project_refused("1 × 1", "2 values", key="covariance")

    def test_a_standard_deviation_of_zero(self):
        self.set_observations("values = [1.0, 2.0]", "std = [0.1, 0.0]")
        self.expect_project_refused("entry 1 is 0", "positive", key="std = [0.1")

    def test_standard_deviations_of_the_wrong_number(self):
        self.set_observations("values = [1.0, 2.0]", "std = [0.1]")
        self.expect_project_refused("1 entries for 2 values", key="std = [0.1")

    def test_no_noise(self):
        self.set_observations("values = [1.0, 2.0]")
        self.expect_project_refused('"std" or "covariance"', key="[observations]")

    def test_priors_of_zero_width(self):
        self.edit("std = 1.0 }", "std = 0.0 }")
        self.expect_project_refused("must be a positive number, not 0", key="0.0 }", after="a = {")

    def test_a_uniform_prior_of_zero_width(self):
        self.set_priors("u = { prior = \"uniform\", lower = 1.0, upper = 1.0 }")
        self.expect_project_refused("[parameters.u]", '"upper" must be greater than "lower"')

    def test_no_parameters(self):
        self.set_priors()
        self.expect_project_refused("this command needs a table [parameters]")

    def test_max_order_zero(self):
        self.edit("max_order = 6", "max_order = 0")
        self.expect_project_refused('"method.max_order" must be at least 1', key="max_order")

    def test_all_errors_at_once(self):
        self.edit("max_order = 6", "max_order = 0")
        self.edit("std = [0.3, 0.5, 0.4]", "std = [0.3, -0.5, 0.4]")
        self.edit('name = "forward"', 'nam = "forward"')
        self.expect_project_refused("max_order", "entry 1 is -0.5", 'unknown key "nam" in [model] (did you mean "name"?)')

    def test_an_address_that_is_none(self):
        self.edit("http://127.0.0.1:PORT", "https://127.0.0.1:4242")
        self.expect_project_refused("https is not supported", key="umbridge")

    def test_no_model(self):
        text = self.project.read_text()
        begin, end = text.index("[model]"), text.index("[observations]")
        self.project.write_text(text[:begin] + text[end:])
        self.expect_project_refused("this command needs a model")

    def test_a_grid_in_four_dimensions(self):
        self.set_priors(*(f"{name} = {{ prior = \"normal\", mean = 0.0, std = 1.0 }}" for name in "abcd"))
        self.expect_refused(2, "at most 3 parameters", arguments=("--method", "grid"))

    def test_wrong_usage(self):
        self.expect_refused(2, "--method", arguments=("--method", "magic"))
        self.expect_refused(2, "two methods", arguments=("--compare", "transport"))
        self.expect_refused(2, "two different methods", arguments=("--compare", "grid,grid"))
        self.expect_refused(2, "not a method", arguments=("--compare", "grid,magic"))

    def test_a_density_without_a_finite_integral(self):
        self.serve("improper")
        self.edit('name = "forward"', 'name = "posterior"\nkind = "density"\nconfig = { shape = "SHAPE" }')
        self.set_observations()
        last = "SHAPE"
        for shape, way in (("flat", " b "), ("rising", "growing a "), ("heavy", "1/distance^2"), ("growing", "")):
            self.edit(f'"{last}"', f'"{shape}"')
            last = shape
            with self.subTest(shape=shape):
                before = self.server_calls().get("/Evaluate", 0)
                self.expect_refused(6, "the density has no finite integral", way, "proper prior")
                self.assertLess(self.server_calls()["/Evaluate"] - before, 4000)

    def interrupted(self, more):
        """What a run says that is interrupted while it waits for what comes after `more` answers; and how many of those are kept."""
        self.ask_server("/Good", {"more": more})
        process = subprocess.Popen([KNOTHE, "infer", self.project_name], cwd=self.folder, stderr=subprocess.PIPE, text=True)
        while self.server_calls()["held"] == 0 and process.poll() is None:
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)  # a tenth of the time that the held request may take
        self.assertEqual(process.returncode, 130, err)
        found = re.search(r"interrupted; .*; (\d+) calls of the model are kept in results/evaluations.jsonl: the same command goes on", err)
        self.assertIsNotNone(found, err)
        return err, int(found.group(1))

    def test_an_interrupted_run_goes_on_where_it_was(self):
        self.serve("linear", "hold")
        self.edit("timeout = 20", "timeout = 600")
        self.edit('name = "forward"', 'name = "forward"\nconnections = 8\nconfig = { note = "one" }')
        self.edit('kind = "transport"', 'kind = "transport"\nmode_search = "multi-start"')
        _, kept = self.interrupted(600)
        self.assertTrue(0 < kept <= 600, kept)
        self.edit('"one"', '"two"')
        self.assertIn("not used: they are of another model or another configuration", self.interrupted(300)[0])
        self.edit('"two"', '"one"')
        _, kept = self.interrupted(600)
        err, more = self.interrupted(300)
        self.assertIn(f"going on from {kept} calls of a run that did not end", err)
        self.assertTrue(kept < more <= kept + 300, (kept, more))
        self.ask_server("/Good", {"more": 10**9})
        line = self.infer()
        self.assertTrue(line["trusted"], line["verdict"])
        again, self.project_name = self.project_name, "whole.toml"
        self.project.write_text((self.folder / again).read_text())
        whole = self.infer("-o", "whole")
        self.assertEqual(line["model_evaluations"], whole["model_evaluations"] - more + 3, (kept, more))  # three to see that it is the same model
        self.expect_nothing_but(self.folder / "results", ["inference.json", "map.h5", "samples.nc"])

    def expect_the_rest_is_paid_alone(self, kept):
        """The same command, of a server that is well again, pays for what is not kept."""
        self.ask_server("/Good", {"more": 10**9})
        before = self.server_calls()
        line = self.infer()
        said, after = line["model_calls"], self.server_calls()
        self.assertEqual(said["gradient"], after["/Gradient"] - before["/Gradient"])
        self.project_name, first = "whole.toml", self.project_name
        self.project.write_text((self.folder / first).read_text())
        whole = self.infer("-o", "whole")
        self.assertEqual(whole["mean"], line["mean"])
        total = sum(whole["model_calls"].values()) - sum(said.values())
        self.assertTrue(kept - 3 <= total <= kept + 1, (kept, total))
        self.expect_nothing_but(self.folder / "results", ["inference.json", "map.h5", "samples.nc"])

    def test_what_a_failing_server_has_answered_is_kept(self):
        self.serve("linear+gradient", "error", 500)
        self.edit('kind = "transport"', 'kind = "transport"\nmode_search = "multi-start"')
        outcome = self.expect(4, "infer", self.project_name)
        self.assertIn("the mesh is inverted at element 17", outcome.err)
        self.assertIn("500 calls of the model are kept in results/evaluations.jsonl: the same command goes on from there", outcome.err)
        self.expect_the_rest_is_paid_alone(500)

    def test_what_was_answered_before_a_kill_is_kept(self):
        self.serve("linear+gradient", "hold", 500)
        self.edit("timeout = 20", "timeout = 600")
        self.edit('kind = "transport"', 'kind = "transport"\nmode_search = "multi-start"')
        process = subprocess.Popen([KNOTHE, "infer", self.project_name], cwd=self.folder, stderr=subprocess.PIPE, text=True)
        while self.server_calls()["held"] == 0:
            time.sleep(0.05)
        process.kill()
        process.communicate()
        journal = self.folder / "results" / "evaluations.jsonl"
        self.assertEqual(len(journal.read_text().splitlines()), 1 + 500)
        with journal.open("a") as file:
            file.write('["evaluate",[0.1,')  # torn
        self.expect_the_rest_is_paid_alone(500)


if __name__ == "__main__":
    unittest.main()
