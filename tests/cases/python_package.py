"""The package for Python: errors, threads, Ctrl-C, memory, maps, inference and pictures against exact answers."""
import copy
import ctypes
import dataclasses
import math
import os
import pathlib
import pickle
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import unittest
import warnings

try:
    import numpy as np
except ImportError:
    print(f"skipped: {sys.executable} has no numpy (Debian: python3-numpy)")
    sys.exit(77)

from support import KNOTHE, CaseInItsFolder

import knothe
from knothe import _knothe, _values


def ridge(p):
    """x ~ N(0, 1) and y ~ N(x²/2, 0.5²) given x, not normalised: the integral is pi."""
    return -0.5 * (p[0] ** 2 + ((p[1] - 0.5 * p[0] ** 2) / 0.5) ** 2)


def ridge_gradient(p):
    r = (p[1] - 0.5 * p[0] ** 2) / 0.25
    return np.array([-p[0] + r * p[0], -r])


def speckle(shift_x, shift_y, size=96):
    spots = np.random.default_rng(1).uniform(0, size, (2, 500))
    y, x = np.mgrid[:size, :size]
    near = (x - spots[0, :, None, None] - shift_x) ** 2 + (y - spots[1, :, None, None] - shift_y) ** 2
    return 20 + 25 * np.exp(-near / 8).sum(0)


class Ticks:
    """Counts in a thread of its own, once a millisecond, if it is let."""

    def __enter__(self):
        self.count, self.stop = 0, threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()
        return self

    def run(self):
        while not self.stop.is_set():
            self.count += 1
            time.sleep(0.001)

    def __exit__(self, *_):
        self.stop.set()
        self.thread.join()


