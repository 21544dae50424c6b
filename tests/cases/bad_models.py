"""Model and snapshot files that are missing, damaged or of another kind: exit status 4, file and data set named."""
import os
import shutil
import struct
import unittest

import analytic_model
from support import Case, replace_number


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def expect_refused(self, *texts):
        self.expect(4, "model", "info", "model.h5", stderr=["model.h5", *texts])
        self.expect(4, "assimilate", self.project_name, stderr=["model.h5", *texts])
        self.assertFalse((self.folder / "results").exists())

    def expect_import_refused(self, *texts):
        self.expect(4, "model", "import", "snapshots.h5", "-o", "new.h5", stderr=["snapshots.h5", *texts])
        self.assertFalse((self.folder / "new.h5").exists())

    def test_a_missing_model_is_named(self):
        (self.folder / "model.h5").unlink()
        self.expect_refused("there is no such model: `knothe offline PROJECT.toml -o")

    def test_a_pipe_in_the_place_of_a_model_is_not_waited_for(self):
        (self.folder / "model.h5").unlink()
        os.mkfifo(self.folder / "model.h5")
        self.expect_refused("is a pipe or device, an HDF5 file is needed")

    def test_a_file_that_is_not_hdf5_is_told(self):
        (self.folder / "model.h5").unlink()
        (self.folder / "model.h5").write_text("a model, surely\n")
        self.expect_refused("HDF5")

    def test_a_truncated_model_is_told(self):
        model = self.own_copy("model.h5")
        content = model.read_bytes()
        for kept in (len(content) - 1, len(content) // 2, 200):
            with self.subTest(kept=kept):
                model.write_bytes(content[:kept])
                self.expect_refused("truncated")

    def test_a_model_of_another_schema_is_told(self):
        (self.folder / "model.h5").unlink()
        shutil.copy(self.folder / "other_schema.h5", self.folder / "model.h5")
        self.expect_refused("schema_version is 2", "reads 1", "use a newer knothe")

    def test_snapshots_are_not_a_model_and_the_message_says_what_to_do(self):
        (self.folder / "model.h5").unlink()
        shutil.copy(self.folder / "snapshots.h5", self.folder / "model.h5")
        self.expect_refused("schema_version", "knothe model import")

    def test_a_parameter_axis_that_does_not_increase_is_refused(self):
        replace_number_of_axis(self.own_copy("snapshots.h5"), 3, analytic_model.node(2))
        self.expect_import_refused("/parameters/Y0", "not strictly increasing")

    def test_nan_in_the_snapshots_is_refused_by_full_index(self):
        y0, ad, step, dof = 1, 2, 3, 128  # a z displacement on the outer face: no other is the same
        value = self.snapshot(y0, ad, step, dof)
        replace_number(self.own_copy("snapshots.h5"), value, float("nan"))
        self.expect_import_refused(f"snapshots[{y0},{ad},{step},{dof}]")

    def test_infinity_in_the_snapshots_is_refused_by_full_index(self):
        value = self.snapshot(6, 0, 10, 143)
        replace_number(self.own_copy("snapshots.h5"), value, float("inf"))
        self.expect_import_refused("snapshots[6,0,10,143]")

    def test_nan_in_a_model_is_refused_by_data_set(self):
        model = self.own_copy("model.h5")
        time = analytic_model.time(4)
        replace_number(model, time, float("nan"))
        self.expect_refused("time[4]")

    def test_a_number_that_was_changed_is_seen_by_the_seal(self):
        model = self.own_copy("model.h5")
        replace_number(model, analytic_model.time(4), analytic_model.time(4) + 1e-3)
        self.expect_refused("its bytes are not those that were written", "tail -c +513")
        content = model.read_bytes()
        model.write_bytes(content[512:])  # so be it
        self.expect(0, "model", "info", "model.h5")
        self.assertIn(b"HDF", content[512:520])

    def test_truncated_snapshots_are_told(self):
        snapshots = self.own_copy("snapshots.h5")
        snapshots.write_bytes(snapshots.read_bytes()[:-1000])
        self.expect_import_refused("truncated")

    def test_a_model_is_not_snapshots(self):
        shutil.copy(self.folder / "model.h5", self.folder / "m.h5")
        self.expect(4, "model", "import", "m.h5", "-o", "new.h5", stderr=["m.h5", "/snapshots"])

    def test_a_parameter_that_the_model_lacks_is_the_project_files_error(self):
        self.edit("Ad = {", "A_d = {")
        self.expect(3, "assimilate", self.project_name, stderr=[f"assimilation.toml:{self.position_of('{ prior', 'A_d')}: error: ", '"A_d"', 'did you mean "Ad"?', "Y0, Ad"])

    def test_a_parameter_without_a_prior_is_asked_for(self):
        self.edit("Ad = {", "# Ad = {")
        self.expect(3, "assimilate", self.project_name, stderr=[f"assimilation.toml:{self.position_of('[parameters]')}: error: ", "lacks a prior", '"Ad"'])

    def test_a_prior_outside_the_models_box_is_refused(self):
        self.edit("mean = 0.9, std = 0.4472135954999579", "mean = 2.0, std = 0.1")
        self.expect(3, "assimilate", self.project_name, stderr=[f"assimilation.toml:{self.position_of('{ prior')}: error: ", '"Y0"', "[0.5, 1.5]", "1e-6"])

    def test_a_prior_with_little_but_enough_mass_in_the_box_is_taken(self):
        self.edit("mean = 0.9, std = 0.4472135954999579", "mean = 1.9, std = 0.1")
        lines = self.assimilate()
        self.assertTrue(all(1.3 < line["mean"][0] < 1.5 for line in lines))

    def snapshot(self, y0, ad, step, dof):
        """The stored number: Python and C++ may differ in the last bits, so its neighbours are looked for too."""
        c, point = analytic_model.dof(dof)
        exact = analytic_model.displacement(c, point, analytic_model.time(step), analytic_model.node(y0), analytic_model.node(ad))
        content = (self.folder / "snapshots.h5").read_bytes()
        (bits,) = struct.unpack("<q", struct.pack("<d", exact))
        for away in sorted(range(-64, 65), key=abs):
            near = struct.pack("<q", bits + away)
            if content.count(near) == 1:
                return struct.unpack("<d", near)[0]
        self.fail("the snapshot was not found")


def replace_number_of_axis(path, index, new):
    """Y0 and Ad have the same nodes; the first axis in the file is Y0's."""
    content = path.read_bytes()
    axis = struct.pack("<7d", *(0.5 + i / 6 for i in range(7)))
    start = content.index(axis) + 8 * index
    path.write_bytes(content[:start] + struct.pack("<d", new) + content[start + 8:])


if __name__ == "__main__":
    unittest.main()
