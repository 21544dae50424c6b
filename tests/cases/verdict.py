"""The verdict: what is said of data that are wrong, where, and with which exit status; `knothe check` before that."""
import json
import unittest

from support import Case, parse_line, read_csv, write_csv

KEYS = ["level", "reasons", "model_shift_std", "fit_probability", "edge_mass"]


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def use(self, change):
        """The fixture's data, each row changed by `change`."""
        rows = read_csv(self.folder / "data.csv")
        (self.folder / "data.csv").unlink()
        for row in rows:
            change(row)
        write_csv(self.folder / "data.csv", rows)
        self.edit('data = "data.h5"', 'data = "data.csv"')

    def verdict(self, status):
        """Of the run: in the last line, in summary.json, and in words on the console."""
        lines = self.expect(status, "assimilate", self.project_name, "--json").lines()
        run = lines[-1]["verdict"]
        self.assertEqual(json.loads((self.folder / "results" / "summary.json").read_text())["verdict"], run)
        for line in lines:
            self.assertEqual(list(line["verdict"]), KEYS)
            for reason in line["verdict"]["reasons"]:
                self.assertEqual([key for key in reason if key != "cause"], ["code", "level", "value", "limit", "message"])
        text = self.expect(status, "assimilate", self.project_name).out
        self.assertIn(f"verdict: {run['level']}", text)
        return run

    def test_right_data_are_ok(self):
        run = self.verdict(0)
        self.assertEqual((run["level"], run["reasons"]), ("ok", []))
        self.assertEqual(len(run["edge_mass"]), 2)
        self.assertTrue(1e-4 < run["fit_probability"] <= 1)

    def test_a_sign_that_is_turned_is_rejected_and_named(self):
        def turn(row):
            if row["component"] == "y":
                row["value"] = repr(-float(row["value"]))
        self.use(turn)
        run = self.verdict(8)
        self.assertEqual(run["level"], "reject")
        fit = [reason for reason in run["reasons"] if reason["code"] == "fit"]
        self.assertEqual(fit[0]["cause"], "sign")
        self.assertIn("displacements along y look like the model's times −1: check the sign of the y axis", fit[0]["message"])
        self.expect(0, "report", "results", "-o", "report.html")
        page = (self.folder / "report.html").read_text()
        self.assertIn("Verdict", page)
        self.assertIn("check the sign of the y axis", page)
        # No number looks as if it could be used, wherever it is said.
        self.assertIn('class="scroll demoted rejected"', page)
        for text in (self.expect(8, "assimilate", self.project_name).out, self.expect(0, "forecast", self.project_name).out):
            self.assertRegex(text, r"(?m)^ *force at .* \(do not use\)$")
            self.assertNotIn("99.9 %", text)
            self.assertIn("Result: do not use (verdict: reject)", text)

    def test_millimetres_are_rejected_and_named(self):
        self.use(lambda row: row.update(value=repr(1e3 * float(row["value"]))))
        run = self.verdict(8)
        self.assertEqual(run["reasons"][0]["cause"], "scale")
        self.assertIn("times 10^3: check their unit", run["reasons"][0]["message"])

    def test_one_value_of_a_metre_is_named(self):
        rows = iter(range(10**6))
        self.use(lambda row: row.update(value="1.0") if next(rows) == 24 * 3 + 7 else None)
        run = self.verdict(8)
        self.assertEqual(run["reasons"][0]["cause"], "single_sensor")
        self.assertIn("one value of sensor 7", run["reasons"][0]["message"])
        self.assertIn("at step 3", run["reasons"][0]["message"])

    def test_the_console_tells_where_the_verdict_changes(self):
        rows = iter(range(10**6))
        self.use(lambda row: row.update(value="1.0") if next(rows) == 24 * 3 + 7 else None)
        message = self.expect(8, "assimilate", self.project_name).err
        self.assertIn("step 3: Result: do not use (verdict: reject)", message)

    def test_check_opens_model_and_data(self):
        out = self.expect(0, "check", self.project_name).out
        self.assertIn("model: 2 parameters, 12 times", out)
        self.assertIn("data: 24 sensors at 12 times, inside the model", out)
        self.assertIn("Y0: the data can narrow its prior by a factor of about ", out)
        self.assertTrue(out.endswith("assimilation.toml: valid\n"), out)

    def test_check_of_files_that_are_not_there_is_of_the_syntax_only(self):
        (self.folder / "data.h5").unlink()
        out = self.expect(0, "check", self.project_name).out
        self.assertIn("valid, syntax only: ", out)
        self.assertIn("data.h5 is missing so far", out)

    def test_check_compares_the_size_of_the_data_with_the_models(self):
        self.use(lambda row: row.update(value=repr(1e3 * float(row["value"]))))
        message = self.expect(0, "check", self.project_name).err
        self.assertIn("warning: the largest of the displacements along x (m) is ", message)
        self.assertIn("check the unit (a factor of ", message)

    def test_check_tells_what_the_data_say_nothing_of(self):
        self.use(lambda row: row.update(std="1.0"))
        message = self.expect(0, "check", self.project_name).err
        self.assertIn("warning: the data carry almost no information on Y0", message)

    def test_check_finds_what_assimilate_would_refuse(self):
        self.edit("horizon = 0.75", "horizon = 2.5")
        self.expect(3, "check", self.project_name, stderr=["horizon", "2.5"])


if __name__ == "__main__":
    unittest.main()
