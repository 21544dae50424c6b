"""Pictures in `knothe simulate --images` and `knothe assimilate`: from drawn pictures to the posterior of the parameters that
drew them."""
import math
import struct
import unittest

from support import Case


def shift_picture(path, pixels):
    """Moves the content of an uncompressed TIFF of one channel to the right; the left border is repeated."""
    data = bytearray(path.read_bytes())
    order = "<" if data[:2] == b"II" else ">"
    at, = struct.unpack_from(order + "I", data, 4)
    tags = {}
    for k in range(struct.unpack_from(order + "H", data, at)[0]):
        tag, kind, count = struct.unpack_from(order + "HHI", data, at + 2 + 12 * k)
        size = {3: "H", 4: "I"}.get(kind)
        if size is None:
            continue
        place = at + 10 + 12 * k
        if count * struct.calcsize(size) > 4:
            place, = struct.unpack_from(order + "I", data, place)
        tags[tag] = struct.unpack_from(f"{order}{count}{size}", data, place)
    assert tags.get(259, (1,)) == (1,), "compressed"
    row = tags[256][0] * tags[258][0] // 8
    pixel = tags[258][0] // 8
    for offset, count in zip(tags[273], tags[279]):
        for start in range(offset, offset + count, row):
            line = data[start:start + row]
            data[start:start + row] = line[:pixel] * pixels + line[:-pixel * pixels]
    path.write_bytes(data)


