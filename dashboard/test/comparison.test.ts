import assert from "node:assert/strict";
import { test } from "node:test";
import { aligned, commonTimes, comparisonSpecs, held } from "../src/comparison";
import type { StepLine } from "../src/types";
import { theme } from "../src/colour";

const line = (step: number, time: number, median: number, used = 4): StepLine =>
  ({
    step,
    time,
    used,
    mean: [median],
    quantiles: { levels: [0.025, 0.5, 0.975], values: [[median - 1, median, median + 1]] },
    forecast: { crack: { levels: [0.025, 0.5, 0.975], values: [0.01 * median, 0.02 * median, 0.03 * median] } },
  }) as unknown as StepLine;

test("two tests are drawn over all times of both; a time of one alone is no gap of the other", () => {
  const a = { label: "b", lines: [line(0, 0, 1), line(1, 1, 2), line(2, 2, 3), line(3, 3, 4)] };
  const b = { label: "a", lines: [line(0, 0, 5), line(2, 2, 6, 0), line(4, 4, 7)] };
  const [parameter, crack] = comparisonSpecs(
    [a, b],
    undefined,
    [{ name: "crack", units: "m", threshold: 0.1 }],
    theme(false),
  );
  assert.deepEqual(parameter!.times, [0, 1, 2, 3, 4]);
  const median = (spec: typeof parameter, label: string) => spec!.series.find((s) => s.label === `${label}: median`)!;
  assert.deepEqual(median(parameter, "b").values, [1, 2, 3, 4, undefined]);
  assert.deepEqual(median(parameter, "a").values, [5, undefined, null, undefined, 7]);
  assert.equal(crack!.factor, 1e3);
  assert.match(crack!.yLabel, /crack.*\[mm\]/);
  assert.deepEqual(
    crack!.horizontal!.map((m) => m.label),
    ["threshold 100 mm"],
  );
});

test("values are held where the other test alone has a time, and end where the test ends", () => {
  assert.deepEqual(held([undefined, 1, undefined, null, undefined, 2, undefined]), [
    undefined,
    1,
    1,
    null,
    null,
    2,
    undefined,
  ]);
  const rows = [
    { time: 0, line: line(0, 0, 1) },
    { time: 2, line: undefined },
  ];
  const times = commonTimes([
    { rows },
    {
      rows: [
        { time: 1, line: undefined },
        { time: 2 + 1e-9, line: undefined },
      ],
    },
  ]);
  assert.deepEqual(times, [0, 1, 2]);
  assert.deepEqual(
    aligned(times, rows, (l) => l.mean[0]),
    [1, undefined, null],
  );
});
