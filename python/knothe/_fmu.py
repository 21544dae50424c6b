"""Co-simulation FMUs (FMI 2.0 and 3.0) as models that step, by the package fmpy."""
from __future__ import annotations

import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from knothe._errors import DataError, UsageError
from knothe._step_models import Parameters, Spread, StepModel
from knothe._values import Array, seconds_of


class _Process:
    """Runs one after the other in a process of its own; a run that crashes it is one that failed, and the next begins a new one."""

    def __init__(self, folder: str, names: Mapping[str, Sequence[str]], timeout: float) -> None:
        self.folder, self.names, self.timeout = folder, {kind: list(each) for kind, each in names.items()}, timeout
        self.process: "subprocess.Popen[bytes] | None" = None

    def _start(self) -> None:
        child_reads, parent_writes = os.pipe()
        parent_reads, child_writes = os.pipe()
        worker = pathlib.Path(__file__).with_name("_fmu_worker.py")
        self.said = tempfile.TemporaryFile()
        self.process = subprocess.Popen([sys.executable, str(worker), self.folder, str(child_reads), str(child_writes)],
                                        pass_fds=(child_reads, child_writes), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                        stderr=self.said, env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))})
        os.close(child_reads)
        os.close(child_writes)
        self.requests, self.answers = Connection(parent_writes, readable=False), Connection(parent_reads, writable=False)
        self.requests.send(self.names)
        answer = self._answer()
        if answer != "ready":
            raise DataError(f"fmu: it cannot be instantiated: {answer}")

    def _answer(self) -> Any:
        """A tuple of numbers, or why there is none."""
        assert self.process is not None
        if self.timeout and not self.answers.poll(self.timeout):
            self.stop()
            return f"no answer within {self.timeout:g} s"
        try:
            return self.answers.recv()
        except (EOFError, OSError):
            status = self.process.wait()
            self.said.seek(0)
            said = self.said.read().decode(errors="replace").strip().splitlines()
            self.stop()
            return f"its process ended {f'by signal {-status}' if status < 0 else f'with status {status}'}" + (f": {said[-1]}" if said else "")

    def stop(self) -> None:
        if self.process is not None:
            self.requests.close()
            self.answers.close()
            self.process.kill()
            self.process.wait()
            self.said.close()
            self.process = None

    def run(self, what: str, states: Array, parameters: Array, inputs: Array, t: float, dt: float, width: int) -> tuple[Array, str]:
        """A row for each run, NaN where it failed, and why the last one did."""
        result, why, done = np.full((len(states), width), np.nan), "", 0
        while done < len(states):
            if self.process is None:
                self._start()
            rows = [part[done:].tolist() for part in (states, parameters, inputs)]
            self.requests.send((what, *rows, t, dt))
            while done < len(states) and self.process is not None:
                answer = self._answer()
                if isinstance(answer, str):
                    why = answer
                else:
                    result[done] = answer
                done += 1
        return result, why


class FmuModel(StepModel):
    """From `fmu`."""

    def __init__(self, process: _Process, outputs: Sequence[str], **options: Any) -> None:
        self._process, self._why = process, ""
        self._outputs, self._names = list(outputs), list(options["parameters"])
        super().__init__(self._step_fmu, self._measure, **options)

    def _run(self, what: str, x: Array, p: Parameters, u: Array, t: float, dt: float, width: int) -> Array:
        parameters = np.column_stack([np.broadcast_to(p[name], len(x)) for name in self._names]) if self._names else np.zeros((len(x), 0))
        result, why = self._process.run(what, x, parameters, np.broadcast_to(u, (len(x), self.inputs)), t, dt, width)
        self._why = f": the FMU failed: {why}" if why else ""
        return result

    def _step_fmu(self, x: Array, p: Parameters, u: Array, t: float, dt: float) -> Array:
        return self._run("advance", x, p, u, t, dt, x.shape[1])

    def _measure(self, x: Array, p: Parameters, u: Array, t: float) -> Array:
        if set(self._outputs) <= set(self.states):
            return x[:, [self.states.index(name) for name in self._outputs]]
        return self._run("observe", x, p, u, t, 0.0, len(self._outputs))

    def _failure(self) -> str:
        return self._why


