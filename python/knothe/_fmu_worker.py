"""Runs an FMU in a process of its own, so that its crash is not that of Python; started by _fmu.py with two pipes.

A request is ("advance" or "observe", states, parameters, inputs, t, dt), arrays with a row for each run; the answers are one for each row, a
tuple of numbers, or a string that says why the FMU failed.
"""
from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Any


class Instance:
    """One instance, which begins again with each run: its state is what is set."""

    def __init__(self, folder: str, names: Mapping[str, Sequence[str]]) -> None:
        import fmpy  # which is optional
        import fmpy.fmi2
        import fmpy.fmi3

        description = fmpy.read_model_description(folder, validate=False)
        self.is_3 = description.fmiVersion.startswith("3.")
        slave = fmpy.fmi3.FMU3Slave if self.is_3 else fmpy.fmi2.FMU2Slave
        self.fmu = slave(guid=description.guid, unzipDirectory=folder, modelIdentifier=description.coSimulation.modelIdentifier,
                         instanceName="knothe")
        self.fmu.instantiate()
        references = {variable.name: variable.valueReference for variable in description.modelVariables}
        self.references = {kind: [references[name] for name in names[kind]] for kind in names}
        self.set = self.fmu.setFloat64 if self.is_3 else self.fmu.setReal
        self.get = self.fmu.getFloat64 if self.is_3 else self.fmu.getReal

    def begin(self, t: float, given: Mapping[str, Sequence[float]]) -> None:
        if self.is_3:
            self.fmu.enterInitializationMode(startTime=t)
        else:
            self.fmu.setupExperiment(startTime=t)
            self.fmu.enterInitializationMode()
        for kind in ("parameters", "states", "inputs"):
            if self.references[kind]:
                self.set(self.references[kind], given[kind])
        self.fmu.exitInitializationMode()

    def run(self, what: str, t: float, dt: float, given: Mapping[str, Sequence[float]]) -> tuple[Any, ...]:
        self.begin(t, given)
        try:
            if what == "advance":
                self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=dt)
            return tuple(self.get(self.references["states" if what == "advance" else "outputs"]))
        finally:
            self.fmu.reset()


def main() -> None:
    folder, read, write = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    requests, answers = Connection(read, writable=False), Connection(write, readable=False)
    instance = Instance(folder, requests.recv())
    answers.send("ready")
    while True:
        try:
            what, states, parameters, inputs, t, dt = requests.recv()
        except EOFError:
            return
        for row in zip(states, parameters, inputs):
            try:
                answers.send(instance.run(what, t, dt, dict(zip(("states", "parameters", "inputs"), row))))
            except Exception as error:
                answers.send(f"{type(error).__name__}: {error}")


if __name__ == "__main__":
    main()
