import assert from "node:assert/strict";
import { test } from "node:test";
import { aligned, commonTimes, comparedRows, comparisonSpecs, held, overlap } from "../src/comparison";
import type { StepLine } from "../src/types";
import { theme } from "../src/colour";
import { stepLine } from "./support";

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

test("the overlap of two normal densities, from tables of their distribution", () => {
  const near = (value: number, exact: number): void => assert.ok(Math.abs(value - exact) < 1e-5, `${value}: ${exact}`);
  near(overlap({ mean: 3, std: 2 }, { mean: 3, std: 2 }), 1);
  near(overlap({ mean: 0, std: 1 }, { mean: 2, std: 1 }), 0.3173105); // 2 Φ(−1)
  near(overlap({ mean: 0, std: 1 }, { mean: 0, std: 2 }), 0.6773254); // they cross at ±√(8 ln 2 / 3)
  near(overlap({ mean: 0, std: 2 }, { mean: 0, std: 1 }), 0.6773254);
  near(overlap({ mean: 0, std: 1 }, { mean: 1e3, std: 1 }), 0);
});

test("two tests in numbers: difference with its spread, in physical units", () => {
  const at = (mean: number) => [stepLine(0, { mean: [mean, 2] })];
  const sides = [
    { label: "a", lines: at(1) },
    { label: "b", lines: at(1.4) },
  ] as const;
  const model = { parameters: [{ name: "E", reference: { value: 30e9, units: "Pa" } }, { name: "n" }], quantities: [] };
  const [first, second, third, ...more] = comparedRows(sides, model, [{ name: "crack", units: "m", horizon: 0.3 }]);
  assert.deepEqual(first, {
    name: "E",
    units: "GPa",
    here: "30.0 ± 6.0",
    other: "42.0 ± 6.0",
    difference: "−12.0 ± 8.5 (1.4 σ)",
    overlap: "32 %",
  });
  assert.equal(second!.overlap, "> 99.9 %");
  assert.deepEqual([third!.name, third!.units, third!.here], ["crack at t = 0.3", "mm", "20.0 ± 3.0"]);
  assert.equal(more.length, 0);
  // Beside a result that is not to be used.
  const verdict = { level: "reject" as const, reasons: [] };
  const doubted = sides.map((side, k) => ({
    ...side,
    lines: k === 0 ? side.lines : side.lines.map((l) => ({ ...l, verdict })),
  })) as unknown as typeof sides;
  const [only] = comparedRows(doubted, model, []);
  assert.deepEqual([only!.here, only!.other, only!.difference], ["30.0 ± 6.0", "42", "−12 (1.4 σ)"]);
});
