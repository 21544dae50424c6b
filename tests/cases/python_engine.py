"""Python's results are, to the bit, the commands': assimilation, inference, reduced models."""
import copy
import itertools
import json
import pickle
import sys
import unittest
import warnings

try:
    import numpy as np
    import xarray  # noqa: F401, needed by what is tested
except ImportError as missing:
    print(f"skipped: {sys.executable} has no {missing.name} (Debian: python3-{missing.name})")
    sys.exit(77)

from support import CaseInItsFolder, parse_line, without_times

import knothe

PRIORS = {"Y0": knothe.Normal(0.9, 0.4472135954999579), "Ad": knothe.Normal(1.1, 0.4472135954999579)}


class Test(CaseInItsFolder):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def lines_of(self, *arguments):
        """The command's lines, as printed; the last one taken off."""
        lines = self.expect(0, "assimilate", self.project_name, "--json", *arguments).lines()
        return [without_times(line) for line in lines[:-1]], lines[-1]

    @staticmethod
    def records(results):
        return [without_times(parse_line(json.dumps(result.record))) for result in results]

    def test_the_lines_of_assimilate(self):
        for method in (None, "grid", "ekf"):
            with self.subTest(method):
                lines, last = self.lines_of(*(["--method", method] if method else []))
                twin = knothe.Twin(self.project_name, method=method)
                results = [twin.assimilate(datum) for datum in twin.data]
                self.assertEqual(self.records(results), lines)
                verdict = twin.verdict
                self.assertEqual(verdict.level, last["verdict"]["level"])
                self.assertEqual([reason.message for reason in verdict.reasons],
                                 [reason["message"] for reason in last["verdict"]["reasons"]])
                self.assertEqual(verdict.fit_probability, last["verdict"]["fit_probability"])

    def test_what_a_result_says(self):
        twin = knothe.Twin(self.project_name)
        for datum in itertools.islice(twin.data, 4):
            result = twin.assimilate(datum)
        self.assertEqual((result.step, result.parameters), (3, ["Y0", "Ad"]))
        np.testing.assert_allclose(np.average(result.points, axis=0, weights=result.weights), result.mean, rtol=1e-12)
        np.testing.assert_array_equal(result.mean, result.record["mean"])
        self.assertEqual(result.quantiles.shape, (2, 5))
        force = result.forecast["force"]
        self.assertEqual((force.mean, force.units), (result.record["forecast"]["force"]["mean"], "N"))
        self.assertAlmostEqual(force.density @ np.gradient(force.points), 1, delta=1e-3)
        for k in range(2):
            points, density = result.marginal(k)
            self.assertAlmostEqual(density @ np.gradient(points), 1, delta=1e-2)
        self.assertEqual(twin.last.record, twin.result(3).record)
        self.assertEqual(twin.posterior["Y0"].dims, ("chain", "draw"))
        self.assertIn("Y0 = ", repr(result))

    def test_a_copy_of_a_twin_goes_its_own_way(self):
        """Its results are the twin's, to the bit; what is assimilated or withdrawn in one of them is not in the other."""
        twin = knothe.Twin(self.project_name)
        for datum in itertools.islice(twin.data, 4):
            twin.assimilate(datum)
        twin.withdraw(1)
        for way in (copy.copy, copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))):
            other = way(twin)
            self.assertEqual(other.steps, [0, 2, 3])
            self.assertEqual(without_times(other.last.record), without_times(twin.last.record))
            self.assertEqual(next(other.data).step, 4)
            other.withdraw(3)
            self.assertEqual(twin.steps, [0, 2, 3])
        self.assertEqual(next(twin.data).step, 4)
        last = pickle.loads(pickle.dumps(twin.last))
        self.assertEqual((last.record, last.forecast), (twin.last.record, twin.last.forecast))
        np.testing.assert_array_equal(last.draws(50), twin.last.draws(50))

    def test_a_copy_of_a_twin_of_values(self):
        model = knothe.Model.load("model.h5")
        sensors = knothe.Sensors(model.points[:20], "y")
        twin = knothe.Twin(model=model, sensors=sensors, std=3e-6, parameters=PRIORS, seed=np.random.default_rng(1))
        for step in (3, 1):
            twin.assimilate(knothe.Datum(step, model.observe(sensors)([0.9, 1.1], step)))
        sensors.points[:] = 0
        other = pickle.loads(pickle.dumps(twin))
        self.assertEqual(without_times(other.last.record), without_times(twin.last.record))

    def test_an_untrusted_step_warns_once(self):
        self.edit('kind = "transport"', 'kind = "mcmc"\nsamples = 100')
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            twin = knothe.Twin(self.project_name)
            result = twin.assimilate(next(twin.data))
            repr(twin.last), twin.result(0), twin.verdict
            self.assertFalse(result.trusted)
        self.assertEqual([(w.category, w.filename) for w in said], [(knothe.UntrustedWarning, __file__)])
        self.assertIn("not trusted", str(said[0].message).lower())

    def test_order_and_withdrawal_leave_no_trace(self):
        data = list(knothe.Twin(self.project_name).data)
        twin, other = knothe.Twin(self.project_name), knothe.Twin(self.project_name)
        for datum in data[:5] + data[6:]:
            twin.assimilate(datum)
        for step in (7, 5, 2, 0, 11, 1, 3, 4, 10, 9, 8, 6):
            other.assimilate(data[step])
        other.withdraw(5)
        self.assertEqual(other.steps, twin.steps)
        self.assertEqual(self.records(other.result(s) for s in other.steps), self.records(twin.result(s) for s in twin.steps))
        self.assertEqual(repr(other.verdict), repr(twin.verdict))

    def test_from_values_as_from_the_project(self):
        self.edit("[forecast.deflection]", "[forecast.other]")
        self.edit('kind = "transport"', "")  # the default, here and there
        lines, _ = self.lines_of()
        project = knothe.Twin(self.project_name)
        points, components, _, _ = project._native.sensors()
        twin = knothe.Twin(
            model="model.h5", sensors=knothe.Sensors(points, components), std=3e-6, parameters=PRIORS,
            forecasts={"force": {"quantity": "output", "output": "reaction_force", "horizon": 0.75, "threshold": 1150.0},
                       "other": {"quantity": "displacement", "point": [0.03, 0.05, 0.05], "component": "y", "horizon": 1.0,
                                 "threshold": -3.7e-4}})
        results = [twin.assimilate(knothe.Datum(datum.step, datum.values)) for datum in project.data]
        self.assertEqual(self.records(results), lines)
        np.testing.assert_array_equal(twin.predict([1.0, 1.1], 3), knothe.Model.load("model.h5").observe(points, components)([1.0, 1.1], 3))

    def test_a_datum_brings_its_noise(self):
        project = knothe.Twin(self.project_name)
        points, components, _, _ = project._native.sensors()
        datum, n = next(project.data), len(components)
        twins = [knothe.Twin(model="model.h5", sensors=knothe.Sensors(points, components), std=std, parameters=PRIORS) for std in (5e-6, 1e-6)]
        one = twins[0].assimilate(knothe.Datum(0, datum.values))
        other = twins[1].assimilate(knothe.Datum(0, datum.values, std=5e-6))
        np.testing.assert_allclose(other.mean, one.mean, rtol=1e-12)
        np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-9)
        self.assertAlmostEqual(other.log_evidence, one.log_evidence, delta=1e-9)
        precision = knothe.Precision(np.full(n, 4e10), np.arange(n), np.arange(n + 1))
        third = knothe.Twin(model="model.h5", sensors=knothe.Sensors(points, components), precision=precision, parameters=PRIORS)
        np.testing.assert_allclose(third.assimilate(knothe.Datum(0, datum.values)).mean, one.mean, rtol=1e-4)

    def test_mistakes_are_explained(self):
        twin = knothe.Twin(self.project_name)
        datum = next(twin.data)
        twin.assimilate(datum)
        self.refused(knothe.UsageError, "step 0 is assimilated already", "withdraw", call=lambda: twin.assimilate(datum))
        self.refused(knothe.UsageError, "step 3 is not assimilated", call=lambda: twin.withdraw(3))
        self.refused(knothe.UsageError, "step 99: there are steps 0 to 11", call=lambda: twin.assimilate(knothe.Datum(99, datum.values)))
        self.refused(knothe.UsageError, "takes a Datum, not ndarray", call=lambda: twin.assimilate(datum.values))
        self.refused(knothe.UsageError, "step 0.5: steps of data are integers ≥ 0", call=lambda: knothe.Datum(0.5, datum.values))
        self.refused(knothe.UsageError, "2 values", call=lambda: twin.assimilate(knothe.Datum(1, [0.0, 0.0])))
        self.refused(knothe.UsageError, "no datum", call=lambda: knothe.Twin(self.project_name).posterior)
        self.refused(knothe.UsageError, "give a project file, or model", call=lambda: knothe.Twin())
        self.refused(knothe.UsageError, "says everything", call=lambda: knothe.Twin(self.project_name, model="model.h5"))
        self.refused(knothe.UsageError, "give transport, grid", call=lambda: knothe.Twin(self.project_name, method="magic"))
        sensors = knothe.Sensors([[0.03, 0.05, 0.05]], "y")
        self.refused(knothe.ProjectError, "Ad", call=lambda: knothe.Twin(model="model.h5", sensors=sensors, std=1e-6,
                                                                       parameters={"Y0": knothe.Normal(1, 1)}))
        self.refused(knothe.ProjectError, "did you mean", call=lambda: knothe.Twin(
            model="model.h5", sensors=sensors, std=1e-6, parameters=PRIORS, forecasts={"f": {"quantity": "outptu"}}))
        self.refused(knothe.UsageError, "no recorded data", call=lambda: next(
            knothe.Twin(model="model.h5", sensors=sensors, std=1e-6, parameters=PRIORS).data))
        self.refused(knothe.UsageError, "component", call=lambda: knothe.Sensors([[0, 0, 0]], "w"))

    def test_groups_are_those_of_the_results_folder(self):
        self.lines_of("-o", "out")
        twin = knothe.Twin(self.project_name)
        for datum in twin.data:
            twin.assimilate(datum)
        results = knothe.open_results("out")
        self.assertEqual(results.parameters, twin.parameters)
        self.assertEqual(len(results.steps), 12)
        self.assertEqual(results.verdict.level, twin.verdict.level)
        stored, groups = results.to_xarray(), twin.to_xarray()
        for name in PRIORS:
            self.assertEqual(stored["posterior"][name].dims, ("chain", "draw"))
            np.testing.assert_array_equal(stored["posterior"][name], groups["posterior"][name])
            self.assertEqual(dict(stored["posterior"][name].attrs), groups["posterior"][name].attrs)
            self.assertIn("reference", groups["posterior"][name].attrs)
        for coordinate in ("chain", "draw"):
            self.assertEqual(stored["posterior"][coordinate].dtype, np.int64)
        for name in ("ess", "log_evidence", "variance_diagnostic", "verdict", "fit_probability", "time", "mean"):
            np.testing.assert_array_equal(stored["history"][name], groups["history"][name])
        self.assertEqual(groups["posterior_predictive"]["displacement"].shape, (4, 250, 12, 24))
        for group in ("posterior_predictive", "log_likelihood", "prior_predictive"):
            np.testing.assert_array_equal(stored[group]["displacement"], groups[group]["displacement"])
        for name in ("mean", "quantiles", "threshold", "probability_above_threshold", "probability_below_threshold"):
            np.testing.assert_array_equal(stored["forecast"][name], groups["forecast"][name])
        for name in ("observation", "x", "direction"):
            np.testing.assert_array_equal(stored["observed_data"][name], groups["observed_data"][name])
        np.testing.assert_array_equal(groups["observed_data"]["displacement"].sel(step=3), twin._native.values(3))
        self.refused(knothe.DataError, "steps.jsonl", call=lambda: knothe.open_results("nowhere"))
        last, live = results.posterior, twin.result(twin.steps[-1])
        self.assertEqual([support[:2] for support in last.densities], [support[:2] for support in live.densities])
        np.testing.assert_array_equal(last.draws(50), live.draws(50))
        np.testing.assert_array_equal(last.marginal("Ad"), live.marginal("Ad"))
        draws = np.stack([stored["posterior"][name] for name in PRIORS]).reshape(2, -1)
        self.assertEqual([len(set(values)) for values in draws], [1000, 1000])  # also of each parameter alone
        for k in range(2):  # and not in order: those that follow each other have nothing in common
            x = draws[k] - draws[k].mean()
            self.assertLess(abs(np.mean(x[1:] * x[:-1])), 4 / np.sqrt(1000) * np.mean(x * x))
        try:
            import matplotlib  # noqa: F401
        except ImportError:
            return
        self.assertEqual(len(knothe.plot.pair(results)), 2)
        self.refused(knothe.UsageError, "give a StepResult, an InferenceResult, a Fit or Results", call=lambda: knothe.plot.marginals(twin))
        self.refused(knothe.UsageError, "the twin has no data yet", call=lambda: knothe.plot.fan(knothe.Twin(self.project_name), "Ad"))
        self.refused(knothe.UsageError, "one posterior has no steps over time", call=lambda: knothe.plot.verdict(last))

    def test_the_line_of_infer(self):
        line = self.expect(0, "infer", self.project_name, "--json", "-o", "a").lines()[0]
        found = knothe.infer(self.project_name, results="a")
        self.assertEqual(without_times(parse_line(json.dumps(found.record))), without_times(line))
        results = knothe.open_results("a")
        stored, groups = results.to_xarray(), found.to_xarray()
        np.testing.assert_array_equal(stored["posterior"]["Ad"], groups["posterior"]["Ad"])
        self.assertEqual(dict(stored["posterior"]["Ad"].attrs), groups["posterior"]["Ad"].attrs)
        np.testing.assert_array_equal(results.posterior.draws(50), knothe.Posterior.draws(found, 50))
        self.assertEqual(results.posterior.remark, found.remark)
        for name in ("points", "weights", "parameter"):
            np.testing.assert_array_equal(stored["weighted_posterior"][name], groups["weighted_posterior"][name])
        self.assertEqual(results.parameters, found.parameters)

    def test_the_model_as_the_command_evaluates_it(self):
        model = knothe.Model.load("model.h5")
        line = self.expect(0, "model", "evaluate", "model.h5", "--at", "Y0=1.1,Ad=0.85", "--step", "7", "--dofs", "1,4,7",
                           "--derivatives", "--json").lines()[0]
        at = dict(zip(("Y0", "Ad"), (1.1, 0.85)))
        np.testing.assert_array_equal(model(at, 7, [1, 4, 7]), line["values"])
        np.testing.assert_array_equal(model.jacobian(at, 7, [1, 4, 7]), line["gradient"])
        self.assertEqual(model.info, self.expect(0, "model", "info", "model.h5", "--json").lines()[0])
        points = np.random.default_rng(1).uniform(0.6, 1.4, (5, 2))
        np.testing.assert_array_equal(model(points, -1), [model(p, 11) for p in points])
        self.assertEqual(model.output("reaction_force", points).shape, (5, 12))
        seen, h = model.observe([[0.01, 0.03, 0.02], [0.05, 0.07, 0.04]], "xy"), 1e-6
        p = np.array([1.05, 0.95])
        slopes = [(seen(p + h * e, 6) - seen(p - h * e, 6)) / (2 * h) for e in np.eye(2)]
        np.testing.assert_allclose(seen.jacobian(p, 6), np.transpose(slopes), atol=1e-11)
        self.refused(knothe.UsageError, "there is no dof 100000", call=lambda: model(p, 0, [100000]))
        self.refused(knothe.UsageError, "step 12: there are steps 0 to 11", call=lambda: model(p, 12))
        self.refused(knothe.UsageError, "outside", call=lambda: seen([9.0, 1.0], 0))
        self.refused(knothe.UsageError, "the model has Y0, Ad", call=lambda: model({"Y0": 1.0}, 0))

    def test_parameters_that_displacements_cannot_tell_apart_are_named(self):
        """A bar of stiffness E under a load F: its displacements are those of F / E."""
        x, t, nodes = np.linspace(0.2, 1, 5), np.linspace(0.1, 1, 6), np.linspace(0.5, 1.5, 9)

        def bar(e, f):
            return 1e-3 * f / e * np.outer(t, x), {"load": 200 * f * t}

        model = knothe.offline(bar, {"E": nodes, "F": nodes}, t, "pulled.h5", points=np.c_[x, 0 * x, 0 * x], outputs={"load": "N"}, tolerance=1e-6)
        field, forces = bar(1.04, 0.9)
        noise = np.random.default_rng(3).standard_normal((6, 6))
        for series, std, level in (([], [1e-6] * 5, "caution"), (["load"], [1e-6] * 5 + [0.5], "ok")):
            twin = knothe.Twin(model=model, sensors=knothe.Sensors(np.c_[x, 0 * x, 0 * x], "y", series=series), std=std,
                               parameters={"E": knothe.Normal(1, 0.05), "F": knothe.Normal(1, 0.3)})
            for step in range(6):
                result = twin.assimilate(knothe.Datum(step, (np.append(field[step], forces["load"][step]) + noise[step] * [*[1e-6] * 5, 0.5])[:len(std)]))
            self.assertEqual(result.verdict.level, level, result.verdict)
            if not series:
                self.assertEqual([reason.message.split(":")[0] for reason in result.verdict.reasons], ["E cannot be told apart from F"])
                self.assertIn("add a sensor that tells them apart (a force beside displacements), or give E as known", result.verdict.reasons[0].message)

    def test_times_have_the_unit_that_is_stated(self):
        t = np.array([1.0, 2.0, 3.0])
        model = knothe.offline(lambda k: 1e-3 * np.outer(t, [1 / k]), {"k": np.linspace(0.5, 1.5, 5)}, t, "timed.h5", points=[[0, 0, 0]],
                               time_units="min")
        self.assertEqual((model.info["time_units"], list(model.times)), ("s", [60, 120, 180]))
        tip = {"quantity": "displacement", "point": [0, 0, 0], "component": "y", "horizon": 180.0}
        twin = knothe.Twin(model=model, sensors=knothe.Sensors([[0, 0, 0]], "y"), std=1e-5, parameters={"k": knothe.Normal(1, 0.2)},
                           forecasts={"tip": tip})
        result = twin.assimilate(knothe.Datum(0, [0.9e-3]))
        self.assertEqual(pickle.loads(pickle.dumps(result)).time_units, "s")
        self.assertIn("at time 180 s: ", repr(result.forecast["tip"]))
        (self.folder / "timed.csv").write_text("time,sensor,x,y,z,component,value,std\n60,a,0,0,0,y,0.9e-3,1e-5\n120,a,0,0,0,y,1.8e-3,1e-5\n")
        (self.folder / "timed.toml").write_text('model = "timed.h5"\ndata = "timed.csv"\nresults = "timed"\n[parameters]\n'
                                                'k = { prior = "normal", mean = 1, std = 0.2 }\n'
                                                '[forecast.tip]\nquantity = "displacement"\npoint = [0, 0, 0]\ncomponent = "y"\nhorizon = 180\n')
        self.assertIn("tip at time 180 s: ", self.expect(0, "assimilate", "timed.toml").out)
        self.expect(0, "report", "timed", "-o", "timed.html")
        page = (self.folder / "timed.html").read_text()
        for words in ("up to model time 120 s", "Tip at time 180 s", '"time_units":"s"'):
            self.assertIn(words, page)
        results = knothe.open_results("timed")
        self.assertIn("time 180 s", results.posterior._repr_html_())
        try:
            import matplotlib  # noqa: F401
        except ImportError:
            return
        for steps in (twin, [result], results):
            self.assertEqual(knothe.plot.fan(steps, "tip").get_xlabel(), "model time [s]")
        self.assertEqual(knothe.plot.verdict(results).get_xlabel(), "model time [s]")

    def test_a_model_of_a_function_is_that_of_the_command(self):
        x, t, nodes = np.linspace(0.2, 1, 5), np.linspace(0.1, 1, 6), np.linspace(0.5, 1.5, 9)

        def bar(e, f):
            return 1e-3 * np.outer(t, x * (2 - x)) / e + 1e-3 * f * np.outer(t ** 2, x)

        model = knothe.offline(bar, {"E": nodes, "F": nodes}, t, "bar.h5", points=np.c_[x, 0 * x, 0 * x], tolerance=1e-6, snapshots="bar_snapshots.h5")
        at = np.random.default_rng(1).uniform(0.5, 1.5, (20, 2))
        np.testing.assert_allclose(model(at, 4), [bar(*p)[4] for p in at], atol=3e-6)
        self.expect(0, "model", "import", "bar_snapshots.h5", "-o", "command.h5", "--tolerance", "1e-6")
        np.testing.assert_array_equal(knothe.Model.load("command.h5")(at, 4), model(at, 4))
        loaded = {"points": np.c_[x, 0 * x, 0 * x], "outputs": {"load": "N"}}
        model = knothe.offline(lambda e, f: (bar(e, f), {"load": 200 * f * t}), {"E": nodes, "F": nodes}, t, "loaded.h5", **loaded)
        np.testing.assert_allclose(model.output("load", at), 200 * np.outer(at[:, 1], t), rtol=1e-6)
        self.assertEqual(model.info["output_units"], {"load": "N"})
        loaded["outputs"] = {"load": "kN"}  # converted, as the command does
        model = knothe.offline(lambda e, f: (bar(e, f), {"load": 0.2 * f * t}), {"E": nodes, "F": nodes}, t, "loaded.h5", **loaded)
        np.testing.assert_allclose(model.output("load", at), 200 * np.outer(at[:, 1], t), rtol=1e-6)
        self.assertEqual(model.info["output_units"], {"load": "N"})
        for function, text in ((bar, "the function gave no outputs; it has to return the solution and a mapping with load"),
                               (lambda e, f: (bar(e, f), {"load": 1.0}), "the output load has to be one number for each time, 6 in all")):
            self.refused(knothe.UsageError, text, call=lambda function=function: knothe.offline(
                function, {"E": nodes, "F": nodes}, t, "x.h5", **loaded))
        self.refused(knothe.UsageError, "the function takes f, e, in this order, and the parameters are e, f", call=lambda: knothe.offline(
            lambda f, e: bar(e, f), {"e": nodes, "f": nodes}, t, "x.h5", points=np.c_[x, 0 * x, 0 * x]))
        self.refused(knothe.UsageError, "name its further outputs", call=lambda: knothe.offline(
            lambda e, f: (bar(e, f), {}), {"e": nodes, "f": nodes}, t, "x.h5", points=np.c_[x, 0 * x, 0 * x]))
        self.refused(knothe.UsageError, "[6 times, dofs]", call=lambda: knothe.offline(
            lambda e: [e], {"E": nodes}, t, "x.h5", quantities={"a": "1"}))
        self.refused(knothe.UsageError, "give points (the places of the displacements) or quantities", call=lambda: knothe.offline(
            bar, {"E": nodes, "F": nodes}, t, "x.h5"))
        self.refused(knothe.UsageError, "offline: at (0.5,) the function gave a value that is not finite, at time 0.1", call=lambda: knothe.offline(
            lambda e: np.full((6, 2), np.nan), {"E": nodes}, t, "x.h5", quantities={"a": "1", "b": "1"}))
        self.refused(knothe.UsageError, "as a mapping", call=lambda: knothe.offline(bar, [nodes], t, "x.h5"))
        self.refused(knothe.UsageError, "points and quantities exclude each other", call=lambda: knothe.offline(
            bar, {"E": nodes, "F": nodes}, t, "x.h5", points=np.c_[x, 0 * x, 0 * x], quantities={"a": "1"}))

    def test_progress_counts_the_solutions(self):
        t, solved, seen = np.array([1.0]), [], []

        def spring(k, m):
            solved.append((k, m))
            return [[m / k]]

        def stop(done, total):
            if done == 4:
                raise LookupError(f"enough at {done} of {total}")

        axes = {"k": [1.0, 2.0, 3.0], "m": [0.5, 1.5]}
        model = knothe.offline(spring, axes, t, "spring.h5", points=[[0, 0, 0]],
                               progress=lambda done, total: seen.append((len(solved), done, total)))
        self.assertEqual(seen, [(n, n, 6) for n in range(1, 7)])
        self.assertEqual(repr(model), "<Model spring.h5: parameters k, m, 1 step>")
        solved.clear()
        self.refused(LookupError, "enough at 4 of 6", call=lambda: knothe.offline(
            spring, axes, t, "none.h5", points=[[0, 0, 0]], progress=stop))
        self.assertEqual(len(solved), 4)
        self.assertFalse((self.folder / "none.h5").exists())
        self.refused(knothe.UsageError, "progress: True is not a function of (done, total)",
                     call=lambda: knothe.offline(spring, axes, t, "none.h5", points=[[0, 0, 0]], progress=True))

    def test_one_is_singular(self):
        """In messages and descriptions."""
        t = np.array([1.0])
        model = knothe.offline(lambda k: [[1 / k]], {"k": [1.0, 2.0, 3.0]}, t, "spring.h5", points=[[0, 0, 0]])
        sensors = knothe.Sensors(model.points)
        twin = knothe.Twin(model=model, sensors=sensors, std=0.1, parameters={"k": knothe.Uniform(1, 3)})
        self.assertEqual([repr(each) for each in (model, sensors, twin, knothe.Datum(0, [1.0]), knothe.Precision([1.0], [0], [0, 1]))],
                         ["<Model spring.h5: parameter k, 1 step>", "<Sensors: 1 displacement>", "<Twin: parameter k; data at 0 of 1 step>",
                          "<Datum of step 0: 1 value>", "<Precision: 1 value, 1 entry>"])
        for text, call in (("step 1: the only step is 0", lambda: model([1.0], 1)),
                           ("is not n points of 1 coordinate", lambda: model([1.0, 2.0], 0)),
                           ("there is no dof 1: the model has 1 dof, counted from 0", lambda: model([1.0], 0, dofs=[1])),
                           ("1 place of sensors with 2 components", lambda: knothe.Sensors([[0, 0, 0]], ["x", "y"])),
                           ("[1 time, dofs]", lambda: knothe.offline(lambda k: [k], {"k": [1.0, 2.0]}, t, "x.h5", quantities={"a": "1"})),
                           ("the model gave 1 value for 256 points; needed: 512 (2 each)",
                            lambda: knothe.infer(lambda points: [1.0], {"k": knothe.Normal(0, 1)}, observed=[1.0, 2.0], std=1.0, vectorized=True))):
            with self.subTest(text):
                self.refused(knothe.UsageError, text, call=call)

    def test_a_solver_whose_results_have_no_place(self):
        """A damped oscillator: own function, model of named quantities, twin; against dense quadrature with the function itself."""
        t = np.linspace(0.05, 1, 20)

        def oscillator(stiffness, damping):
            rate, decay = 2 * np.pi * np.sqrt(stiffness), 2 * damping
            return np.c_[np.exp(-decay * t) * np.cos(rate * t), stiffness * np.exp(-decay * t) * np.cos(rate * t)]

        axes = {"stiffness": knothe.Axis(np.linspace(0.8, 1.2, 9), units="N/m", reference=2e4), "damping": np.linspace(0.5, 1.5, 9)}
        model = knothe.offline(oscillator, axes, t, "oscillator.h5", quantities={"deflection": "m", "force": "N"}, tolerance=1e-7)
        sensors = knothe.Sensors(series=["deflection", "force"])
        self.assertEqual(repr(sensors), "<Sensors: 0 displacements, series deflection, force>")
        np.testing.assert_allclose(model.observe(sensors)([0.97, 1.1], 3), oscillator(0.97, 1.1)[3], atol=1e-4)
        twin = knothe.Twin(model=model, sensors=sensors, std=0.05, parameters={"stiffness": knothe.Uniform(0.8, 1.2),
                                                                               "damping": knothe.Uniform(0.5, 1.5)})
        noise = 0.05 * np.random.default_rng(4).standard_normal((20, 2))
        data = oscillator(0.97, 1.1) + noise
        for step in range(20):
            result = twin.assimilate(knothe.Datum(step, data[step]))
        stiffness, damping = np.meshgrid(np.linspace(0.8, 1.2, 201), np.linspace(0.5, 1.5, 201), indexing="ij")
        misfit = np.array([[np.sum((oscillator(k, c) - data) ** 2) for k, c in zip(*row)] for row in zip(stiffness, damping)]) / 0.05**2
        weight = np.exp(-0.5 * (misfit - misfit.min()))
        weight /= weight.sum()
        for k, values in enumerate((stiffness, damping)):
            mean = np.sum(weight * values)
            std = np.sqrt(np.sum(weight * (values - mean) ** 2))
            self.assertAlmostEqual(result.mean[k], mean, delta=0.05 * std)
            self.assertAlmostEqual(result.std[k], std, delta=0.03 * std)
        physical = result.record["physical"]["stiffness"]
        self.assertEqual(physical["units"], "N/m")
        self.assertAlmostEqual(physical["mean"], 2e4 * result.mean[0])
        self.refused(knothe.UsageError, "are no points; names of outputs or quantities are given as series", call=lambda: knothe.Sensors(["deflection"], "x"))
        self.refused(knothe.UsageError, "give points, or series", call=knothe.Sensors)
        self.refused(knothe.UsageError, 'did you mean "deflection"?', call=lambda: model.observe(knothe.Sensors(series=["deflexion"])))


if __name__ == "__main__":
    unittest.main()
