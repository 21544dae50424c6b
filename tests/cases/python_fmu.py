"""`knothe.states.fmu`: co-simulation FMUs of FMI 2.0 and 3.0, compiled here, against fmpy's own runs; and what a crash does."""
import re
import shutil
import subprocess
import sys
import unittest
import zipfile

try:
    import fmpy
    import fmpy.fmi2
    import fmpy.fmi3
    import numpy as np
except ImportError as missing:
    print(f"skipped: {sys.executable} has no {missing.name} (pip install fmpy; Debian: python3-numpy)")
    sys.exit(77)

from support import SOURCE, CaseInItsFolder

import knothe
import knothe.states
from knothe.states import estimate

NAMES = {"x": ("output", "exact", "1"), "v": ("output", "exact", "0"), "acceleration": ("output", "calculated", None), "u": ("input", None, "0"),
         "k": ("parameter", "exact", "9"), "c": ("parameter", "exact", "0.4")}  # by value reference


def variable(kind, reference, name, causality, initial, start):
    said = f'name="{name}" valueReference="{reference}" causality="{causality}"' + (f' initial="{initial}"' if initial else "")
    said += ' variability="fixed"' if causality == "parameter" else ""
    value = f' start="{start}"' if start else ""
    return f"<Float64 {said}{value}/>" if kind == 3 else f"<ScalarVariable {said}><Real{value}/></ScalarVariable>"


def description(kind):
    variables = "".join(variable(kind, k, name, *each) for k, (name, each) in enumerate(NAMES.items()))
    outputs = "".join('<Output valueReference="%d"/>' % k for k in range(3))
    identity = 'instantiationToken="oscillator"' if kind == 3 else 'guid="oscillator"'
    if kind == 3:
        variables = '<Float64 name="time" valueReference="9" causality="independent" variability="continuous"/>' + variables
    else:
        outputs = "<Outputs>" + "".join(f'<Unknown index="{k + 1}"/>' for k in range(3)) + "</Outputs>"
    return (f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="{kind}.0" modelName="oscillator" {identity}>'
            f'<CoSimulation modelIdentifier="oscillator" canHandleVariableCommunicationStepSize="true"/><ModelVariables>{variables}</ModelVariables>'
            f"<ModelStructure>{outputs}</ModelStructure></fmiModelDescription>")


