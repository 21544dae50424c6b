"""Measurements as laboratories and their programs write them: read for what they are, or refused in words; absent is never a number."""
import subprocess
import unittest

from support import Case, python_with, read_csv, write_csv

# data.h5 again, once packed or with fill values as netCDF4 and xarray write them, once with NaN for what is missing.
PACK = """
import shutil, sys
import h5py, numpy
kind = sys.argv[1]
for name in ("packed.h5", "plain.h5"):
    shutil.copy("data.h5", name)
with h5py.File("data.h5") as file:
    values = file["values"][:]
values[2, 3] = values[1, 0] = numpy.nan
packed, attributes = values.copy(), {}
if kind == "packed":
    scale = numpy.nanmax(abs(values)) / 32000
    packed = numpy.where(numpy.isnan(values), -32768, numpy.round(values / scale)).astype("i2")
    values = numpy.where(numpy.isnan(values), numpy.nan, packed * scale)
    attributes = {"scale_factor": scale, "add_offset": 0.0, "_FillValue": numpy.int16(-32768)}
else:
    fill = {"_FillValue": 9.969209968386869e36, "missing_value": -9999.0}[kind]
    packed[numpy.isnan(values)] = fill
    attributes = {kind: fill}
for name, content, given in (("packed.h5", packed, attributes), ("plain.h5", values, {})):
    with h5py.File(name, "a") as file:
        units = file["values"].attrs["units"]
        del file["values"]
        file["values"] = content
        file["values"].attrs.update({"units": units, **given})
"""

HOURS = """
import sys
import h5py
with h5py.File("data.h5", "a") as file:
    file["time"][...] = file["time"][:] / float(sys.argv[2])
    file["time"].attrs["units"] = sys.argv[1]
"""


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def setUp(self):
        super().setUp()
        self.own_copy("data.h5")
        self.table = (self.folder / "data.csv").read_text()
        self.name = "data.h5"

    def use(self, name):
        self.edit(f'data = "{self.name}"', f'data = "{name}"')
        self.name = name

    def results(self, name, content=None):
        if content is not None:
            (self.folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        self.use(name)
        return [(line["mean"], line["log_evidence"]) for line in self.assimilate()]

    def expect_same(self, one, other, delta=0.0):
        self.assertEqual(len(one), len(other))
        for (mean, evidence), (other_mean, other_evidence) in zip(one, other):
            for a, b in zip([*mean, evidence], [*other_mean, other_evidence]):
                self.assertAlmostEqual(a, b, delta=delta * max(1, abs(b)))

    def refused(self, name, content, *texts):
        (self.folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        self.use(name)
        self.expect(4, "assimilate", self.project_name, stderr=[name, *texts])

    def test_separators_and_decimal_commas(self):
        as_it_was = self.results("exact.csv", self.table)
        semicolons = self.table.replace(",", ";")
        for name, content in (("semicolons.csv", semicolons), ("commas.csv", semicolons.replace(".", ",")),
                              ("tabs.csv", self.table.replace(",", "\t")), ("tabs_commas.csv", self.table.replace(",", "\t").replace(".", ",")),
                              ("excel.csv", "sep=,\n" + self.table), ("excel_semicolons.csv", "sep=;\r\n" + semicolons.replace("\n", "\r\n"))):
            self.expect_same(self.results(name, content), as_it_was)

    def test_line_ends_empty_rows_and_empty_columns(self):
        as_it_was = self.results("exact.csv", self.table)
        header, *rows = self.table.splitlines()
        for name, content in (("cr.csv", self.table.replace("\n", "\r")), ("crlf.csv", self.table.replace("\n", "\r\n")),
                              ("rows.csv", self.table + ",,,,,,,\n,,,,,,,\n\n"),
                              ("columns.csv", "\n".join(line + ",," for line in [header, *rows]) + "\n"),
                              ("CAPITALS.CSV", self.table), ("bom.csv", b"\xef\xbb\xbf" + self.table.encode())):
            self.expect_same(self.results(name, content), as_it_was)

    def test_what_is_damaged_or_no_table_is_told(self):
        self.refused("utf16.csv", self.table.encode("utf-16"), "1:1: error: the file is UTF-16: save as UTF-8")
        lines = len(self.table.splitlines())
        self.refused("nul.csv", self.table.encode() + 300 * b"\0", f"nul.csv:{lines + 1}:1: error: NUL bytes", "the file is damaged")
        self.refused("data.txt", self.table, "measurements are read from .csv and HDF5")
        header, *rows = self.table.splitlines()
        self.refused("unnamed.csv", "\n".join([header.replace(",x,", ",,")] + rows), "1:13: error: a column without a name")
        fields = header.split(",")
        capital = [row.split(",") for row in rows]
        for row in capital:
            row[fields.index("component")] = row[fields.index("component")].upper()
        self.refused("capital.csv", "\n".join([header, *map(",".join, capital)]), "x, y or z, or a series of the model (did you mean ")

    def test_times_that_differ_by_rounding_are_one_step(self):
        as_it_was = self.results("exact.csv", self.table)
        rows = read_csv(self.folder / "exact.csv")
        for k, row in enumerate(rows):
            row["time"] = repr(float(row["time"]) + (k % 3) * 1e-10)
        write_csv(self.folder / "jitter.csv", rows)
        self.expect_same(self.results("jitter.csv"), as_it_was, 1e-9)

    def test_a_number_that_stands_for_no_reading_is_named(self):
        rows = read_csv(self.folder / "data.csv")
        for sentinel in ("1e99", "-9999"):
            changed = [dict(row) for row in rows]
            changed[30]["value"] = sentinel
            write_csv(self.folder / "sentinel.csv", changed)
            self.use("sentinel.csv")
            self.expect(4, "assimilate", self.project_name, stderr=["sentinel.csv: time ", "is " + ("1e+99" if sentinel == "1e99" else sentinel), "Leave such fields empty"])

    def test_fill_values_and_packed_numbers_of_hdf5(self):
        python = python_with("h5py", "numpy")
        if python is None:
            self.skipTest("no python3 with h5py here")
        for kind in ("_FillValue", "missing_value", "packed"):
            subprocess.run([python, "-c", PACK, kind], cwd=self.folder, check=True, timeout=120)
            plain = self.results("plain.h5")
            self.expect_same(self.results("packed.h5"), plain)
            self.use("data.h5")

    def test_units_of_time_are_known_or_refused(self):
        python = python_with("h5py", "numpy")
        if python is None:
            self.skipTest("no python3 with h5py here")
        as_it_was = self.results("data.h5")
        for unit, of_before in (("hours", 3600.0), ("us", 1e-6 / 3600)):
            subprocess.run([python, "-c", HOURS, unit, str(of_before)], cwd=self.folder, check=True, timeout=120)
            self.expect_same(self.results("data.h5"), as_it_was, 1e-9)
        subprocess.run([python, "-c", HOURS, "fortnights", "1"], cwd=self.folder, check=True, timeout=120)
        self.expect(4, "assimilate", self.project_name, stderr=['units of time is "fortnights", which is not known', "give s, ms, us, min, h or d"])


if __name__ == "__main__":
    unittest.main()
