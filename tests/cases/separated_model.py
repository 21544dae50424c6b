"""`knothe model`: what it says of a model, values and derivatives, import in both forms; judged by the formula the model was made of."""
import unittest
import xml.etree.ElementTree

import analytic_model
from support import Case


class Test(Case):
    fixture = "analytic"

    def evaluate(self, y0, ad, step, *arguments, model="model.h5"):
        outcome = self.expect(0, "model", "evaluate", model, "--at", f"Y0={y0!r},Ad={ad!r}", "--step", step, "--json", *arguments)
        lines = outcome.lines()
        self.assertEqual(len(lines), 1)
        return lines[0]

    def exact(self, y0, ad, step):
        t = analytic_model.time(step)
        return [analytic_model.displacement(*analytic_model.dof(i), t, y0, ad) for i in range(analytic_model.DOFS)]

    def expect_near(self, values, exact, tolerance):
        self.assertEqual(len(values), len(exact))
        worst = max(abs(a - b) for a, b in zip(values, exact))
        self.assertLessEqual(worst, tolerance)

    def test_info_tells_modes_axes_and_sizes(self):
        (info,) = self.expect(0, "model", "info", "model.h5", "--json").lines()
        self.assertEqual((info["form"], info["dofs"], info["steps"], info["mesh_cells"]), ("tree", 162, 12, 16))
        self.assertEqual([(p["name"], p["lower"], p["upper"], p["nodes"], p["reference"]) for p in info["parameters"]],
                         [("Y0", 0.5, 1.5, 7, 216.0), ("Ad", 0.5, 1.5, 7, 2.25e-3)])
        self.assertEqual(info["outputs"], ["imposed_displacement", "reaction_force"])
        self.assertLessEqual(info["relative_error"], 1e-9)
        text = self.expect(0, "model", "info", "model.h5").out
        for word in ("tree form", "162 dofs", "12 steps", "Y0: 0.5 … 1.5, 7 nodes", "reaction_force", "error off the grid: "):
            self.assertIn(word, text)

    def test_import_and_info_tell_the_error_between_the_nodes(self):
        (said,) = self.expect(0, "model", "import", "snapshots.h5", "-o", "again.h5", "--tolerance", "1e-9", "--json").lines()
        (info,) = self.expect(0, "model", "info", "again.h5", "--json").lines()
        keys = ["relative_error", "max_error_m", "off_grid_relative_error", "off_grid_max_error_m", "off_grid_source"]
        self.assertEqual([said[key] for key in keys], [info[key] for key in keys])
        self.assertEqual(info["off_grid_source"], "left-out nodes")
        largest = 0
        for y0, ad in ((0.6, 0.7), (0.917, 1.283), (1.1, 0.58), (1.42, 1.42), (0.55, 1.45), (0.58, 0.58)):
            for step in range(12):
                values = self.evaluate(y0, ad, step, model="again.h5")["values"]
                largest = max(largest, max(abs(a - b) for a, b in zip(values, self.exact(y0, ad, step))))
        self.assertGreater(largest, 30 * info["max_error_m"])
        self.assertGreater(info["off_grid_max_error_m"], largest / 3)
        self.assertLess(info["off_grid_max_error_m"], largest * 3)
        self.assertIn("off the grid", self.expect(0, "model", "import", "snapshots.h5", "-o", "again.h5").out)

    def test_tree_form_gives_the_snapshots_at_a_grid_node(self):
        y0, ad = analytic_model.node(1), analytic_model.node(5)
        self.expect_near(self.evaluate(y0, ad, 8)["values"], self.exact(y0, ad, 8), 1e-12)

    def test_canonical_form_gives_the_snapshots_at_a_grid_node(self):
        self.expect(0, "model", "import", "snapshots.h5", "-o", "canonical.h5", "--form", "canonical", "--tolerance", "1e-6")
        (info,) = self.expect(0, "model", "info", "canonical.h5", "--json").lines()
        self.assertEqual(info["form"], "canonical")
        y0, ad = analytic_model.node(1), analytic_model.node(5)
        # 1e-6 of a displacement of at most 0.4 mm, in the mean; 10 times that at any dof.
        self.expect_near(self.evaluate(y0, ad, 8, model="canonical.h5")["values"], self.exact(y0, ad, 8), 4e-9)

    def test_between_the_nodes_the_splines_follow_the_formula(self):
        y0, ad = 0.917, 1.283
        self.expect_near(self.evaluate(y0, ad, 5)["values"], self.exact(y0, ad, 5), 1e-9)

    def test_modes_are_as_many_as_asked_for(self):
        for form in ("tree", "canonical"):
            with self.subTest(form=form):
                self.expect(0, "model", "import", "snapshots.h5", "-o", "two.h5", "--form", form, "--modes", "2")
                (info,) = self.expect(0, "model", "info", "two.h5", "--json").lines()
                self.assertEqual(info["parameter_modes"], 2)

    def test_derivatives_are_those_of_the_values(self):
        """Gradient dof × parameter against central differences of values, Hessian against those of the gradient."""
        point, dofs, h = [0.917, 1.283], [0, 40, 97], 1e-4
        line = self.evaluate(*point, 6, "--dofs", "0,40,97", "--derivatives")
        self.assertEqual(list(line), ["values", "gradient", "hessian"])
        self.assertEqual([len(line["gradient"]), len(line["gradient"][0])], [3, 2])
        self.assertEqual([len(line["hessian"]), len(line["hessian"][0]), len(line["hessian"][0][0])], [3, 2, 2])
        for k in (0, 1):
            up, down = list(point), list(point)
            up[k] += h
            down[k] -= h
            above = self.evaluate(*up, 6, "--dofs", "0,40,97", "--derivatives")
            below = self.evaluate(*down, 6, "--dofs", "0,40,97", "--derivatives")
            for i in range(len(dofs)):
                slope = (above["values"][i] - below["values"][i]) / (2 * h)
                self.assertAlmostEqual(line["gradient"][i][k], slope, delta=1e-11)
                for j in (0, 1):
                    bend = (above["gradient"][i][j] - below["gradient"][i][j]) / (2 * h)
                    self.assertAlmostEqual(line["hessian"][i][j][k], bend, delta=1e-9)
                    self.assertEqual(line["hessian"][i][j][k], line["hessian"][i][k][j])

    def test_chosen_dofs_are_those_of_the_whole_field(self):
        whole = self.evaluate(0.8, 1.1, 2)["values"]
        self.assertEqual(self.evaluate(0.8, 1.1, 2, "--dofs", "7,3,161")["values"], [whole[7], whole[3], whole[161]])

    def test_the_field_for_paraview_is_xml_with_the_displacements(self):
        self.expect(0, "model", "evaluate", "model.h5", "--at", "Y0=1,Ad=1", "--step", "3", "-o", "field.vtu")
        content = (self.folder / "field.vtu").read_bytes()
        # Appended raw data are not XML; what stands before them is.
        head, mark, _ = content.partition(b"<AppendedData")
        root = xml.etree.ElementTree.fromstring(head + b"</VTKFile>" if mark else content)
        self.assertEqual(root.get("type"), "UnstructuredGrid")
        piece = root.find(".//Piece")
        self.assertEqual((piece.get("NumberOfPoints"), piece.get("NumberOfCells")), ("54", "16"))
        names = [array.get("Name") for array in piece.findall("./PointData/DataArray")]
        self.assertIn("displacement", names)

    def test_a_point_of_other_parameters_is_wrong_usage(self):
        def refused(at, *texts):
            self.expect(2, "model", "evaluate", "model.h5", "--at", at, "--step", "0", "--json", stderr=texts)

        refused("Y0=1,A=1", '"A"', "Y0, Ad")
        refused("Y0=1", '"Ad" is missing')
        refused("Y0=1,Y0=1.2,Ad=1", '"Y0" is given twice')
        refused("Y0=1,Ad=big", '"big" is not a number')
        refused("Y0=1,Ad=nan", "Ad")

    def test_a_point_outside_the_box_is_refused(self):
        outcome = self.run_knothe("model", "evaluate", "model.h5", "--at", "Y0=2,Ad=1", "--step", "0", "--json")
        self.assertEqual(outcome.status, 2, str(outcome))
        self.assertIn("Y0", outcome.err)
        self.assertEqual(outcome.out, "")

    def test_a_step_or_dof_that_is_not_there_is_wrong_usage(self):
        self.expect(2, "model", "evaluate", "model.h5", "--at", "Y0=1,Ad=1", "--step", "12", "--json", stderr="steps 0 to 11")
        self.expect(2, "model", "evaluate", "model.h5", "--at", "Y0=1,Ad=1", "--step", "0", "--dofs", "162", stderr="dofs 0 to 161")

    def test_import_gives_the_same_bytes_again(self):
        for form in ("tree", "canonical"):
            with self.subTest(form=form):
                for name in ("a.h5", "b.h5"):
                    self.expect(0, "model", "import", "snapshots.h5", "-o", name, "--form", form, "--modes", "3")
                self.assertEqual((self.folder / "a.h5").read_bytes(), (self.folder / "b.h5").read_bytes())


if __name__ == "__main__":
    unittest.main()