def fmu(path: "str | os.PathLike[str]", *, states: Sequence[str], outputs: Sequence[str], dt: float, noise: Spread, inputs: Sequence[str] = (),
        parameters: "Mapping[str, float] | None" = None, mean: "ArrayLike | None" = None, covariance: Spread = 0.0,
        process_noise: "Spread | None" = None, timeout: float = 60.0) -> StepModel:
    """A co-simulation FMU (FMI 2.0 or 3.0) as a model that steps; needs the package fmpy.

    Each step begins the FMU again, at its time and with its states set; so `states` has to name all that it remembers. It runs in a process
    of its own: a crash is a run that failed, after which a filter of particles goes on without that member, and the others end with
    an error.

    Parameters
    ----------
    path : path
        The file.
    states : sequence of str
        Variables whose start values are the state (``initial`` is ``exact``).
    outputs : sequence of str
        Variables that are measured.
    dt : float
        Time step.
    noise : as of `StepModel`
        Of the outputs.
    inputs : sequence of str
        Variables that are given at each time.
    parameters : mapping of name to float, optional
        Variables that stay, and their values, where `estimate` is not asked to find them.
    mean : array_like, optional
        Of the first state; else the FMU's own start values.
    covariance : as of `StepModel`
        Of that state; 0: it is known.
    process_noise : as of `StepModel`, optional
    timeout : float
        Seconds that a step may take; 0: any.

    Returns
    -------
    StepModel

    Raises
    ------
    UsageError
        fmpy is not there, or the FMU has no such variable.
    DataError
        The file is not a co-simulation FMU for this machine.

    Examples
    --------
    >>> model = knothe.states.fmu("oscillator.fmu", states=["x", "v"], outputs=["x"], parameters={"k": 9.0}, dt=0.01,
    ...                           noise=1e-3, covariance=0.1)  # doctest: +SKIP
    >>> found = knothe.states.estimate(model, data, "unscented")  # doctest: +SKIP
    """
    if importlib.util.find_spec("fmpy") is None:
        raise UsageError("fmu: the package fmpy is not installed: pip install fmpy")
    import fmpy

    file = pathlib.Path(path)
    try:
        description = fmpy.read_model_description(str(file), validate=False)
    except Exception as error:
        raise DataError(f"{file}: not an FMU that can be read: {error}") from error
    if description.coSimulation is None:
        raise DataError(f"{file}: not a co-simulation FMU: export it as one")
    variables = {variable.name: variable for variable in description.modelVariables}
    for kind, names in (("state", states), ("output", outputs), ("input", inputs), ("parameter", parameters or {})):
        for name in names:
            if name not in variables:
                raise UsageError(f"fmu: no variable {name!r}, given as {kind}: {file.name} has {', '.join(variables)}")
            if variables[name].type not in ("Real", "Float64"):
                raise UsageError(f"fmu: {kind} {name!r} is of type {variables[name].type}: only real ones can be used")
    for name in states:
        if variables[name].initial not in ("exact", "approx"):
            raise UsageError(f"fmu: state {name!r} cannot be set, as it is calculated by the FMU (initial={variables[name].initial!r})")
    folder = tempfile.mkdtemp(prefix="knothe-fmu-")
    fmpy.extract(str(file), unzipdir=folder)
    process = _Process(folder, {"states": states, "outputs": outputs, "inputs": inputs, "parameters": list(parameters or {})}, seconds_of(timeout))
    start = [float(variables[name].start or 0.0) for name in states] if mean is None else mean
    model = FmuModel(process, outputs, mean=start, covariance=covariance, noise=noise, process_noise=process_noise, dt=dt, inputs=len(inputs),
                     parameters=dict(parameters or {}), states=states)
    weakref.finalize(model, _finish, process, folder)
    return model


def _finish(process: _Process, folder: str) -> None:
    process.stop()
    shutil.rmtree(folder, ignore_errors=True)
