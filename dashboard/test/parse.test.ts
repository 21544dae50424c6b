import assert from "node:assert/strict";
import { test } from "node:test";
import { asStepLine, EventParser, parseStates } from "../src/parse";
import { actionWords } from "../src/specs";
import { entryWords } from "../src/logbook_panel";
import { asAlarm, asEntry, asFields, asMesh, asModel, asQuarantine, asSamples, asSensors, asStatus } from "../src/wire";
import { stepLine } from "./support";

test("a line of section 4 is taken with all its numbers, its densities left out", () => {
  const sent = { ...stepLine(3), marginals: { Y0: { points: [1], density: [1] } } } as Record<string, unknown>;
  const line = asStepLine(JSON.parse(JSON.stringify(sent)))!;
  assert.deepEqual(line, stepLine(3));
});

test("a verdict is taken with its levels and messages, or not at all", () => {
  const reason = { code: "fit", level: "reject", value: 3, limit: 1, message: "no" };
  const parsed = asStepLine({ ...stepLine(1), verdict: { level: "reject", reasons: [reason, 5], edge_mass: [0] } });
  assert.deepEqual(parsed?.verdict, { level: "reject", reasons: [{ level: "reject", message: "no" }] });
  assert.equal(asStepLine({ ...stepLine(1), verdict: { level: "perhaps" } })?.verdict, undefined);
  assert.deepEqual(asStatus({ state: "OK", structure: "perhaps" }), { state: "OK" });
  assert.equal(asStatus({ state: "OK", structure: "caution" })?.structure, "caution");
});

test("a decision is taken with its action and load, or not at all, and said in the load's units", () => {
  const decision = { action: "load", time: 0.31, message: "why", load: 1.24e-4, units: "m", plan: [0.31] };
  const taken = asStepLine({ ...stepLine(1), decision })?.decision;
  assert.deepEqual(taken, { action: "load", time: 0.31, message: "why", load: 1.24e-4, units: "m" });
  assert.equal(actionWords(taken!), "load to 0.124 mm");
  assert.equal(actionWords({ action: "load", time: 0.31, message: "" }), "load to time 0.31");
  assert.equal(actionWords({ action: "hold", time: 0.3, message: "", load: 1e-4, units: "m" }), "hold");
  for (const wrong of [{ ...decision, action: "run" }, { ...decision, time: "1" }, 3, null])
    assert.equal(asStepLine({ ...stepLine(1), decision: wrong })?.decision, undefined);
});

test("what is no line is refused, what is only incomplete is completed", () => {
  for (const wrong of [
    null,
    3,
    "x",
    [],
    {},
    { step: 1.5, time: 0, mean: [1] },
    { step: 1, time: 0, mean: ["a"], quantiles: { levels: [], values: [] } },
  ])
    assert.equal(asStepLine(wrong), undefined);
  const least = asStepLine({ step: 0, time: 0.1, mean: [1], quantiles: { levels: [0.5], values: [[1]] } })!;
  assert.equal(least.used, 0);
  assert.deepEqual(least.forecast, {});
  assert.deepEqual(least.maximum_a_posteriori, [1]);
});

test("states come as lines, as an array, or in an object", () => {
  const lines = [stepLine(0), stepLine(1)];
  const expected = [0, 1];
  const texts = [
    lines.map((l) => JSON.stringify(l)).join("\n") + "\n",
    JSON.stringify(lines),
    JSON.stringify({ states: lines }),
  ];
  for (const text of texts)
    assert.deepEqual(
      parseStates(text).map((l) => l.step),
      expected,
    );
  assert.deepEqual(
    parseStates(JSON.stringify(stepLine(7))).map((l) => l.step),
    [7],
  );
  assert.deepEqual(parseStates(""), []);
  assert.deepEqual(
    parseStates('{"done":true,"steps":3}\n' + JSON.stringify(stepLine(2))).map((l) => l.step),
    [2],
  );
});

test("description and mesh become the model; what is absent stays absent", () => {
  const model = asModel({
    run: "r",
    site: "beam",
    parameters: [{ name: "Y0", lower: 0.5, quantiles: { levels: [0.5], values: [1] } }, { name: "Ad" }],
    forecasts: [{ name: "crack", threshold: 0.04 }],
  })!;
  assert.deepEqual(model.parameters[0]!.levels, [0.5]);
  assert.equal(model.parameters[1]!.levels, undefined);
  assert.deepEqual(model.quantities, [{ name: "crack", threshold: 0.04 }]);
  assert.deepEqual(asModel({ site: "beam" })?.parameters, []);
  assert.equal(asModel([]), undefined);
  const { mesh, sensors } = asMesh({
    points: [[0, 0, 0]],
    cells: [
      { type: "tetra", connectivity: [[0, 1, 2, 3]] },
      { type: "tetra", connectivity: [[4, 5, 6, 7]] },
      { type: "line", connectivity: [[0, 1]] },
    ],
    sensors: [{ x: 1, y: 2, z: 3, component: 1, std: 1e-6 }],
  });
  assert.deepEqual(mesh!.cells, [
    [0, 1, 2, 3],
    [4, 5, 6, 7],
  ]);
  assert.deepEqual(sensors, { points: [[1, 2, 3]], components: ["y"], std: [1e-6] });
  assert.deepEqual(asMesh({ error: {} }), {});
});

