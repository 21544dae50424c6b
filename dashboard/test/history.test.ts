import assert from "node:assert/strict";
import { test } from "node:test";
import { bandsOf, column, History, medianPeriod, mostSteps, phasesOf, quantile, timeline } from "../src/history";
import { stepLine } from "./support";

test("lines are kept in order of steps, a later line for a step replaces the earlier", () => {
  const history = new History();
  for (const step of [0, 3, 1, 2, 5]) history.add(stepLine(step));
  history.add(stepLine(2, { used: 99 }));
  assert.deepEqual(
    history.lines.map((l) => l.step),
    [0, 1, 2, 3, 5],
  );
  assert.equal(history.find(2)?.used, 99);
  assert.equal(history.find(4), undefined);
  assert.equal(history.latest?.step, 5);
  assert.equal(history.nearest(0.0449)?.step, 3);
});

test("a step whose data were withdrawn is forgotten", () => {
  const history = new History();
  for (const step of [0, 1, 2]) history.add(stepLine(step));
  const { version } = history;
  history.remove(1);
  history.remove(7);
  assert.deepEqual(
    history.lines.map((l) => l.step),
    [0, 2],
  );
  assert.equal(history.version, version + 1);
});

test("the oldest steps are forgotten when there are too many", () => {
  const history = new History();
  for (let step = 0; step < mostSteps + 10; step += 1) history.add(stepLine(step));
  assert.equal(history.lines.length, mostSteps);
  assert.equal(history.lines[0]?.step, 10);
});

test("a step without a datum is a gap, from the last datum to the next", () => {
  const lines = [0, 1, 2, 3, 4].map((step) => stepLine(step, step === 2 || step === 3 ? { used: 0, missing: 10 } : {}));
  const { rows, gaps } = timeline(lines);
  assert.deepEqual(gaps, [{ from: 0.02, to: 0.05, cause: "no datum" }]);
  assert.deepEqual(
    column(rows, (l) => l.mean[0]),
    [1, 1, null, null, 1],
  );
});

test("steps that never came are a gap, by number and by time", () => {
  const byNumber = timeline([stepLine(0), stepLine(1), stepLine(4), stepLine(5)]);
  assert.deepEqual(byNumber.gaps, [{ from: 0.02, to: 0.05, cause: "no step" }]);
  assert.deepEqual(
    byNumber.rows.map((r) => r.line?.step),
    [0, 1, undefined, 4, 5],
  );
  const renumbered = [0, 1, 2, 3].map((k) => stepLine(k, { time: [0.01, 0.02, 0.05, 0.06][k]! }));
  assert.equal(timeline(renumbered).gaps.length, 1);
  assert.equal(timeline([stepLine(0), stepLine(1), stepLine(2)]).gaps.length, 0);
  assert.equal(timeline([]).rows.length, 0);
  assert.equal(medianPeriod([stepLine(0)]), Infinity);
});

test("numbers that are not finite are gaps too", () => {
  const { rows } = timeline([stepLine(0), stepLine(1)]);
  assert.deepEqual(
    column(rows, (l) => (l.step ? NaN : 2)),
    [2, null],
  );
});

test("levels make symmetric bands, outermost first, in whatever order they come", () => {
  const bands = bandsOf([0.5, 0.975, 0.025, 0.25, 0.75]);
  assert.deepEqual(bands.pairs, [
    { low: 2, high: 1, percent: 95 },
    { low: 3, high: 4, percent: 50 },
  ]);
  assert.equal(bands.middle, 0);
  assert.equal(bandsOf([0.05, 0.95]).middle, undefined);
  assert.deepEqual(bandsOf([]).pairs, []);
});

test("phases do not count a sum beside its parts", () => {
  assert.deepEqual(phasesOf({ update: 3, forecast: 1, total: 4, projection: 1, map: 2 }), [
    "forecast",
    "projection",
    "map",
  ]);
  assert.deepEqual(phasesOf({ update: 3, forecast: 1, total: 4 }), ["update", "forecast"]);
});

test("quantiles interpolate between order statistics", () => {
  assert.equal(quantile([4, 1, 3, 2], 0.5), 2.5);
  assert.equal(quantile([5], 0.99), 5);
  assert.equal(quantile([], 0.5), undefined);
});
