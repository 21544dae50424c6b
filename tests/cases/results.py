"""RESULTS/ and what is made of it: posterior.nc, summary.json, fields, the forecast from it, the report."""
import datetime
import json
import re
import shutil
import unittest
import xml.etree.ElementTree

from support import Case, parse_line


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def setUp(self):
        super().setUp()
        self.lines = self.assimilate()
        self.results = self.folder / "results"

    def test_the_folder_holds_what_the_interface_says_and_no_partial_file(self):
        self.expect_nothing_but(self.results, ["fields", "posterior.nc", "steps.jsonl", "summary.json"])
        self.expect_nothing_but(self.results / "fields", ["posterior.pvd"] + [f"step_{i:04}.vtu" for i in range(12)])

    def test_the_steps_are_the_lines_that_were_printed(self):
        kept = [parse_line(line) for line in (self.results / "steps.jsonl").read_text().splitlines()]
        self.assertEqual([k["mean"] for k in kept], [line["mean"] for line in self.lines])
        for stored, line in zip(kept, self.lines):
            self.assertTrue(set(line) <= set(stored))

    def test_the_summary_says_what_was_done(self):
        summary = parse_line((self.results / "summary.json").read_text())
        self.assertEqual(summary["project"], self.project.read_text())
        self.assertEqual((summary["steps"], summary["method"], summary["form"], summary["seed"]), (12, "transport", "collapsed", 1))
        self.assertEqual([(p["name"], p["truth"]) for p in summary["parameters"]], [("Y0", 1.05), ("Ad", 0.9)])
        self.assertRegex(summary["created_by"], r"knothe \d")

    def test_the_posterior_is_hdf5_with_the_groups_of_arviz(self):
        content = (self.results / "posterior.nc").read_bytes()
        self.assertEqual(content[:8], b"\x89HDF\r\n\x1a\n")
        for group in (b"posterior", b"posterior_predictive", b"observed_data", b"sample_stats", b"history", b"DIMENSION_LIST"):
            self.assertIn(group, content)

    def test_the_fields_are_xml_and_listed_with_their_times(self):
        series = xml.etree.ElementTree.parse(self.results / "fields" / "posterior.pvd").getroot()
        entries = series.findall(".//DataSet")
        self.assertEqual([float(e.get("timestep")) for e in entries], [line["time"] for line in self.lines])
        for entry in entries:
            content = (self.results / "fields" / entry.get("file")).read_bytes()
            head, mark, _ = content.partition(b"<AppendedData")
            root = xml.etree.ElementTree.fromstring(head + b"</VTKFile>" if mark else content)
            names = [array.get("Name") for array in root.findall(".//PointData/DataArray")]
            self.assertEqual(names, ["displacement_mean", "displacement_std"])

    def test_the_fields_say_their_unit_and_time(self):
        for step, line in enumerate(self.lines):
            content = (self.results / "fields" / f"step_{step:04}.vtu").read_bytes()
            root = xml.etree.ElementTree.fromstring(content.partition(b"<AppendedData")[0] + b"</VTKFile>")
            (time,) = root.findall(".//FieldData/DataArray[@Name='TimeValue']")
            self.assertEqual(float(time.text), line["time"])
            keys = root.findall(".//PointData/DataArray/InformationKey[@name='UNITS_LABEL']")
            self.assertEqual([key.text for key in keys], ["m", "m"])

    def test_lines_name_their_parameters_with_physical_values_and_the_wall_clock(self):
        before = datetime.datetime.fromisoformat("2026-01-01T00:00:00+00:00")
        for line in self.lines:
            self.assertEqual(line["parameters"], ["Y0", "Ad"])
            for k, name in enumerate(line["parameters"]):
                physical, reference = line["physical"][name], (216.0, 2.25e-3)[k]
                self.assertEqual(list(physical), ["mean", "std"])  # this model does not say the unit of its references
                self.assertAlmostEqual(physical["mean"] / reference, line["mean"][k], places=12)
                self.assertAlmostEqual((physical["std"] / reference) ** 2, line["covariance"][k][k], places=12)
            self.assertRegex(line["wall_clock"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")
            self.assertGreater(datetime.datetime.fromisoformat(line["wall_clock"].replace("Z", "+00:00")), before)
            for forecast, horizon, threshold in (("force", 0.75, 1150.0), ("deflection", 1.0, -3.7e-4)):
                f = line["forecast"][forecast]
                self.assertEqual((f["horizon"], f["threshold"], f["past"]), (horizon, threshold, horizon < line["time"]))
                self.assertAlmostEqual(f["probability_above_threshold"] + f["probability_below_threshold"], 1, places=12)

    def test_the_console_has_digits_enough_and_says_what_a_forecast_is_for(self):
        out = self.expect(0, "forecast", self.project_name).out
        self.assertRegex(out, r"after step 11 \(at 0\.4 mm\)\n  force at 0\.3 mm \(past: an estimate, not a forecast\): \d+\.?\d* ± \d[\d.]* N, most probable .*; threshold 1150 N: P\(above\) .* %, P\(below\) .* %")
        self.assertRegex(out, r"deflection at 0\.4 mm: −0\.\d{4,} ± 0\.0*[1-9]\d? mm, .*threshold −0\.37 mm: P\(above\)")
        self.assertNotRegex(out, r"e-\d")
        table = self.expect(0, "assimilate", self.project_name).out
        self.assertRegex(table, r"step  11  Y0 1\.\d+ ± 0\.\d+ .*force [\d.]+ ± [\d.]+ N")

    def test_a_forecast_from_the_results_is_the_last_steps(self):
        (line,) = self.expect(0, "forecast", self.project_name, "--json").lines()
        self.assertEqual((line["step"], line["time"]), (11, 1.0))
        for name, forecast in self.lines[-1]["forecast"].items():
            for key in ("mean", "std"):
                self.assertAlmostEqual(line["forecast"][name][key], forecast[key], delta=1e-9 * abs(forecast["mean"]))

    def test_a_forecast_before_any_assimilation_says_what_to_do(self):
        shutil.rmtree(self.results)
        self.expect(4, "forecast", self.project_name, "--json", stderr="posterior.nc")

    def test_a_forecast_of_a_quantity_that_the_model_lacks_names_it(self):
        self.edit('output = "reaction_force"', 'output = "reaction_fource"')
        for command in ("forecast", "assimilate"):
            self.expect(4, command, self.project_name, "--json",
                        stderr=["model.h5", "forecast.force", '"reaction_fource"', 'did you mean "reaction_force"?'])

    def test_a_crack_length_of_a_model_without_crack_solutions_is_refused(self):
        with open(self.project, "a") as project:
            project.write('\n[forecast.crack]\nquantity = "crack_length"\nhorizon = 0.5\nprior = { mean = 0.04, std = 0.013 }\n')
        self.expect(4, "assimilate", self.project_name, "--json",
                    stderr=["model.h5", "forecast.crack", "needs crack solutions", "offline.crack_lengths"])

    def test_a_horizon_behind_the_models_last_time_is_refused(self):
        self.edit("horizon = 0.75", "horizon = 1.75")
        self.expect(3, "assimilate", self.project_name, "--json",
                    stderr=[f"assimilation.toml:{self.position_of('[forecast.force]')}: error: ", "1.75"])

    def test_the_report_is_one_page_that_needs_nothing_else(self):
        self.expect(0, "report", "results", "-o", "report.html")
        page = (self.folder / "report.html").read_text()
        self.assertTrue(page.lstrip().lower().startswith("<!doctype html>"))
        self.assertTrue(page.rstrip().endswith("</html>"))
        self.assertIn("<svg", page)
        references = re.findall(r"""(?:src|href)\s*=\s*["']?([^"'\s>]+)""", page) + re.findall(r"""url\(["']?([^"')]+)""", page)
        outside = [r for r in references if not r.startswith(("#", "data:"))]
        self.assertEqual(outside, [])
        self.assertNotIn("@import", page)
        for word in ("Y0", "Ad", "force", "deflection"):
            self.assertIn(word, page)

    def test_the_report_finds_the_model_from_another_folder_and_after_both_were_moved(self):
        self.own_copy("model.h5")
        self.assimilate()
        self.expect(0, "report", "results", "-o", "report.html")
        page = (self.folder / "report.html").read_text()
        self.assertIn("Separated in the tree form", page)
        moved, elsewhere = self.folder / "moved", self.folder / "elsewhere"
        moved.mkdir(), elsewhere.mkdir()
        for name in ("results", "model.h5"):
            shutil.move(self.folder / name, moved / name)
        self.expect(0, "report", moved / "results", "-o", "again.html", cwd=elsewhere)
        self.assertEqual((elsewhere / "again.html").read_text(), page)

    def test_a_report_of_an_empty_folder_is_refused(self):
        (self.folder / "empty").mkdir()
        self.expect(4, "report", "empty", "-o", "report.html", stderr="empty")
        self.assertFalse((self.folder / "report.html").exists())

    def test_a_report_of_spoilt_steps_names_the_file(self):
        steps = self.results / "steps.jsonl"
        steps.write_text(steps.read_text()[:-40])
        self.expect(4, "report", "results", "-o", "report.html", stderr="steps.jsonl")
        self.assertFalse((self.folder / "report.html").exists())

    def test_the_report_of_a_second_run_differs_in_times_only(self):
        summary = json.loads((self.results / "summary.json").read_text())
        self.assimilate("-o", "again")
        again = json.loads((self.folder / "again" / "summary.json").read_text())
        for key in summary:
            if key != "elapsed_s":
                self.assertEqual(again[key], summary[key], key)


if __name__ == "__main__":
    unittest.main()