class Test(CaseInItsFolder):
    def setUp(self):
        super().setUp()
        if shutil.which("cc") is None:
            self.skipTest("no C compiler here")

    def make(self, kind):
        """oscillator.fmu: fmu_oscillator.c, and of the functions that fmpy looks for besides only the names."""
        text = (SOURCE / "fmu_oscillator.c").read_text()
        wanted = dir({2: fmpy.fmi2.FMU2Slave, 3: fmpy.fmi3.FMU3Slave}[kind])
        further = [name for name in wanted if name.startswith(f"fmi{kind}") and not re.search(rf"\b{name}\(", text)]
        (self.folder / "all.c").write_text(text + "".join(f"int {name}(void) {{ return 3; }}\n" for name in further))
        subprocess.run(["cc", "-O2", "-w", "-shared", "-fPIC", f"-DFMI={kind}", "all.c", "-o", "oscillator.so"], check=True)
        with zipfile.ZipFile("oscillator.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", description(kind))
            archive.write("oscillator.so", f"binaries/{'linux64' if kind == 2 else 'x86_64-linux'}/oscillator.so")

    @staticmethod
    def model(**options):
        return knothe.states.fmu("oscillator.fmu", **{"states": ["x", "v"], "outputs": ["x", "acceleration"], "inputs": ["u"],
                                                      "parameters": {"k": 9.0, "c": 0.4}, "dt": 0.05, "noise": [1e-3, 0.05],
                                                      "covariance": [0.1, 0.1], "process_noise": [0.0, 0.02], **options})

    def test_a_hundred_runs_equal_those_of_fmpy(self):
        """To 1e-9, with other parameters and first states in each; in both versions of the standard."""
        for kind, runs in ((2, 60), (3, 40)):
            self.make(kind)
            model, rng = self.model(), np.random.default_rng(kind)
            times = 0.05 * np.arange(21)
            load = np.sin(5 * times)
            series = np.array(list(zip(times, load)), dtype=[("time", float), ("u", float)])
            folder = fmpy.extract("oscillator.fmu")
            self.addCleanup(shutil.rmtree, folder, ignore_errors=True)
            for run in range(runs):
                k, c, x, v = rng.uniform([4, 0.1, -1, -1], [16, 0.8, 1, 1])
                states, data = model.simulate(21, inputs=load, parameters={"k": k, "c": c}, state=[x, v], noise=False)
                # an input is held over a step by both: fmpy sets it before each
                own = fmpy.simulate_fmu(folder, validate=False, fmi_type="CoSimulation", stop_time=1.0, step_size=0.05, output_interval=0.05,
                                        start_values={"k": k, "c": c, "x": x, "v": v}, input=series, output=["x", "v"])
                np.testing.assert_allclose(states, np.c_[own["x"], own["v"]], atol=1e-9, rtol=0, err_msg=f"FMI {kind}, run {run}")
            np.testing.assert_allclose(data[:, 1], load - k * states[:, 0] - c * states[:, 1], atol=1e-12)

    def test_its_states_are_those_of_the_built_in_oscillator(self):
        """With the same process noise; the FMU's own steps are of Heun's method."""
        self.make(2)
        model, load = self.model(), np.sin(0.25 * np.arange(60))
        built_in = knothe.states.oscillator(1.0, 0.4, 9.0, dt=0.05, noise=[1e-3, 0.05], inputs=[[1.0]], observe=["displacement", "acceleration"])
        a, b, _ = built_in.transition({}, 0.05)
        exact_model = knothe.states.LinearModel(lambda p, dt: (a, b, np.diag([0.0, 0.02**2])), lambda p: ([[1, 0], [-9, -0.4]], [[0], [1]]),
                                                mean=[1.0, 0.0], covariance=[0.1, 0.1], noise=[1e-3, 0.05], dt=0.05, inputs=1)
        _, data = exact_model.simulate(60, inputs=load, seed=3)
        exact = estimate(exact_model, data, inputs=load)
        for method in ("extended", "unscented"):
            found = estimate(model, data, method, inputs=load)
            self.assertLess(np.abs((found.mean - exact.mean) / exact.std).max(), 1e-3)
            np.testing.assert_allclose(found.std, exact.std, rtol=1e-4)

    def test_a_crash_is_a_run_that_failed(self):
        """Above x = 10 the FMU aborts its process."""
        self.make(2)
        model = self.model(outputs=["x"], noise=0.5, parameters={}, mean=[9.8, 0.0], covariance=[0.2, 0.1])
        load = np.zeros(2)
        with self.assertWarnsRegex(knothe.UntrustedWarning, "the model failed for [0-9]+ members, which have no weight"):
            found = estimate(model, [[9.8], [9.9]], "particle", inputs=load, members=60)
        self.assertTrue(np.all(np.isfinite(found.mean)))
        self.assertLess(found.members[found.weights > 0, 0].max(), 10.2)
        self.refused(knothe.DataError, "step: at time 0.05 the model of member ", "the FMU failed: its process ended by signal 6",
                     call=lambda: estimate(model, [[9.8], [9.9]], "ensemble", inputs=load, members=60))
        self.refused(knothe.NumericalError, "particle: at time 0.05 the model of every member has failed: the FMU failed: its process ended by signal 6",
                     call=lambda: estimate(self.model(mean=[20.0, 0.0], outputs=["x"], noise=0.1), [[20.0], [20.0]], "particle", inputs=load, members=3))

    def test_what_is_wrong_is_told(self):
        self.make(3)
        self.refused(knothe.UsageError, "no variable 'y', given as state: oscillator.fmu has time, x, v, acceleration",
                     call=lambda: self.model(states=["y"]))
        self.refused(knothe.UsageError, "state 'acceleration' cannot be set, as it is calculated", call=lambda: self.model(states=["acceleration"]))
        (self.folder / "empty.fmu").write_bytes(b"nothing")
        self.refused(knothe.DataError, "empty.fmu: not an FMU that can be read",
                     call=lambda: knothe.states.fmu("empty.fmu", states=["x"], outputs=["x"], dt=0.1, noise=1.0))
        alone = subprocess.run([sys.executable, "-c", "import sys; sys.modules['fmpy'] = None\nimport importlib.util\n"
                                "importlib.util.find_spec = lambda name: None\nimport knothe.states\n"
                                "knothe.states.fmu('oscillator.fmu', states=['x'], outputs=['x'], dt=0.1, noise=1.0)"], capture_output=True, text=True)
        self.assertIn("UsageError: fmu: the package fmpy is not installed: pip install fmpy", alone.stderr)


if __name__ == "__main__":
    unittest.main()