test("status and alarms: unknown words are no state, unknown severities are warnings", () => {
  assert.equal(asStatus({ state: "FINE" }), undefined);
  assert.equal(asStatus({ state: "BIASED", reason: "x" })?.reason, "x");
  assert.deepEqual(asAlarm({ id: 3, step: 7, severity: "loud", kind: "gap", message: "late" }), {
    id: 3,
    step: 7,
    severity: "warning",
    kind: "gap",
    message: "Late",
  });
  assert.equal(asAlarm({ id: 3 }), undefined);
});

test("an acknowledged alarm, and the logbook", () => {
  const alarm = asAlarm({
    id: 3,
    step: 7,
    message: "x",
    raised_at: 9,
    acknowledged: { by: "Ada", comment: "ok", at: 10 },
  });
  assert.deepEqual([alarm?.raised_at, alarm?.acknowledged], [9, { by: "Ada", comment: "ok", at: 10 }]);
  const entry = { number: 1, kind: "sensor_off", time: 0.5, by: "Ada", text: "loose", written_at: 9, sensor: 3 };
  assert.deepEqual(asEntry({ ...entry, more: 1 }), entry);
  assert.equal(asEntry({ number: 1, kind: "note" }), undefined);
  assert.equal(entryWords(entry), "sensor 3 switched off from t = 0.5 on: loose");
  assert.equal(entryWords(entry, "s"), "sensor 3 switched off from t = 0.5 s on: loose");
  assert.equal(entryWords({ ...entry, kind: "note" }), "loose");
});

test("quarantine: what is held, and why", () => {
  const held = { source: "gauges", session: "a", seq: 7, step: 3, reason: "it came too late" };
  assert.deepEqual(asQuarantine({ quarantined: [{ ...held, time: 0.3 }, 5] }), [held]);
  assert.deepEqual(asQuarantine({ error: {} }), []);
});

test("answers of a step: fields asked for, residuals where there was a datum, samples", () => {
  const u = { step: 4, location: "nodes", values: [[1, 2, 3]] };
  assert.deepEqual(asFields(u, "sensitivity:Y0", { ...u, values: [[4, 5, 6]] }), {
    step: 4,
    displacement: [[1, 2, 3]],
    sensitivity: { Y0: [[4, 5, 6]] },
  });
  assert.deepEqual(asFields(u, "displacement", undefined), { step: 4, displacement: [[1, 2, 3]], sensitivity: {} });
  assert.deepEqual(asFields(u, "bias", u).bias, [[1, 2, 3]]);
  const observations = { step: 4, status: ["used", "missing"], reason: { 1: "not measured" } };
  assert.deepEqual(asSensors(observations, { location: "sensors", values: [1e-6, 0], missing: [1] }, undefined), {
    step: 4,
    status: ["used", "missing"],
    reason: { 1: "not measured" },
    residual: [1e-6, undefined],
  });
  assert.deepEqual(asSamples({ step: 4, samples: [[1, 2]] }), { step: 4, points: [[1, 2]] });
});

test("server-sent events are the same however the text is cut", () => {
  const text =
    "\uFEFF".slice(1) +
    ': comment\n\nid: 7\nevent: step\ndata: {"a":\ndata: 1}\r\n\r\nid: 8\rdata:x\r\rdata\n\nid: 9\n\nevent: status\ndata: é\n\nretry: 5\n\n';
  const expected = [
    { event: "step", data: '{"a":\n1}', id: "7" },
    { event: "message", data: "x", id: "8" },
    { event: "message", data: "", id: "8" },
    { event: "status", data: "é", id: "9" },
  ];
  for (let size = 1; size <= text.length; size += 1) {
    const parser = new EventParser();
    const found = [];
    for (let at = 0; at < text.length; at += size) found.push(...parser.push(text.slice(at, at + size)));
    assert.deepEqual(found, expected, `pieces of ${size}`);
    assert.equal(parser.comments, 1);
  }
});
