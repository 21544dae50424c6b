"""`knothe serve`: what the page and UM-Bridge clients ask of the model. Judged by the formula behind the model."""
import json
import math
import unittest

import analytic_model
from service_support import ServiceCase
from support import REPOSITORY


class Test(ServiceCase):
    def test_what_the_page_asks_for_fits_together(self):
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        service.settled(12)
        about = service.get("/v1/description")[1]
        self.assertEqual([p["name"] for p in about["parameters"]], ["Y0", "Ad"])
        self.assertEqual([f["name"] for f in about["forecasts"]], ["force", "deflection"])
        self.assertEqual(about["steps"], 12)
        mesh = service.get("/v1/mesh")[1]
        self.assertEqual(len(mesh["sensors"]), 24)
        mean = service.get("/v1/state")[1]["mean"]
        field = service.get("/v1/field?name=displacement&step=11")[1]
        self.assertEqual(len(field["values"]), len(mesh["points"]))
        for point, value in list(zip(mesh["points"], field["values"]))[::7]:
            for c in range(3):
                exact = analytic_model.displacement(c, point, 1.0, *mean)
                self.assertAlmostEqual(value[c], exact, delta=1e-10)  # of the model to its formula
        sensitivity = service.get("/v1/field?name=sensitivity&parameter=Ad")[1]["values"]
        std = math.sqrt(service.get("/v1/state")[1]["covariance"][1][1])
        point, h = mesh["points"][5], 1e-5
        slope = (analytic_model.displacement(0, point, 1.0, mean[0], mean[1] + h) - analytic_model.displacement(0, point, 1.0, mean[0], mean[1] - h)) / (2 * h)
        self.assertAlmostEqual(sensitivity[5][0], slope * std, delta=1e-4 * abs(slope * std) + 1e-12)
        residual = service.get("/v1/field?name=residual&step=3")[1]["values"]
        line = service.get("/v1/states?from=3")[1][0]
        sensor, value = mesh["sensors"][4], self.data[3]["values"][4]
        exact = analytic_model.displacement(sensor["component"], (sensor["x"], sensor["y"], sensor["z"]), self.data[3]["time"], *line["mean"])
        self.assertAlmostEqual(residual[4], value - exact, delta=1e-10)
        samples = service.get("/v1/samples")[1]["samples"]
        self.assertAlmostEqual(sum(s[0] for s in samples) / len(samples), mean[0], delta=0.2 * std)

    def test_the_corrected_bias_is_a_field_that_explains_the_data_better(self):
        original = self.project.read_text()
        for extrapolation, location in (("joint", "nodes"), ("linear", "sensors"), ("published", "sensors")):
            self.edit('kind = "transport"', f'kind = "transport"\nbias_correction = "on"\nbias_extrapolation = "{extrapolation}"')
            service = self.serve(extra=f'journal = "{extrapolation}.journal"\n')
            self.assertIn("bias", service.get("/v1/description")[1]["fields"])
            for datum in self.data:  # at each sensor a tenth more than the structure does
                service.send({**datum, "values": [1.1 * v + 2e-5 * math.sin(9 * datum["time"]) for v in datum["values"]]})
            service.settled(12)
            mesh, bias = service.get("/v1/mesh")[1], service.get("/v1/field?name=bias&step=11")[1]
            self.assertEqual((bias["location"], bias["units"], bias["step"]), (location, "m", 11))
            residual = service.get("/v1/field?name=residual&step=11")[1]["values"]
            if location == "nodes":
                self.assertEqual(len(bias["values"]), len(mesh["points"]))
                node = {tuple(round(x, 9) for x in point): k for k, point in enumerate(mesh["points"])}
                at_sensors = [bias["values"][node[tuple(round(s[c], 9) for c in "xyz")]][s["component"]] for s in mesh["sensors"]]
            else:
                at_sensors = bias["values"]
            self.assertGreater(max(map(abs, at_sensors)), 1e-6)
            self.assertLess(sum((r - b) ** 2 for r, b in zip(residual, at_sensors)), 0.9 * sum(r * r for r in residual))
            service.stop()
            self.project.write_text(original)

    def test_every_route_of_the_document_is_there(self):
        service = self.serve()
        service.send(self.data[0])
        service.settled(1)
        document = service.get("/v1/openapi.json")[1]
        required = document["components"]["schemas"]["Line"]["required"]
        self.assertLessEqual(set(required), set(service.get("/v1/state")[1]))
        for path, methods in document["paths"].items():
            for method in methods:
                if path == "/v1/events" or method == "parameters":  # of the whole path
                    continue
                status, _, body = service.request(method.upper(), path, "{}" if method == "post" else None)
                self.assertIn(status, (200, 400, 404), (path, body))
                if status == 404:
                    self.assertNotEqual(body["error"]["type"], "NotFound", path)

    def test_lines_of_steps_keep_to_their_schema(self):
        """That of `knothe check --schema`; the service adds a few keys to it."""
        schema = json.loads((REPOSITORY / "docs/reference/lines.schema.json").read_text())["step"]
        line = self.serve().get("/v1/openapi.json")[1]["components"]["schemas"]["Line"]
        added = {"site", "event", "data", "received_at"}
        self.assertEqual({key: entry for key, entry in line["properties"].items() if key not in added}, schema["properties"])
        self.assertEqual([key for key in line["required"] if key not in added], schema["required"])
        lines = self.expect(0, "assimilate", self.project_name, "--json").lines()[:-1]
        kinds = {"object": dict, "array": list, "string": str, "number": (int, float), "integer": int, "boolean": bool}
        for each in lines:
            self.assertLessEqual(set(schema["required"]), set(each))
            for key in set(each) & set(schema["properties"]):
                self.assertIsInstance(each[key], kinds[schema["properties"][key]["type"]], key)
        with self.subTest("by a validator of its own"):
            try:
                import jsonschema
            except ImportError as missing:
                self.skipTest(f"no {missing.name}")
            for each in lines:
                jsonschema.validate(each, schema)

    def test_it_is_a_umbridge_server(self):
        service = self.serve()
        for datum in self.data[:4]:
            service.send(datum)
        service.settled(4)
        self.assertEqual(service.get("/Info")[1], {"protocolVersion": 1.0, "models": ["forward", "posterior", "predict"]})
        p = [1.02, 0.93]
        ask = lambda path, name, **more: service.post(path, {"name": name, "config": {"step": 3}, "input": [p], **more})[1]
        self.assertEqual(ask("/InputSizes", "forward"), {"inputSizes": [2]})
        self.assertEqual([ask("/OutputSizes", name)["outputSizes"] for name in ("forward", "posterior", "predict")], [[24], [1], [2]])
        self.assertEqual(ask("/ModelInfo", "predict")["support"], {"Evaluate": True, "Gradient": False, "ApplyJacobian": False, "ApplyHessian": False})
        sensors = service.get("/v1/mesh")[1]["sensors"]
        forward = ask("/Evaluate", "forward")["output"][0]
        for sensor, value in zip(sensors, forward):
            exact = analytic_model.displacement(sensor["component"], (sensor["x"], sensor["y"], sensor["z"]), self.data[3]["time"], *p)
            self.assertAlmostEqual(value, exact, delta=1e-12)
        predict = ask("/Evaluate", "predict")["output"][0]
        self.assertAlmostEqual(predict[0], analytic_model.reaction_force(0.75, *p), delta=1e-3)
        self.assertAlmostEqual(predict[1], analytic_model.displacement(1, (0.03, 0.05, 0.05), 1.0, *p), delta=1e-11)
        # The density, all constants included: priors restricted to the box times Gaussian likelihood, from the formula.
        exact = 0.0
        for value, mean in zip(p, (0.9, 1.1)):
            s = 0.4472135954999579
            mass = 0.5 * (math.erf((1.5 - mean) / s / math.sqrt(2)) - math.erf((0.5 - mean) / s / math.sqrt(2)))
            exact += -0.5 * ((value - mean) / s) ** 2 - math.log(s * math.sqrt(2 * math.pi) * mass)
        for datum in self.data[:4]:
            for sensor, value in zip(sensors, datum["values"]):
                model = analytic_model.displacement(sensor["component"], (sensor["x"], sensor["y"], sensor["z"]), datum["time"], *p)
                exact += -0.5 * ((value - model) / 3e-6) ** 2 - math.log(3e-6 * math.sqrt(2 * math.pi))
        self.assertAlmostEqual(ask("/Evaluate", "posterior")["output"][0][0], exact, delta=1e-4)
        self.check_derivatives(service, p)
        for body, kind in (({"name": "nothing"}, "ModelNotFound"), ({"name": "forward", "input": [[1]]}, "InvalidInput"),
                           ({"name": "forward", "input": [[1, 9]]}, "InvalidInput"), ({"name": "forward", "input": [p], "config": {"step": 99}}, "InvalidInput"),
                           ({"name": "forward", "input": [p], "config": {"stepp": 3}}, "InvalidInput"),
                           ({"name": "forward"}, "InvalidInput"), ("nonsense", "InvalidInput")):
            self.expect_error(service.post("/Evaluate", body), 400, kind)
        for path in ("/Evaluate", "/OutputSizes", "/InputSizes", "/ModelInfo"):
            status, body = service.post(path, {"name": "forward", "input": [p], "config": {"stepp": 3}})
            self.assertEqual((status, body["error"]["message"]),
                             (400, 'config: "stepp" is not a key of it (did you mean "step"?); it has "site" and "step"'))
        self.expect_error(service.post("/Gradient", {"name": "predict", "input": [p], "outWrt": 0, "inWrt": 0, "sens": [1, 1]}), 400, "UnsupportedFeature")
        self.assertEqual(service.post("/Evaluate", {"name": "posterior", "input": [[9, 9]]})[1], {"output": [[-1.7976931348623157e308]]})

    def check_derivatives(self, service, p):
        def call(path, name, at, **more):
            status, body = service.post(path, {"name": name, "config": {"step": 3}, "input": [at], **more})
            self.assertEqual(status, 200, body)
            return body["output"]

        h, direction = 1e-5, [0.6, -0.8]
        ahead, behind = ([x + sign * h * v for x, v in zip(p, direction)] for sign in (1, -1))
        for name, sens, scale in (("forward", [1.0 - 0.1 * i for i in range(24)], 1e-4), ("posterior", [2.0], 1e3)):
            difference = [(a - b) / (2 * h) for a, b in zip(call("/Evaluate", name, ahead)[0], call("/Evaluate", name, behind)[0])]
            jacobian = call("/ApplyJacobian", name, p, outWrt=0, inWrt=0, vec=direction)
            for a, b in zip(jacobian, difference):
                self.assertAlmostEqual(a, b, delta=1e-5 * scale)
            gradient = call("/Gradient", name, p, outWrt=0, inWrt=0, sens=sens)
            self.assertAlmostEqual(sum(g * v for g, v in zip(gradient, direction)), sum(s * j for s, j in zip(sens, jacobian)), delta=1e-9 * scale)
            hessian = call("/ApplyHessian", name, p, outWrt=0, inWrt1=0, inWrt2=0, sens=sens, vec=direction)
            up, down = (call("/Gradient", name, at, outWrt=0, inWrt=0, sens=sens) for at in (ahead, behind))
            for a, u, d in zip(hessian, up, down):
                self.assertAlmostEqual(a, (u - d) / (2 * h), delta=1e-3 * scale)


if __name__ == "__main__":
    unittest.main()
