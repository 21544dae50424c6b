import assert from "node:assert/strict";
import { test } from "node:test";
import { theme } from "../src/colour";
import { imposed } from "../src/format";
import { loadingAt, signalSpec } from "../src/signal";
import { parameterScale, quantityWords } from "../src/specs";
import type { SignalAnswer } from "../src/types";

const force: SignalAnswer = {
  name: "reaction_force",
  units: "N",
  step: 1,
  time: 0.5,
  times: [0.25, 0.5, 0.75, 1],
  predicted: { mean: [1000, 2000, 1500, 500], low: [900, 1900, 1300, 200], high: [1100, 2100, 1700, 800] },
  measured: { time: [0.25, 0.5], value: [1010, 1980] },
  loading: { name: "imposed_displacement", units: "m", values: [1e-4, 2e-4, 3e-4, 4e-4] },
};
const quantities = [
  { name: "load", quantity: "output", output: "reaction_force", horizon: 0.7, threshold: 1200 },
  { name: "crack", horizon: 0.7, threshold: 0.04 },
];
const specOf = (more: Partial<SignalAnswer> = {}) => signalSpec({ ...force, ...more }, quantities, "s", theme(false));
const valuesOf = (spec: ReturnType<typeof specOf>, label: string) => spec.series.find((s) => s.label === label)?.values;

test("a force over the stroke: measured, predicted, forecast; threshold and horizon in units of the loading", () => {
  const spec = specOf();
  assert.deepEqual([spec.xLabel, spec.yLabel], ["imposed displacement [mm]", "reaction force [kN]"]);
  assert.deepEqual(
    spec.times.map((x) => Math.round(1e3 * x)),
    [100, 200, 300, 400],
  );
  assert.deepEqual(valuesOf(spec, "measured"), [1.01, 1.98, null, null]);
  assert.deepEqual(valuesOf(spec, "posterior mean"), [1, 2, null, null]);
  assert.deepEqual(valuesOf(spec, "forecast"), [null, 2, 1.5, 0.5]);
  assert.deepEqual(
    spec.horizontal!.map((m) => [m.at, m.label]),
    [[1.2, "threshold 1.2 kN"]],
  );
  assert.deepEqual(
    spec.vertical!.map((m) => [Math.round(1e3 * m.at), m.label]),
    [
      [200, "last datum"],
      [280, "horizon at 0.28 mm"],
    ],
  );
});

test("a displacement without a name is called as in the list of signals", () => {
  assert.equal(specOf({ name: "y3", units: "m" }).yLabel, "u_y of sensor 3 [km]");
});

test("a horizon in units of the loading, which a test that unloads does not have", () => {
  assert.deepEqual(loadingAt(force, 0.875), { value: 3.5e-4, units: "m" });
  assert.equal(loadingAt(force, 1.1), undefined);
  assert.equal(loadingAt({ ...force, loading: { ...force.loading!, values: [1, 2, 2, 3] } }, 0.5), undefined);
  const horizon = { name: "crack", horizon: 0.3, loading: { value: 1.2e-4, units: "m" } };
  assert.equal(quantityWords(horizon), "crack at 0.12 mm");
  assert.equal(quantityWords({ name: "crack", horizon: 0.3 }), "crack at t = 0.3");
  assert.equal(quantityWords({ name: "steel", horizon: 3600, time_units: "s" }), "steel at t = 3600 s");
  assert.equal(imposed(0.120004e-3, "m"), "0.12 mm"); // as the console has it
  assert.deepEqual(
    [8e-6, 5000, 2e4].map((x, i) => imposed(x, i ? "N" : "m")),
    ["8 µm", "5000 N", "20 kN"],
  );
});

test("a parameter in its unit, as large as its prior", () => {
  const stiffness = { name: "E", reference: { value: 1, units: "Pa" }, values: [1.9e11, 2.1e11] };
  assert.deepEqual(parameterScale(stiffness), { factor: 1e-9, units: "GPa" });
  assert.deepEqual(parameterScale({ name: "Y0", reference: { value: 216, units: "J/m3" }, values: [0.5, 1.4] }), {
    factor: 216,
    units: "J/m³",
  });
  assert.deepEqual(parameterScale({ name: "n", reference: { value: 2 } }), { factor: 1, units: "" });
});

test("without a loading, or where it unloads, over time", () => {
  for (const loading of [undefined, { ...force.loading!, values: [1e-4, 2e-4, 1e-4, 4e-4] }]) {
    const { loading: _, ...rest } = force;
    const spec = signalSpec(loading ? { ...rest, loading } : rest, quantities, "s", theme(false));
    assert.deepEqual([spec.xLabel, spec.times], ["model time t [–]", force.times]);
    assert.equal(spec.vertical![1]!.label, "horizon at t = 0.7 s");
  }
  const whole = specOf({ step: 3, time: 1 });
  assert.equal(valuesOf(whole, "forecast"), undefined);
});