class Test(Case):
    project_name = "picture_assimilation.toml"
    fixture = "analytic"

    def draw(self):
        self.expect(0, "simulate", self.project_name, "--model", "model.h5", "--images", "-o", "pictures")

    def test_pictures_are_drawn_with_their_times(self):
        self.draw()
        names = sorted(path.name for path in (self.folder / "pictures").iterdir())
        self.assertEqual(names[-2:], ["reference_1.tif", "reference_2.tif"])
        lines = (self.folder / "pictures" / "pictures.csv").read_text().splitlines()
        self.assertEqual(lines[0], "time,file")
        self.assertEqual([line.split(",")[1] for line in lines[1:]], [n for n in names if n.startswith("picture_")])

    def test_the_posterior_covers_the_parameters_that_drew_them(self):
        self.draw()
        lines = self.assimilate()
        last = lines[-1]
        truth = [1.06, 0.96]
        for k in range(2):
            self.assertLess(abs(last["mean"][k] - truth[k]), 3.3 * math.sqrt(last["covariance"][k][k]), last)
            self.assertLess(last["covariance"][k][k], 0.5 * lines[0]["covariance"][k][k])
        for line in lines:
            self.assertEqual(line["missing"], 0)
            self.assertIs(line["picture"]["missing"], False)
            self.assertTrue({"correlation", "precision", "update", "forecast", "total"} <= set(line["elapsed_us"]))
        self.assertTrue((self.folder / "results" / "displacements.h5").exists())

    def test_displacements_first_and_then_the_posterior_give_the_same(self):
        """`knothe dic -o u.h5` and assimilating that file, against pictures straight away: one noise, known from two references.
        Searches begin at other displacements (the model's, the last picture's): the iteration goes on to 1e-5 px."""
        self.edit('mesh = "model"', 'mesh = "model"\ntolerance = 1e-5')
        self.draw()
        at_once = self.assimilate()
        self.expect(0, "dic", self.project_name, "-o", "u.h5")
        self.edit('pictures = "pictures/"', 'file = "u.h5"')
        for one, other in zip(at_once, self.assimilate()):
            for k in range(2):
                self.assertAlmostEqual(one["mean"][k], other["mean"][k], delta=1e-6)

    def test_a_camera_that_moves_is_taken_out(self):
        """Every other picture is taken by a camera that stands a pixel further left."""
        self.draw()
        for path in sorted((self.folder / "pictures").glob("picture_*.tif"))[1::2]:
            shift_picture(path, 1)
        truth = [1.06, 0.96]

        def worst(lines):
            return max(abs(lines[-1]["mean"][k] - truth[k]) / math.sqrt(lines[-1]["covariance"][k][k]) for k in range(2))

        still = worst(self.assimilate(status=8))
        self.edit('mesh = "model"', 'mesh = "model"\ndrift = "rigid"')
        lines = self.assimilate()
        self.assertEqual([line["missing"] for line in lines], [0] * len(lines))
        self.assertLess(worst(lines), 3.5)
        self.assertGreater(still, 10)
        at_once = lines[-1]["mean"]
        self.expect(0, "dic", self.project_name, "-o", "u.h5")
        self.edit('pictures = "pictures/"', 'file = "u.h5"')
        for k, mean in enumerate(self.assimilate()[-1]["mean"]):
            self.assertAlmostEqual(mean, at_once[k], delta=1e-6)

    def test_the_outline_of_the_model_tells_where_the_picture_is(self):
        """Begun 1 % and some pixels off, or with nothing given: the same posterior as with the scale it was drawn with."""
        self.draw()
        exact = self.assimilate()[-1]
        for start in ("scale = 4.04e-4\norigin = [325, 274]", ""):
            self.edit('scale = 4e-4\norigin = [320, 270]', f'registration = "outline"\n{start}')
            outcome = self.expect(0, "dic", self.project_name, "--maps", "maps", "--table", "table.txt",
                                  stderr="registered by the outline: 0.")
            self.assertEqual((self.folder / "maps" / "registration.png").read_bytes()[:4], b"\x89PNG")
            self.assertIn("Registration", (self.folder / "table.txt").read_text())
            self.assertLess(abs(float(outcome.err.split("outline: ")[1].split()[0]) - 0.4), 0.0005)
            last = self.assimilate(stderr="registered by the outline")[-1]
            for k in range(2):
                std = math.sqrt(exact["covariance"][k][k])
                self.assertLess(abs(last["mean"][k] - exact["mean"][k]), 1.5 * std)
                self.assertLess(std, 1.05 * math.sqrt(last["covariance"][k][k]))  # the scale is not known exactly
            self.edit(f'registration = "outline"\n{start}', 'scale = 4e-4\norigin = [320, 270]')

    def test_an_outline_that_does_not_fit_is_told(self):
        self.draw()
        self.edit("scale = 4e-4", 'registration = "outline"\nscale = 4e-4')
        self.edit("origin = [320, 270]", "origin = [420, 100]")
        self.expect(4, "dic", self.project_name, stderr="reference_1.tif: error: ")
        self.edit("origin = [420, 100]", "origin = [320, 270]\noutline = [[-0.3, 0], [0.3, 0], [0.3, 0.1], [-0.3, 0.1]]")
        self.expect(4, "dic", self.project_name, stderr=["reference_1.tif: error: the outline does not tell the place to the right",
                                                         "on the upper and lower sides only"])
        self.edit("[0.3, 0.1], ", "[0.6, 0], [0.9, 0], ")
        self.edit(", [-0.3, 0.1]]", "]")
        self.expect(3, "dic", self.project_name, stderr="the outline has no area")
        self.edit('registration = "outline"\n', "")
        self.expect(3, "dic", self.project_name, stderr='"dic.outline" needs "dic.registration" = "outline"')

    def test_the_lower_face_is_seen_from_below(self):
        self.edit('mesh = "model"', 'mesh = "model"\nview = "bottom"')
        self.edit("origin = [320, 270]", "origin = [320, 145]")
        self.draw()
        last = self.assimilate()[-1]
        for k, truth in enumerate((1.06, 0.96)):
            self.assertLess(abs(last["mean"][k] - truth), 3.3 * math.sqrt(last["covariance"][k][k]), last)
            self.assertLess(math.sqrt(last["covariance"][k][k]), 0.2)

    def test_pictures_start_from_what_the_model_predicts(self):
        """Three pictures, far apart: more than a tenth of a pixel between them."""
        self.edit("every = 3", "every = 4")
        self.draw()
        starts = [line["picture"]["start"] for line in self.assimilate()]
        self.assertIn("model", starts[2:])
        self.assertEqual(set(starts[1:]) - {"model", "last"}, set())

    def test_a_picture_that_is_gone_is_missing_data(self):
        self.draw()
        gone = sorted((self.folder / "pictures").glob("picture_*.tif"))[2]
        gone.unlink()
        outcome = self.expect(0, "assimilate", self.project_name, "--json", stderr=f"{gone.name}: error: there is no such picture")
        lines = outcome.lines()
        self.assertEqual([line["picture"]["missing"] for line in lines[:-1]], [i == 2 for i in range(len(lines) - 1)])
        self.assertEqual(lines[2]["used"], 0)
        self.assertEqual(lines[2]["mean"], lines[1]["mean"])

    def test_what_is_lacking_is_said(self):
        self.draw()
        self.edit("scale = ", "#scale = ")
        self.expect(3, "assimilate", self.project_name, stderr='needs "dic.scale"')
        self.edit("#scale = ", "scale = ")
        self.edit('pictures = "pictures/"', 'pictures = "nothing/"')
        self.expect(4, "assimilate", self.project_name, stderr="no such folder of pictures")


if __name__ == "__main__":
    unittest.main()
