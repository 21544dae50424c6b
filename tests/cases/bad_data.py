"""Measurements that do not fit the model, or are not there: exit status 4, the observation named; missing values are no error."""
import shutil
import unittest

from support import Case, read_csv, replace_number, without_times, write_csv


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def setUp(self):
        super().setUp()
        self.rows = read_csv(self.folder / "data.csv")
        (self.folder / "data.csv").unlink()

    def of_step(self, step):
        """The rows of a step: the file is sorted by time, 24 sensors each."""
        return self.rows[24 * step:24 * step + 24]

    def use_csv(self):
        self.edit('data = "data.h5"', 'data = "data.csv"')
        write_csv(self.folder / "data.csv", self.rows)

    def expect_refused(self, *texts):
        self.expect(4, "assimilate", self.project_name, "--json", stderr=texts)
        self.assertFalse((self.folder / "results").exists())

    def test_missing_data_are_named(self):
        (self.folder / "data.h5").unlink()
        self.expect_refused("data.h5", "No such file")

    def test_truncated_data_are_told(self):
        data = self.own_copy("data.h5")
        data.write_bytes(data.read_bytes()[:-500])
        self.expect_refused("data.h5", "truncated")

    def test_nan_in_hdf5_data_is_a_missing_value_and_counted(self):
        data = self.own_copy("data.h5")
        for step, sensor in ((2, 5), (2, 7), (9, 0)):
            replace_number(data, float(self.of_step(step)[sensor]["value"]), float("nan"))
        missing = [line["missing"] for line in self.assimilate()]
        self.assertEqual(missing, [0, 0, 2, 0, 0, 0, 0, 0, 0, 1, 0, 0])

    def test_used_missing_and_rejected_add_up(self):
        for row in self.of_step(0):
            row["value"] = "nan"
        self.of_step(4)[3]["value"] = ""
        self.use_csv()
        lines = self.assimilate()
        self.assertEqual([line["missing"] for line in lines], [24, 0, 0, 0, 1] + 7 * [0])
        for line in lines:
            self.assertEqual(line["used"] + line["rejected"] + line["missing"], 24)

    def test_a_row_left_out_of_csv_is_a_missing_value(self):
        del self.rows[24 * 6 + 10]
        self.use_csv()
        self.assertEqual([line["missing"] for line in self.assimilate()], 6 * [0] + [1] + 5 * [0])

    def test_a_step_without_any_value_changes_nothing(self):
        for row in self.of_step(5):
            row["value"] = "nan"
        self.use_csv()
        lines = self.assimilate()
        self.assertEqual(lines[5]["log_evidence_increment"], 0)
        sigma = lines[4]["covariance"][0][0] ** 0.5
        self.assertAlmostEqual(lines[5]["mean"][0], lines[4]["mean"][0], delta=0.02 * sigma)

    def test_infinity_is_refused_by_index(self):
        data = self.own_copy("data.h5")
        replace_number(data, float(self.of_step(3)[11]["value"]), float("inf"))
        self.expect_refused("data.h5", "values[3,11]", "infinite")

    def test_infinity_in_csv_is_refused_by_line(self):
        self.of_step(3)[11]["value"] = "inf"
        self.use_csv()
        self.expect_refused(f"data.csv:{24 * 3 + 11 + 2}:", "value")

    def test_a_word_for_a_number_in_csv_is_refused_by_line(self):
        self.of_step(1)[2]["x"] = "left"
        self.use_csv()
        self.expect_refused(f"data.csv:{24 + 2 + 2}:", "left")

    def test_a_negative_standard_deviation_is_refused(self):
        for row in self.rows:
            row["std"] = "-1e-6"
        self.use_csv()
        self.expect_refused("data.csv:2:", "standard deviation is positive")

    def test_a_missing_column_is_named(self):
        self.use_csv()
        text = (self.folder / "data.csv").read_text()
        (self.folder / "data.csv").write_text(text.replace("component", "direction", 1))
        self.expect_refused("data.csv", "component")

    def test_a_point_outside_the_mesh_names_the_observation(self):
        for row in self.rows[7::24]:
            row["x"] = "0.5"
        self.use_csv()
        self.expect_refused("observation 7", "(0.5,", "outside the mesh")

    def test_a_point_at_no_dof_of_a_model_without_mesh_names_the_observation(self):
        self.own_copy("model.h5")
        self.expect(0, "model", "import", "without_mesh.h5", "-o", "model.h5", "--tolerance", "1e-9")
        for row in self.rows[7::24]:
            row["x"] = "0.01"
        self.use_csv()
        self.expect_refused("observation 7", "(0.01,", "no mesh", "nearest dof")

    def test_a_point_between_nodes_is_interpolated(self):
        for row in self.rows[7::24]:
            row["x"], row["y"], row["z"] = "0.01", "0.02", "0.03"
        self.use_csv()
        # Its values are those of another point, which the verdict sees.
        lines = self.assimilate(status=8)
        self.assertEqual([line["used"] for line in lines], 12 * [24])
        self.assertIn("sensor 7 (y at 0.01, 0.02, 0.03 m) does not fit", lines[-1]["verdict"]["reasons"][0]["message"])

    def test_a_time_that_is_not_the_models_is_refused_by_index(self):
        for row in self.of_step(4):
            row["time"] = "0.42"
        self.use_csv()
        self.expect_refused("data.csv", "time[4] = 0.42", "not a time of the model", "0.41666")

    def test_a_subset_of_the_times_counts_its_steps_from_zero(self):
        self.rows = self.of_step(3) + self.of_step(8)
        self.use_csv()
        lines = self.assimilate()
        self.assertEqual([line["step"] for line in lines], [0, 1])
        self.assertEqual([line["time"] for line in lines], [4 / 12, 9 / 12])

    def test_rows_of_csv_may_come_in_any_order_of_time(self):
        self.use_csv()
        sorted_lines = self.assimilate()
        self.rows = [row for step in reversed(range(12)) for row in self.of_step(step)]
        write_csv(self.folder / "data.csv", self.rows)
        self.assertEqual(without_times(self.assimilate()), without_times(sorted_lines))

    def test_csv_and_hdf5_give_the_same_posterior(self):
        from_hdf5 = self.assimilate()
        self.use_csv()
        self.assertEqual(without_times(self.assimilate()), without_times(from_hdf5))

    def test_a_model_file_is_not_data(self):
        (self.folder / "data.h5").unlink()
        shutil.copy(self.folder / "model.h5", self.folder / "data.h5")
        self.expect_refused("data.h5", "/values")


if __name__ == "__main__":
    unittest.main()