class Test(CaseInItsFolder):
    fixture = "analytic"

    # The package itself

    def test_values_keep_their_masks_and_their_names(self):
        """A masked value is missing, not the fill value beneath it; a Series goes by its names, not by position."""
        values = np.ma.MaskedArray([0.1, 9.97e36, 0.3], mask=[False, True, False])
        np.testing.assert_array_equal(knothe.Datum(0, values).values, [0.1, np.nan, 0.3])
        np.testing.assert_array_equal(knothe.Datum(0, np.ma.MaskedArray([1, 2], mask=False)).values, [1.0, 2.0])
        self.refused(knothe.UsageError, "std: 1 of 3 values are masked; give them all",
                     call=lambda: knothe.Datum(0, [1.0, 2.0, 3.0], std=values))
        self.refused(knothe.UsageError, "a picture has masked pixels",
                     call=lambda: knothe.Correlation(np.ma.MaskedArray(speckle(0, 0), mask=speckle(0, 0) > 30), (0, 0, 50, 50)))
        from knothe._models import _in_order

        class Named:
            """As a Series or a DataFrame of pandas shows itself."""
            iloc = None

            def __init__(self, values, **labels):
                self.values, self.__dict__ = values, {**labels, "values": values}

            def __getitem__(self, name):
                return self.values[name]

        series = Named({"Ad": 2.0, "Y0": 1.0}, index=["Ad", "Y0"])
        frame = Named({"Ad": [2.0, 4.0], "Y0": [1.0, 3.0]}, columns=["Ad", "Y0"], index=[0, 1])
        self.assertEqual(_in_order(series, ["Y0", "Ad"]), [1.0, 2.0])
        self.assertEqual(_in_order(frame, ["Y0", "Ad"]).tolist(), [[1.0, 2.0], [3.0, 4.0]])
        self.assertEqual(_in_order({"Ad": 2.0, "Y0": 1.0}, ["Y0", "Ad"]), [1.0, 2.0])
        self.refused(knothe.UsageError, "parameters Ad, E: the model has Y0, Ad",
                     call=lambda: _in_order(Named({}, index=["Ad", "E"]), ["Y0", "Ad"]))

    def test_the_points_of_a_callback_are_its_own(self):
        """numpy 2 beside the pybind11 of Debian gave points whose coordinates all were the first."""
        seen = []

        def density(p):
            seen.append((np.asarray(p).strides, len(set(np.asarray(p)))))
            return ridge(p)

        knothe.fit(density, 2)
        self.assertEqual({strides for strides, _ in seen}, {(8,)})
        self.assertIn(2, {different for _, different in seen})

    def test_the_version_is_the_commands(self):
        printed = subprocess.run([KNOTHE, "--version"], capture_output=True, text=True).stdout
        self.assertEqual(printed, f"knothe {knothe.__version__}\n")

    def test_a_library_of_another_version_is_refused(self):
        package = pathlib.Path(knothe.__file__).parent
        copy = self.folder / "knothe"
        copy.mkdir()
        for file in package.iterdir():
            if file.is_file():
                (copy / file.name).symlink_to(file.resolve())
        (copy / "_version.py").unlink()
        (copy / "_version.py").write_text('__version__ = "9.9.9"\n')
        done = subprocess.run([sys.executable, "-c", "import knothe"], env={**os.environ, "PYTHONPATH": str(self.folder)},
                              capture_output=True, text=True)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn(f"ImportError: the package knothe is of version 9.9.9, but its library is of version {knothe.__version__}",
                      done.stderr)

    def test_another_python_is_told_what_to_install(self):
        """The module is for one version of Python; under another there is none of that name."""
        copy_of_package = self.folder / "knothe"
        copy_of_package.mkdir()
        for file in pathlib.Path(knothe.__file__).parent.iterdir():
            if file.is_file():
                name = "_knothe.cpython-399-x86_64-linux-gnu.so" if file.suffix == ".so" else file.name
                (copy_of_package / name).symlink_to(file.resolve())
        done = subprocess.run([sys.executable, "-c", "import knothe"], env={**os.environ, "PYTHONPATH": str(self.folder)},
                              capture_output=True, text=True)
        self.assertIn(f"ImportError: knothe was not built for Python {sys.version_info.major}.{sys.version_info.minor} ({sys.executable}): "
                      "there is _knothe.cpython-399-x86_64-linux-gnu.so in its folder. Install it for this Python (`pip install knothe`), "
                      "or use the Python that it was built for", done.stderr)

    def test_a_precision_is_a_matrix_of_scipy_too(self):
        dense = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 2.0]])
        of_rows = knothe.Precision([4.0, 1.0, 1.0, 3.0, 2.0], [0, 1, 0, 1, 2], [0, 2, 4, 5])
        given = [dense]
        try:
            import scipy.sparse
            given += [scipy.sparse.csr_matrix(dense), scipy.sparse.coo_matrix(dense), scipy.sparse.csc_matrix(dense)]
        except ImportError:
            pass
        deviations = np.sqrt(np.diag(np.linalg.inv(dense)))
        for matrix in given:
            with self.subTest(type(matrix)):
                self.assertEqual(knothe.Precision(matrix), of_rows)
                np.testing.assert_array_equal(knothe.Precision(matrix).toarray(), dense)
                np.testing.assert_allclose(knothe.Datum(0, [1.0, 2.0, 3.0], precision=matrix).std, deviations, rtol=1e-12)
        self.refused(knothe.UsageError, "a matrix of shape (2, 3); give n x n, or data, indices and indptr", call=lambda: knothe.Precision(dense[:2]))
        self.refused(knothe.UsageError, "give data, indices and indptr, or a matrix alone", call=lambda: knothe.Precision([4.0], [0]))
        masked = np.ma.MaskedArray(dense, mask=dense == 3)
        self.refused(knothe.UsageError, "precision: 1 of 9 values are masked; give them all", call=lambda: knothe.Precision(masked))

    def test_masks_are_kept_everywhere(self):
        masked = np.ma.MaskedArray([0.5, 1.0, 1.5], mask=[False, True, False])
        times, text = [0.0, 1.0], "values are masked; give them all"
        one = {"a": knothe.Normal(0, 1)}
        for call in (lambda: knothe.Axis(masked),
                     lambda: knothe.offline(lambda a: np.zeros((3, 1)), {"a": [0.0, 1.0]}, masked, "m.h5", quantities={"q": "1"}),
                     lambda: knothe.offline(lambda a: np.zeros((2, 1)), {"a": masked}, times, "m.h5", quantities={"q": "1"}),
                     lambda: knothe.offline(lambda a: (np.zeros((3, 1)), {"f": masked}), {"a": [0.0, 1.0]}, [0.0, 1.0, 2.0], "m.h5",
                                            quantities={"q": "1"}, outputs={"f": "N"}),
                     lambda: knothe.infer(lambda p: masked, one, observed=[1.0, 1.0, 1.0], std=1.0),
                     lambda: knothe.infer(lambda p: np.ma.MaskedArray(p, mask=p > 0), one, observed=[1.0], std=1.0, vectorized=True),
                     lambda: knothe.infer(lambda p: p, one, observed=masked, std=1.0),
                     lambda: knothe.fit_samples(np.ma.MaskedArray(np.ones((9, 1)), mask=True))):
            self.refused(knothe.UsageError, text, call=call)

    def test_values_are_compared_by_what_they_hold(self):
        """Arrays entry by entry; other types and other values differ."""
        verdict = {"level": "ok", "reasons": [], "fit_probability": 0.5, "edge_mass": [0.0, 0.1], "model_shift_std": []}
        forecast = {"mean": 1.0, "std": 0.1, "maximum_a_posteriori": 1.0, "probability_above_threshold": 0.2, "probability_below_threshold": 0.8,
                    "horizon": 1.0, "threshold": 2.0, "levels": [0.1, 0.9], "values": [0.8, 1.2], "units": "m"}
        correlation = knothe.Correlation(speckle(0, 0), element_size=24)
        moved = correlation.correlate(speckle(0.3, 0))
        again = knothe.Displacements(**{**vars(moved), "u": moved.u.copy()})
        missing = knothe.Displacements(**{**vars(moved), "u": moved.u * np.nan})
        pairs = [(lambda: knothe.Axis([1.0, 2.0]), knothe.Axis([1.0, 3.0])),
                 (lambda: knothe.Precision(np.eye(2)), knothe.Precision(np.eye(3))),
                 (lambda: knothe.Verdict.of(verdict), knothe.Verdict.of({**verdict, "edge_mass": [0.0, 0.2]})),
                 (lambda: knothe.Forecast.of(forecast), knothe.Forecast.of({**forecast, "values": [0.8, 1.3]})),
                 (lambda: again, missing), (lambda: missing, moved), (lambda: knothe.Normal(0, 1), knothe.Uniform(0, 1))]
        for make, other in pairs:
            self.assertTrue(make() == make() and not make() != make(), make())
            self.assertTrue(make() != other and make() != 3, other)
        self.assertEqual(moved, again)

    def test_copies_of_each_class_are_good_and_their_own(self):
        """By copy, deepcopy and pickle: the same results to the bit."""
        model = knothe.Model.load("model.h5")
        seen = model.observe(knothe.Sensors(model.points[:3], "y"))
        found = knothe.fit(ridge, 2, gradient=ridge_gradient)
        joint = knothe.fit_samples(np.random.default_rng(1).standard_normal((500, 2)))
        inferred = knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0)
        correlation, moved = knothe.Correlation(speckle(0, 0), element_size=24), speckle(0.4, 0.1)
        reference = np.array([[0.3, -0.2]])
        plain = knothe.Datum(2, [1.0, np.nan], std=[0.1, 0.3], source="s", session="t", seq=7)
        correlated = knothe.Datum(2, [1.0, 2.0], precision=np.array([[4.0, 1.0], [1.0, 3.0]]))
        cases = [(model, lambda m: (m.parameters, m([0.9, 1.1], 3))), (seen, lambda s: s.jacobian([0.9, 1.1], 3)),
                 (found, lambda f: (f.mean, f.map(reference), f.trusted)), (joint, lambda m: (m.condition([0.3], 5), m.trusted)),
                 (inferred, lambda r: (r.chains, r.remark)),
                 (plain, lambda d: (d.step, d.values, d.std, d._native.source, d._native.session, d._native.seq)),
                 (correlated, lambda d: (d.values, d.std, d._native.precision())), (knothe.Sensors(model.points, "y"), lambda s: s.points)]
        os.makedirs("elsewhere")
        for original, says in cases:
            for way in (copy.copy, copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))):
                with self.subTest(type(original).__name__):
                    self.addCleanup(os.chdir, os.getcwd())
                    os.chdir("elsewhere")  # a file is found from there too
                    other = way(original)
                    os.chdir("..")
                    self.assertIs(type(other), type(original))
                    self.assertTrue(_values._same(says(other), says(original)))
        first = correlation.correlate(moved)
        again = pickle.loads(pickle.dumps(correlation))
        self.refused(knothe.UsageError, "correlate a picture first", call=lambda: again.at([[48.0, 48.0]]))
        self.assertEqual(again.correlate(moved), first)
        values = np.array([1.0, 2.0])
        datum = knothe.Datum(0, values)
        values[:] = 5
        self.assertEqual(pickle.loads(pickle.dumps(datum)).values.tolist(), [1.0, 2.0])

    def test_a_generator_is_a_seed(self):
        """Equal generators give equal results, and each call another one."""
        samples = np.random.default_rng(1).standard_normal((300, 1))
        joint = knothe.fit_samples(samples, seed=np.random.default_rng(2))
        one, other = np.random.default_rng(5), np.random.default_rng(5)
        first = joint.sample(4, seed=one)
        np.testing.assert_array_equal(first, joint.sample(4, seed=other))
        self.assertFalse(np.any(first == joint.sample(4, seed=one)))
        np.testing.assert_array_equal(first, joint.sample(4, seed=int(np.random.default_rng(5).integers(2**63))))
        self.assertEqual(joint.condition([], 3, seed=one).shape, (3, 1))
        self.assertTrue(knothe.fit(ridge, 2, gradient=ridge_gradient, seed=one).trusted)
        chains = [knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0, seed=np.random.default_rng(seed)).chains
                  for seed in (3, 3, 4)]
        np.testing.assert_array_equal(chains[0], chains[1])
        self.assertFalse(np.array_equal(chains[0], chains[2]))
        self.refused(knothe.UsageError, "1.5 as seed: give an integer ≥ 0", call=lambda: joint.sample(3, seed=1.5))

    def test_an_untrusted_result_warns_once(self):
        """At the caller's line; a trusted one says nothing."""
        def two_modes(p):
            return float(np.logaddexp(-0.5 * ((p[0] - 4) / 0.3) ** 2, -0.5 * ((p[0] + 4) / 0.3) ** 2))

        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found = knothe.fit(two_modes, 1, max_order=2)
            repr(found), found.mean, found.draws(10)
        self.assertFalse(found.trusted)
        self.assertEqual([(w.category, w.filename) for w in said], [(knothe.UntrustedWarning, __file__)])
        self.assertEqual(str(said[0].message), f"not trusted: {found.remark}")
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found.map.save("two.h5")
            knothe.TransportMap.load("two.h5")
            knothe.fit(ridge, 2, gradient=ridge_gradient)
        self.assertEqual([w.category for w in said], [knothe.UntrustedWarning])
        with warnings.catch_warnings():
            warnings.simplefilter("error", knothe.UntrustedWarning)
            self.refused(knothe.UntrustedWarning, "not trusted", call=lambda: knothe.fit(two_modes, 1, max_order=2))

    def test_figures_need_no_import_of_their_own(self):
        done = subprocess.run([sys.executable, "-c", "import knothe, sys; assert 'matplotlib' not in sys.modules; knothe.plot.fan; knothe.plott"],
                              capture_output=True, text=True, env=os.environ)
        self.assertIn("AttributeError: module 'knothe' has no attribute 'plott'", done.stderr)

    def test_errors_mirror_the_librarys(self):
        self.refused(knothe.DataError, "nowhere.h5", call=lambda: knothe.Model.load("nowhere.h5"))
        self.refused(knothe.ProjectError, "nowhere.toml", call=lambda: knothe.Twin("nowhere.toml"))
        (self.folder / "bad.toml").write_text('modell = "m.h5"\n')
        self.refused(knothe.ProjectError, "bad.toml:1:1: error: ", 'did you mean "model"', call=lambda: knothe.Twin("bad.toml"))
        (self.folder / "file").touch()
        self.refused(knothe.IoError, "could not make the folder: file", call=lambda: knothe.fit(lambda p: -0.5 * p @ p, 1).map.save("file/map.h5"))
        self.refused(knothe.NumericalError, "the log-density is nan at", call=lambda: knothe.fit(lambda p: float("nan"), 2))
        self.refused(knothe.UsageError, "dimension", call=lambda: knothe.fit(lambda p: 0.0, 0))
        self.refused(knothe.UsageError, "dimension 2.0", call=lambda: knothe.fit(lambda p: 0.0, 2.0))
        self.refused(knothe.UsageError, "the log-density gave 'high', not a number", call=lambda: knothe.fit(lambda p: "high", 2))
        self.refused(knothe.UsageError, "the gradient gave 'steep', not numbers",
                     call=lambda: knothe.fit(ridge, 2, gradient=lambda p: "steep"))
        self.refused(knothe.UsageError, "-1 draws: give an integer ≥ 0", call=lambda: knothe.fit(ridge, 2).map.sample(-1))
        self.refused(knothe.UsageError, "-1 as seed: give an integer ≥ 0", call=lambda: knothe.fit(ridge, 2).map.sample(3, seed=-1))
        self.refused(knothe.UsageError, "-5 samples: give an integer ≥ 0",
                     call=lambda: knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0, samples=-5))
        self.refused(knothe.UsageError, "dofs: -1: they count from 0", call=lambda: knothe.Model.load("model.h5")([1, 1], 0, dofs=[0, -1]))
        self.refused(knothe.UsageError, "step 1.5: a step is an integer", call=lambda: knothe._values.step_of(1.5, 3))
        for prior, values, rule in ((knothe.Normal, (1, -1), "Normal(mean=1, std=-1): the mean must be finite, the std > 0"),
                                    (knothe.Uniform, (2, 1), "Uniform(lower=2, upper=1): the bounds are finite"),
                                    (knothe.Lognormal, (float("nan"), 1), "Lognormal(mu=nan, sigma=1): mu must be finite")):
            self.refused(knothe.UsageError, rule, call=lambda prior=prior, values=values: prior(*values))
        statuses = {name: getattr(knothe, name).status for name in
                    ("Error", "UsageError", "ProjectError", "DataError", "IoError", "NumericalError", "Interrupted")}
        self.assertEqual(list(statuses.values()), [1, 2, 3, 4, 5, 6, 130])
        for error, kinds in ((knothe.UsageError, [ValueError]), (knothe.IoError, [OSError]), (knothe.DataError, [ValueError, OSError]),
                             (knothe.ProjectError, [ValueError, OSError])):
            self.assertTrue(all(issubclass(error, kind) for kind in kinds), error)
        self.refused(OSError, "nowhere.h5", call=lambda: knothe.Model.load("nowhere.h5"))
        self.refused(OSError, "nowhere.toml", call=lambda: knothe.Twin("nowhere.toml"))
        self.refused(ValueError, "coordinate 0 is nan", call=lambda: knothe.fit_samples([[1.0], [math.nan], [2.0]], folds=0))
        self.assertTrue(issubclass(knothe.Interrupted, KeyboardInterrupt) and not issubclass(knothe.Interrupted, Exception))

    def test_an_error_of_the_callers_function_comes_through(self):
        def broken(p):
            raise LookupError("no such sensor")

        self.refused(LookupError, "no such sensor", call=lambda: knothe.fit(broken, 2))
        self.refused(LookupError, "no such sensor",
                     call=lambda: knothe.infer(broken, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0))
        self.refused(knothe.UsageError, "the gradient has 1 value for 2 variables",
                     call=lambda: knothe.fit(ridge, 2, gradient=lambda p: [0.0]))

    # Threads, Ctrl-C

    def test_other_threads_go_on_meanwhile(self):
        """Long calls of each kind; a thread that is not let makes one tick at either end, and no more, in each of ten calls. (On a busy
        machine one that is let may get no time either, now and then.)"""
        model, samples = self.folder / "model.h5", np.random.default_rng(1).standard_normal((20000, 3))
        picture = np.random.default_rng(1).uniform(0, 255, (1200, 1200))
        (self.folder / "mcmc.toml").write_text(
            f'model = "{model}"\ndata = "data.h5"\n[parameters]\nY0 = {{ prior = "normal", mean = 0.9, std = 0.45 }}\n'
            'Ad = { prior = "normal", mean = 1.1, std = 0.45 }\n[method]\nkind = "mcmc"\nsamples = 20000\n')
        known, inside = knothe.Model.load("model.h5"), np.random.default_rng(2).uniform(0.6, 1.4, (40000, 2))
        found, reference = knothe.fit(ridge, 2).map, np.random.default_rng(3).standard_normal((400000, 2))
        joint = knothe.fit_samples(samples[:2000, :2])
        calls = {"samples": lambda: knothe.fit_samples(samples, max_order=3),
                 "pictures": lambda: knothe.Correlation(picture, element_size=16).correlate(picture),
                 "import": lambda: _knothe.import_model("snapshots.h5", "again.h5", "canonical", 6, 0.0),
                 "infer": lambda: knothe.infer("mcmc.toml"),
                 "model": lambda: known(inside, 5), "map": lambda: found(reference), "inverse": lambda: found.inverse(reference),
                 "conditional draws": lambda: joint.condition([0.3], 400000)}
        for name, call in calls.items():
            with self.subTest(name), Ticks() as ticks:
                while ticks.count == 0:
                    time.sleep(0.001)
                most = 0
                for _ in range(10):
                    before = ticks.count
                    call()
                    most = max(most, ticks.count - before)
                    if most > 3:
                        break
                self.assertGreater(most, 3, name)

    def test_ctrl_c_in_the_callers_function(self):
        calls = []

        def interrupted(p):
            calls.append(p)
            if len(calls) == 20:
                signal.raise_signal(signal.SIGINT)
            return ridge(p)

        with self.assertRaises(KeyboardInterrupt):
            knothe.fit(interrupted, 2)
        self.assertLessEqual(len(calls), 21)
        self.assertTrue(knothe.fit(ridge, 2, gradient=ridge_gradient).trusted, "the next call is not cancelled")

    def test_ctrl_c_while_a_map_is_evaluated(self):
        fitted = knothe.fit(ridge, 2, gradient=ridge_gradient).map
        points = np.tile([0.3, 0.2], (400_000, 1))
        thread = threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT))
        thread.start()
        with self.assertRaises(knothe.Interrupted) as caught:
            while True:  # however fast the machine is
                fitted.inverse(points)
        thread.join()
        self.assertIn("nothing is kept of the points so far", str(caught.exception))
        self.assertEqual(fitted.inverse(points[:1]).shape, (1, 2))

    def test_ctrl_c_in_conditional_draws(self):
        fitted = knothe.fit_samples(np.random.default_rng(1).standard_normal((2000, 2)), max_order=3)
        thread = threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT))
        thread.start()
        with self.assertRaises(knothe.Interrupted):
            while True:
                fitted.condition([0.3], 1_000_000)
        thread.join()

    def test_ctrl_c_in_a_correlation_and_in_a_model(self):
        model, correlation = knothe.Model.load("model.h5"), knothe.Correlation(speckle(0, 0, 400), element_size=16, tolerance=1e-12)
        points, deformed = np.tile([1.0, 1.0], (200_000, 1)), speckle(0.4, 0.2, 400)
        for name, call in (("model", lambda: model(points, 3, dofs=[0])), ("jacobian", lambda: model.jacobian(points, 3, dofs=[0])),
                           ("output", lambda: model.output("reaction_force", points)),
                           ("correlation", lambda: correlation.correlate(deformed))):
            with self.subTest(name):
                thread = threading.Timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT))
                thread.start()
                with self.assertRaises(knothe.Interrupted) as caught:
                    while True:
                        call()
                thread.join()
                self.assertRegex(str(caught.exception), "nothing is kept|is not correlated")

    def test_ctrl_c_in_an_update_leaves_the_twin_as_it_was(self):
        model = knothe.Model.load("model.h5")
        (self.folder / "long.toml").write_text(
            'model = "model.h5"\ndata = "data.h5"\n[parameters]\nY0 = { prior = "normal", mean = 0.9, std = 0.45 }\n'
            'Ad = { prior = "normal", mean = 1.1, std = 0.45 }\n[method]\nkind = "mcmc"\nsamples = 100000000\n')
        twin = knothe.Twin("long.toml")
        first = next(twin.data)
        thread = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))
        thread.start()
        with self.assertRaises(knothe.Interrupted) as caught:
            twin.assimilate(first)
        thread.join()
        self.assertIn("the posterior is not computed", str(caught.exception))
        self.assertEqual(twin.steps, [])
        self.assertEqual(model.parameters, twin.parameters)

    def test_ctrl_c_in_a_long_call(self):
        (self.folder / "long.toml").write_text(
            'model = "model.h5"\ndata = "data.h5"\n[parameters]\nY0 = { prior = "normal", mean = 0.9, std = 0.45 }\n'
            'Ad = { prior = "normal", mean = 1.1, std = 0.45 }\n[method]\nkind = "mcmc"\nsamples = 100000000\n')

        def interrupt():
            while not (self.folder / "out").exists():
                time.sleep(0.01)
            os.kill(os.getpid(), signal.SIGINT)

        handler = signal.getsignal(signal.SIGINT)
        thread = threading.Thread(target=interrupt)
        thread.start()
        with self.assertRaises(knothe.Interrupted) as caught:
            knothe.infer("long.toml", results="out")
        thread.join()
        self.assertIn("interrupt", str(caught.exception))
        self.assertEqual(signal.getsignal(signal.SIGINT), handler)
        with self.assertRaises(KeyboardInterrupt):  # Python's own again
            signal.raise_signal(signal.SIGINT)
        self.assertTrue(knothe.fit(ridge, 2, gradient=ridge_gradient).trusted, "the next call is not cancelled")

    def test_one_object_in_two_threads(self):
        """Calls of one object come one after the other."""
        correlation = knothe.Correlation(speckle(0, 0), element_size=24)
        found = []
        threads = [threading.Thread(target=lambda: found.append(correlation.correlate(speckle(0.2, 0)))) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(found), 4)
        for moved in found:
            self.assertLess(np.max(abs(moved.u - 0.2)), 0.05)

    # Memory

    def test_a_picture_of_something_else_has_not_converged(self):
        correlation = knothe.Correlation(speckle(0, 0), element_size=16)
        found = correlation.correlate(np.zeros((96, 96)))
        self.assertFalse(found.converged)
        self.assertTrue(found.message)
        self.refused(knothe.UsageError, "the picture has no noise that could be estimated", call=found.precision)

    def test_objects_are_a_line_each(self):
        correlation = knothe.Correlation(speckle(0, 0), element_size=24)
        moved = correlation.correlate(speckle(0.3, 0))
        for each, text in ((correlation, "<Correlation: "), (moved, "<Displacements of "), (moved.precision(), "<Precision: "),
                           (knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0), "<InferenceResult: a = ")):
            self.assertTrue(repr(each).startswith(text) and len(repr(each)) < 200, repr(each))
        self.assertIn("not converged: ", repr(correlation.correlate(np.zeros((96, 96)))))

    def test_dir_lists_what_is_public(self):
        self.assertEqual([name for name in dir(knothe) if name.startswith("_")], ["__version__"])
        self.assertIn("plot", dir(knothe))
        self.assertEqual([name for name in dir(knothe) if not hasattr(knothe, name)], [])

    def test_a_notebook_shows_numbers_in_tables_and_no_markup_of_others(self):
        correlation = knothe.Correlation(speckle(0, 0), element_size=24)
        self.assertIn("<td style=\"text-align:left\">", correlation._repr_html_())
        moved = correlation.correlate(speckle(0.3, 0))
        low, high = (float(text) for text in re.search(r">u</td>.*?>(\S+) … (\S+) px<", moved._repr_html_()).groups())
        self.assertLess(abs(low - 0.3) + abs(high - 0.3), 0.1)
        self.assertIn("Not converged: ", correlation.correlate(np.zeros((96, 96)))._repr_html_())
        found = knothe.infer(lambda p: p, {"<a>": knothe.Normal(0, 1)}, observed=[1.0], std=1.0)
        self.assertIn("&lt;a&gt;", found._repr_html_())
        self.assertNotIn("<a>", found._repr_html_())
        # N(0, 1) and a datum 1 of std 1: mean 0.5, variance 0.5.
        mean, std = re.search(r"(\d\.\d\d) ± (\d\.\d\d)", found._repr_html_()).groups()
        self.assertLess(abs(float(mean) - 0.5), 0.1 * 0.71)
        self.assertLess(abs(float(std) - 0.71), 0.05 * 0.71)
        verdict = knothe.Verdict("reject", [knothe.Reason("fit", "reject", "sign < turned", 1.0, 0.5)], 0.0, np.zeros(0), np.zeros(0))
        self.assertIn("Result: do not use", verdict._repr_html_())
        self.assertIn("sign &lt; turned", verdict._repr_html_())
        levels = np.array([0.025, 0.5, 0.975])
        tip = knothe.Forecast(0.0281, 2.6e-4, 0.028, 0.0, 1.0, 0.3, 0.04, levels, np.array([0.0276, 0.0281, 0.0286]), "m", levels, levels)
        self.assertEqual(repr(tip), "<Forecast at time 0.3: 28.10 ± 0.26 mm, P(above 40 mm): < 0.1 %>")
        self.assertEqual(repr(dataclasses.replace(tip, at="0.12 mm")), "<Forecast at 0.12 mm: 28.10 ± 0.26 mm, P(above 40 mm): < 0.1 %>")
        self.assertIn("27.60 … 28.60 mm", tip._repr_html_())
        self.assertIn(": 28.10 ± 0.52 mm,", repr(dataclasses.replace(tip, model_shift_std=math.sqrt(3))), "with the reduced model's error")

    def test_what_is_rejected_looks_like_it(self):
        levels = np.array([0.025, 0.5, 0.975])
        tip = knothe.Forecast(0.0281, 2.6e-4, 0.028, 0.0, 1.0, 0.3, 0.04, levels, np.array([0.0276, 0.0281, 0.0286]), "m", levels, levels,
                              verdict="reject")
        found = knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0)

        def judged(level):
            verdict = {"level": level, "reasons": [], "fit_probability": 0.0, "edge_mass": [], "model_shift_std": []}
            record = {**found.record, "verdict": verdict, "physical": {"a": {"mean": 314.2, "std": 9.0, "units": "J/m3"}}}
            return knothe.Posterior(record, found.parameters, found.points, found.weights, found.densities)

        self.assertEqual(repr(tip), "<Forecast at time 0.3: do not use: 28 mm>")
        self.assertRegex(repr(judged("reject")), r"^<Posterior: do not use: a = 0\.\d\d \(310 J/m³\)>$")
        for each in tip, judged("reject"):
            html = each._repr_html_()
            self.assertIn("Result: do not use", html)
            self.assertIn("line-through", html)
            self.assertNotRegex(html, r"\d ± \d")
        self.assertIn("314.2 ± 9.0 J/m³", judged("caution")._repr_html_())
        self.assertIn("color:#6b7280", judged("caution")._repr_html_())
        self.assertNotIn("color:#6b7280", judged("ok")._repr_html_())

    def test_a_picture_with_a_hole_is_refused(self):
        pixels = speckle(0, 0)
        pixels[7, 3] = np.nan
        text = "a picture of 96 x 96 pixels is not finite at row 7, column 3; give grey levels everywhere, and leave parts out by roi or mesh"
        self.refused(knothe.UsageError, text, call=lambda: knothe.Correlation(pixels))
        correlation = knothe.Correlation(speckle(0, 0), element_size=24)
        self.refused(knothe.UsageError, text, call=lambda: correlation.correlate(pixels))

    def test_points_are_read_where_they_are(self):
        points = np.random.default_rng(1).standard_normal((7, 3))
        self.assertEqual(_knothe.address(points), points.ctypes.data)
        self.assertEqual(_knothe.address(points[2:5]), points[2:5].ctypes.data)
        self.assertNotEqual(_knothe.address(np.asfortranarray(points)), points.ctypes.data)
        sensors = knothe.Sensors(points, "y")
        self.assertEqual(sensors.points.ctypes.data, points.ctypes.data, "the package makes no copy either")

    def test_results_own_what_the_library_made(self):
        transport = knothe.fit(lambda p: -0.5 * p @ p, 3).map
        for array in (transport.sample(5), transport(np.zeros((4, 3))), knothe.Model.load("model.h5")([1.0, 1.0], 0)):
            root = array if array.base is None else array
            while isinstance(root, np.ndarray):
                root = root.base
            self.assertEqual(type(root).__name__, "PyCapsule")

    # Maps

    def test_the_map_of_a_density(self):
        found = knothe.fit(ridge, 2, gradient=ridge_gradient)
        self.assertTrue(found.trusted, found.remark)
        self.assertAlmostEqual(found.log_evidence, np.log(np.pi), delta=2e-3)
        np.testing.assert_allclose(found.mean, [0, 0.5], atol=0.01)
        np.testing.assert_allclose(found.std, [1, np.sqrt(0.75)], atol=0.01)
        x = np.random.default_rng(1).standard_normal((20, 2))
        np.testing.assert_allclose(found.map.inverse(found.map(x)), x, atol=1e-8)
        z = np.array([[0.4, 0.2], [-0.5, 0.6]])
        np.testing.assert_allclose(found.map.log_density(z), [ridge(p) - np.log(np.pi) for p in z], atol=0.05)
        self.assertAlmostEqual(knothe.fit(ridge, 2).log_evidence, np.log(np.pi), delta=2e-3)
        np.testing.assert_allclose(np.average(found.points, axis=0, weights=found.weights), found.mean, atol=1e-12)

    def test_a_gradient_of_another_function_is_named(self):
        for wrong in (lambda p: -np.array(ridge_gradient(p)), lambda p: [ridge_gradient(p)[0], 2 * ridge_gradient(p)[1]], lambda p: p):
            self.refused(knothe.UsageError, "the gradient is not that of the log-density: at (", call=lambda wrong=wrong: knothe.fit(
                ridge, 2, gradient=wrong))
        cut = knothe.fit(lambda p: -p @ p / 2 if p[0] > -9 else -np.inf, 2, gradient=lambda p: -p)
        self.assertTrue(cut.trusted, cut.remark)

    def test_a_density_without_gradient_takes_thousands_of_values(self):
        calls = 0

        def bent(p):
            nonlocal calls
            calls += 1
            return -0.5 * p[0] ** 2 - 0.5 * ((p[1] - np.sin(p[0])) / 0.4) ** 2
        found = knothe.fit(bent, 2)
        self.assertTrue(found.trusted, found.remark)
        self.assertAlmostEqual(found.log_evidence, np.log(2 * np.pi * 0.4), delta=2e-3)
        self.assertLess(calls, 200_000)

    def test_a_fit_ends_within_its_budget_or_its_time(self):
        """With the best answer, its error, and how to go on."""
        calls = 0

        def exponential(p):
            nonlocal calls
            calls += 1
            return -float(p[0] + p[1]) if p[0] >= 0 and p[1] >= 0 else -np.inf
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", knothe.UntrustedWarning)
            little = knothe.fit(exponential, 2, evaluations=1500)
            self.assertLessEqual(calls, 1500)
            self.assertEqual(little.record["model_evaluations"], calls)
            self.assertFalse(little.trusted)
            self.assertIn("the budget of 1500 calls is spent: evaluations = 3000 goes on from here", little.remark)
        calls = 0
        found = knothe.fit(exponential, 2)
        self.assertLessEqual(calls, 100_000)
        self.assertTrue(found.trusted, found.remark)
        np.testing.assert_allclose(found.mean, 1, atol=0.1)
        np.testing.assert_allclose(found.std, 1, rtol=0.05)
        self.assertFalse(found.map.trusted)
        again = knothe.fit(exponential, 2)
        np.testing.assert_array_equal(again.points, found.points)
        slopes = 0

        def gradient(p):
            nonlocal slopes
            slopes += 1
            return ridge_gradient(p)
        calls = 0
        bent = knothe.fit(ridge, 2, gradient=gradient, evaluations=30_000)
        self.assertTrue(bent.trusted and bent.map.trusted, bent.remark)
        self.assertLessEqual(4 * slopes, bent.record["model_evaluations"])
        self.assertLessEqual(bent.record["model_evaluations"], 30_000)
        self.refused(knothe.NumericalError, "the budget of 3 calls is spent: evaluations = 6 goes on from here; there is no answer yet",
                     call=lambda: knothe.fit(exponential, 2, evaluations=3))
        self.refused(knothe.NumericalError, "the time of 1e-09 s is over: seconds = 2e-09 goes on from here; there is no answer yet",
                     call=lambda: knothe.fit(exponential, 2, seconds=1e-9))
        self.refused(knothe.UsageError, "-1 evaluations as budget: give an integer ≥ 0", call=lambda: knothe.fit(ridge, 2, evaluations=-1))
        self.refused(knothe.UsageError, "a time limit is a finite number, 0 for none", call=lambda: knothe.fit(ridge, 2, seconds=-1.0))

    def test_the_map_of_samples_and_its_conditionals(self):
        draws = np.random.default_rng(2).standard_normal((5000, 2))
        draws[:, 1] = 0.8 * draws[:, 0] + 0.6 * draws[:, 1]
        transport = knothe.fit_samples(draws)
        given = transport.condition([1.0], 20000)
        self.assertTrue(np.all(given[:, 0] == 1.0))
        self.assertAlmostEqual(given[:, 1].mean(), 0.8, delta=0.05)
        self.assertAlmostEqual(given[:, 1].std(), 0.6, delta=0.03)
        for each in (transport, knothe.fit(ridge, 2, triangular=True).map):
            each.save("map.h5")
            read = knothe.TransportMap.load("map.h5")
            np.testing.assert_array_equal(read.sample(10, 3), each.sample(10, 3))
            np.testing.assert_array_equal(read.condition([0.5], 10, 3), each.condition([0.5], 10, 3))

    def compiled(self):
        """The ridge in C, as a library of functions without declared types."""
        if shutil.which("cc") is None:
            self.skipTest("no C compiler here")
        (self.folder / "ridge.c").write_text("""#include <stddef.h>
double value(const double *p, size_t d) {
  double r = (p[1] - 0.5 * (p[0] * p[0])) / 0.5;
  return -0.5 * (p[0] * p[0] + r * r);
}
void slope(const double *p, size_t d, double *out) {
  double r = (p[1] - 0.5 * (p[0] * p[0])) / 0.25;
  out[0] = -p[0] + r * p[0];
  out[1] = -r;
}
""")
        subprocess.run(["cc", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "ridge.c", "-o", "ridge.so"], cwd=self.folder, check=True)
        return ctypes.CDLL(str(self.folder / "ridge.so"))

    def test_the_map_of_a_compiled_density(self):
        library = self.compiled()
        self.refused(knothe.UsageError, "double f(const double *p, size_t d): set its restype", call=lambda: knothe.fit(library.value, 2))
        library.value.restype = ctypes.c_double
        self.refused(knothe.UsageError, "void f(const double *p, size_t d, double *gradient): set its restype",
                     call=lambda: knothe.fit(library.value, 2, gradient=library.slope))
        library.slope.restype = None
        self.refused(knothe.UsageError, "give two of a kind", call=lambda: knothe.fit(library.value, 2, gradient=ridge_gradient))
        self.refused(knothe.UsageError, "give two of a kind", call=lambda: knothe.fit(ridge, 2, gradient=library.slope))
        for gradient, same in ((None, None), (library.slope, ridge_gradient)):
            found, python = knothe.fit(library.value, 2, gradient=gradient), knothe.fit(ridge, 2, gradient=same)
            self.assertTrue(found.trusted, found.remark)
            np.testing.assert_allclose(found.points, python.points, rtol=1e-9, atol=1e-9)
            self.assertAlmostEqual(found.log_evidence, python.log_evidence, delta=1e-9)
        wrapped = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.POINTER(ctypes.c_double), ctypes.c_size_t)(
            lambda p, d: -0.5 * sum(p[k] ** 2 for k in range(d)))
        self.assertAlmostEqual(knothe.fit(wrapped, 2).log_evidence, np.log(2 * np.pi), delta=1e-6)

    def test_compiled_densities_need_no_lock(self):
        """Fits of a compiled density in threads give what they give alone."""
        library = self.compiled()
        library.value.restype = ctypes.c_double
        alone = knothe.fit(library.value, 2)
        found = []
        threads = [threading.Thread(target=lambda: found.append(knothe.fit(library.value, 2))) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for each in found:
            np.testing.assert_array_equal(each.points, alone.points)
        self.assertEqual(len(found), 3)

    def test_sizes_of_points_are_checked(self):
        transport = knothe.fit(lambda p: -0.5 * p @ p, 2).map
        self.refused(knothe.UsageError, "(3, 5)", "2 coordinates", call=lambda: transport(np.zeros((3, 5))))
        self.refused(knothe.UsageError, "m samples", call=lambda: knothe.fit_samples([1.0, 2.0]))

    # Inference

    def test_a_linear_model_against_the_conjugate_formula(self):
        a = np.array([[1.0, 0.5], [0.2, -1.0], [0.7, 0.7]])
        y, std, prior_std = np.array([1.0, -0.5, 0.9]), np.array([0.3, 0.2, 0.4]), np.array([1.0, 2.0])
        covariance = np.linalg.inv(a.T @ np.diag(std ** -2) @ a + np.diag(prior_std ** -2.0))
        mean = covariance @ (a.T @ (y / std ** 2))
        priors = {"u": knothe.Normal(0, 1), "v": knothe.Normal(0, 2)}
        marginal = a @ np.diag(prior_std ** 2) @ a.T + np.diag(std ** 2)
        evidence = -0.5 * (y @ np.linalg.solve(marginal, y) + np.linalg.slogdet(2 * np.pi * marginal)[1])
        ways = [{"model": lambda p: a @ p, "std": std},
                {"model": lambda p: a @ p, "std": std, "jacobian": lambda p: a},
                {"model": lambda p: p @ a.T, "std": std, "vectorized": True, "jacobian": lambda p: np.tile(a, (len(p), 1, 1))},
                {"model": lambda p: a @ p, "covariance": np.diag(std ** 2), "method": "grid"},
                {"model": lambda p: a @ p, "std": std, "jacobian": lambda p: a, "method": "mcmc"}]
        for way in ways:
            with self.subTest(way=list(way)):
                sampled = way.get("method") == "mcmc"
                found = knothe.infer(parameters=priors, observed=y, **way)
                self.assertTrue(found.trusted, found.remark)
                np.testing.assert_allclose(found.mean, mean, atol=0.1 if sampled else 0.01)
                np.testing.assert_allclose(found.covariance, covariance, atol=0.03 if sampled else 5e-3)
                self.assertAlmostEqual(found.log_evidence, evidence, delta=0.1 if sampled else 0.01)

    def test_a_density(self):
        """The complete log posterior density: of N([1, -1], diag(0.5², 2²)), times e³."""
        def log_density(p):
            return 3.0 - 0.5 * (((p - [1, -1]) / [0.5, 2]) ** 2).sum() - np.log(2 * np.pi)

        priors = {"a": knothe.Normal(0, 1), "b": knothe.Normal(0, 3)}
        drawn = knothe.infer(log_density, priors)
        self.assertEqual(drawn.record["method"], "smc")  # auto: with the fewest calls
        self.assertLess(drawn.record["model_evaluations"], 20000)
        np.testing.assert_array_less(abs(drawn.mean - [1, -1]) / [0.5, 2], 0.1)
        np.testing.assert_allclose(drawn.std, [0.5, 2], rtol=0.05)
        for jacobian in (None, lambda p: -(p - np.array([1, -1])) / np.array([0.25, 4.0])):
            found = knothe.infer(log_density, priors, jacobian=jacobian, method="transport")
            np.testing.assert_allclose(found.mean, [1, -1], atol=0.01)
            np.testing.assert_allclose(found.std, [0.5, 2], rtol=0.01)
            self.assertAlmostEqual(found.log_evidence, 3.0, delta=0.01)

    def test_answers_to_the_same_question_are_compared(self):
        def answer(mean, **options):
            return knothe.infer(lambda p: -0.5 * ((p[0] - mean) / 0.5) ** 2, {"a": knothe.Normal(0, 2)}, **options)

        grid, drawn, other = answer(1, method="grid"), answer(1), answer(2, method="grid")
        agreed, contradicted = drawn.compare(grid), grid.compare(other)
        self.assertEqual(agreed["agreement"], "agree")
        self.assertTrue(agreed["words"].startswith("The two agree: means differ by at most 0.0"), agreed["words"])
        self.assertEqual(agreed["methods"], ["smc", "grid"])
        self.assertEqual(contradicted["agreement"], "contradict")
        self.assertTrue(contradicted["words"].startswith("The two contradict each other"), contradicted["words"])
        self.assertAlmostEqual(contradicted["mean_difference"][0], 2, delta=0.01)
        with self.assertRaisesRegex(knothe.UsageError, "compare: parameters a and b: give two answers to the same question"):
            grid.compare(knothe.infer(lambda p: -0.5 * p[0] ** 2, {"b": knothe.Normal(0, 2)}, method="grid"))

    def test_a_time_limit(self):
        density, priors = lambda p: -0.5 * p[0] ** 2, {"a": knothe.Normal(0, 2)}
        with self.assertRaisesRegex(knothe.NumericalError, "the time for calls of the model is over: raise seconds"):
            knothe.infer(density, priors, seconds=1e-300)
        for wrong in (-1, math.inf, math.nan):
            with self.assertRaisesRegex(knothe.UsageError, "seconds: a time limit is a finite number, 0 for none"):
                knothe.infer(density, priors, seconds=wrong)

    def test_minus_infinity_is_zero_density(self):
        """N(0, 1) cut off below −1, whose mean is φ(1)/Φ(1)."""
        def log_density(p):
            return -0.5 * p[0] ** 2 if p[0] > -1 else -math.inf

        share = 0.5 * math.erfc(-1 / math.sqrt(2))
        found = knothe.infer(log_density, {"a": knothe.Normal(0, 2)})
        self.assertAlmostEqual(found.mean[0], math.exp(-0.5) / math.sqrt(2 * math.pi) / share, delta=0.03)
        self.assertAlmostEqual(found.log_evidence, math.log(share * math.sqrt(2 * math.pi)), delta=0.03)
        self.refused(knothe.DataError, "is not finite (entry 0 is nan)",
                     call=lambda: knothe.infer(lambda p: math.nan, {"a": knothe.Normal(0, 2)}))
        self.refused(knothe.DataError, "is not finite (entry 0 is -inf)",
                     call=lambda: knothe.infer(lambda p: -math.inf, {"a": knothe.Normal(0, 2)}, observed=[1.0], std=1.0))

    def test_progress_counts_the_evaluations(self):
        """Up to all of them, the estimate of which is known to the methods that draw; what it raises comes through."""
        one, way = {"a": knothe.Normal(0, 1)}, {"observed": [1.0], "std": 1.0}
        for method, known in (("transport", False), ("grid", False), ("mcmc", True), ("smc", True)):
            with self.subTest(method):
                seen = []
                found = knothe.infer(lambda p: p, one, method=method, progress=lambda done, total: seen.append((done, total)), **way)
                done = [made for made, _ in seen]
                self.assertEqual(done, sorted(done))
                self.assertEqual(seen[-1], (found.record["model_evaluations"],) * 2)
                estimates = [total for _, total in seen[:-1] if total is not None]
                self.assertEqual(bool(estimates), known)
                self.assertTrue(all(total >= made for made, total in seen if total is not None))
                silent = knothe.infer(lambda p: p, one, method=method, **way)
                np.testing.assert_array_equal(found.chains, silent.chains)

        def broken(done, total):
            raise LookupError(f"no bar at {done}")

        self.refused(LookupError, "no bar at ", call=lambda: knothe.infer(lambda p: p, one, progress=broken, **way))
        self.refused(knothe.UsageError, "progress: 3 is not a function of (done, total)",
                     call=lambda: knothe.infer(lambda p: p, one, progress=3, **way))
        self.refused(knothe.UsageError, "leave out parameters, observations, jacobian and progress",
                     call=lambda: knothe.infer("infer.toml", progress=print))

    def test_mistakes_in_inference_are_explained(self):
        one = {"a": knothe.Normal(0, 1)}
        self.refused(knothe.UsageError, "std or covariance", call=lambda: knothe.infer(lambda p: p, one, observed=[1.0]))
        self.refused(knothe.UsageError, "needed: 256 (1 each)",
                     call=lambda: knothe.infer(lambda p: [1.0, 2.0, 3.0], one, observed=[1.0], std=1.0))
        self.refused(knothe.UsageError, "2 standard deviations for 1 observation",
                     call=lambda: knothe.infer(lambda p: p, one, observed=[1.0], std=[1.0, 1.0]))
        self.refused(knothe.DataError, "not finite", call=lambda: knothe.infer(lambda p: [np.nan], one, observed=[1.0], std=1.0))
        self.refused(knothe.UsageError, "is not knothe.Normal", call=lambda: knothe.infer(lambda p: p, {"a": (0, 1)}, observed=[1.0], std=1.0))
        self.refused(knothe.UsageError, "nonsense", call=lambda: knothe.infer(lambda p: p, one, observed=[1.0], std=1.0, method="nonsense"))

    # Pictures

    def test_a_speckle_that_moved(self):
        correlation = knothe.Correlation(speckle(0, 0), element_size=24)
        moved = correlation.correlate(speckle(0.7, -0.3))
        self.assertTrue(moved.converged, moved.message)
        np.testing.assert_allclose(moved.u, 0.7, atol=0.03)
        np.testing.assert_allclose(moved.v, -0.3, atol=0.03)
        precision = moved.precision().toarray()
        np.testing.assert_allclose(precision, precision.T, rtol=1e-12)
        deviations = np.sqrt(np.diag(np.linalg.inv(precision)))
        np.testing.assert_allclose(deviations, np.column_stack([moved.std_u, moved.std_v]).ravel(), rtol=1e-6)
        np.testing.assert_array_equal(moved.values[::2], moved.u)
        np.testing.assert_allclose(correlation.at([[48.0, 48.0]]), [[0.7, -0.3]], atol=0.03)
        inner = knothe.Correlation(speckle(0, 0), roi=(10, 20, 70, 80), element_size=20)
        self.assertEqual((inner.x.min(), inner.x.max(), inner.y.min(), inner.y.max()), (10, 70, 20, 80))

    def test_a_mesh_of_ones_own(self):
        """Triangles and a quadrilateral that shear: a field that the mesh can follow is found, from arrays and from Gmsh's file."""
        nodes = np.array([[8, 8], [48, 10], [86, 8], [10, 88], [50, 84], [88, 86]], float)
        elements = [[0, 1, 4, 3], [1, 2, 5, -1], [1, 5, 4, -1]]
        reference, deformed = speckle(0, 0), speckle(0.4, -0.2)
        correlation = knothe.Correlation(reference, mesh=(nodes, elements))
        np.testing.assert_array_equal(np.column_stack([correlation.x, correlation.y]), nodes)
        np.testing.assert_array_equal(correlation.elements, elements)
        moved = correlation.correlate(deformed)
        np.testing.assert_allclose(moved.u, 0.4, atol=0.03)
        np.testing.assert_allclose(moved.v, -0.2, atol=0.03)
        lines = [f"{i + 1} {x} {y} 0" for i, (x, y) in enumerate(nodes)]
        cells = ["1 3 2 0 1 1 2 5 4", "2 2 2 0 1 2 3 6", "3 2 2 0 1 2 6 5"]
        (self.folder / "mesh.msh").write_text("\n".join(["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", "6", *lines, "$EndNodes",
                                                         "$Elements", "3", *cells, "$EndElements"]) + "\n")
        by_file = knothe.Correlation(reference, mesh="mesh.msh")  # numbers nodes in the order of the elements
        order = [int(np.flatnonzero((nodes == place).all(1))[0]) for place in np.column_stack([by_file.x, by_file.y])]
        np.testing.assert_allclose(by_file.correlate(deformed).u, moved.u[order], atol=1e-9)
        for mesh, text in (((nodes, [[0, 1, 9]]), "element 0 has the node 9; there are 6 nodes"),
                           ((nodes, [[0, 1, 4]]), "node 2 belongs to no element; leave it out"),
                           ((nodes, [[0.5, 1, 4]]), "give integers, m x 3 or m x 4"),
                           ((nodes * 2, elements), "outside the picture of 96"), ("nowhere.msh", "nowhere.msh")):
            self.refused(knothe.Error, text, call=lambda mesh=mesh: knothe.Correlation(reference, mesh=mesh))
        self.refused(knothe.UsageError, "leave out roi", call=lambda: knothe.Correlation(reference, (0, 0, 50, 50), mesh=(nodes, elements)))

    def test_pictures_of_integers_and_files_are_the_same(self):
        pixels = np.clip(speckle(0, 0), 0, 255).astype(np.uint8)
        (self.folder / "grey.pgm").write_bytes(b"P5 96 96 255\n" + pixels.tobytes())
        np.testing.assert_array_equal(knothe.read_picture("grey.pgm"), pixels)
        moved = np.clip(speckle(0.4, 0), 0, 255).astype(np.uint8)
        by_file = knothe.Correlation("grey.pgm", element_size=24).correlate(moved)
        by_array = knothe.Correlation(pixels, element_size=24).correlate(moved)
        np.testing.assert_array_equal(by_file.u, by_array.u)
        self.refused(knothe.UsageError, "[height, width]", call=lambda: knothe.Correlation(np.zeros((4, 4, 3))))
        self.refused(knothe.DataError, "nowhere.tif", call=lambda: knothe.read_picture("nowhere.tif"))


if __name__ == "__main__":
    unittest.main()
