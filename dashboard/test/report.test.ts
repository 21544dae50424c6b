// Every figure of a report: axes with units, legends, and what is drawn equal to the record.
import assert from "node:assert/strict";
import { test } from "node:test";
import { horizontalRange, labelSize, legendOf, wordsAtTop, type ChartSpec } from "../src/chart";
import { theme } from "../src/colour";
import { chartSvg } from "../src/report/chart_svg";
import type { Content } from "../src/report/content";
import { normalQuantile } from "../src/report/curves";
import { contentSvg, contentTable } from "../src/report/figure";
import { contentOf } from "../src/report/figures";
import { smoothed } from "../src/report/densities";
import { elongations, locate } from "../src/report/maps";
import { meshReadout, meshSvg, rangeOfMesh } from "../src/report/mesh_svg";
import { modelOf, quantilesOf, type Report } from "../src/report/record";
import { prettyUnits } from "../src/format";
import { record } from "./report_record";

const light = theme(false);
const whole = record();
const last = whole.lines.length - 1;

function content(figure: string, report: Report = whole, chosen = last): Content {
  const found = contentOf(report, figure, light, chosen);
  assert.ok(found, `nothing to draw for ${figure}`);
  return found;
}
function chart(figure: string, report: Report = whole, chosen = last): ChartSpec {
  const found = content(figure, report, chosen);
  assert.ok("charts" in found);
  return found.charts[0]!;
}
function mesh(figure: string, chosen = last) {
  const found = content(figure, whole, chosen);
  assert.ok("mesh" in found);
  return found.mesh;
}
const near = (a: number | null | undefined, b: number, within = 1e-9): void =>
  assert.ok(typeof a === "number" && Math.abs(a - b) <= within * Math.max(1, Math.abs(b)), `${a} is not ${b}`);

const inference = {
  kind: "inference" as const,
  content: {
    method: "transport",
    parameters: ["a", "b"],
    mean: [1, 2],
    covariance: [
      [0.04, 0],
      [0, 0.01],
    ],
    maximum_a_posteriori: [1, 2],
    quantiles: {
      levels: [0.025, 0.5, 0.975],
      values: [
        [0.6, 1, 1.4],
        [1.8, 2, 2.2],
      ],
    },
    log_evidence: -3,
    map_order: 2,
    variance_diagnostic: 1e-4,
    tolerance: 1e-3,
    figures: {
      posterior: [0, 1].map(() => ({ points: [0, 1, 2], density: [0, 1, 0] })),
      prior: [0, 1].map(() => ({ points: [0, 2, 4], density: [0, 0.5, 0] })),
      draws: [
        [0.9, 1.1],
        [1.9, 2.1],
      ],
      map: [0, 1].map(() => ({ points: [0, 1, 2], density: [0, 0.9, 0] })),
      map_draws: [
        [0.8, 1.2],
        [1.8, 2.2],
      ],
      pull_back: [0, 1].map(() => ({ points: [-1, 0, 1], density: [0.2, 0.4, 0.2] })),
      reference: [0, 1].map(() => ({ points: [-1, 0, 1], density: [0.24, 0.4, 0.24] })),
      diagnostic_by_order: [1e-1, 1e-4],
      objective_by_order: [4, 3.1],
    },
  },
};
const comparison = {
  kind: "comparison" as const,
  contents: ["smc", "grid"].map((method) => {
    const { parameters, covariance, figures } = inference.content;
    return { method, parameters, covariance, figures: { posterior: figures.posterior } };
  }) as never,
};
const selection = {
  kind: "selection" as const,
  parameters: ["Y0"],
  prior_std: [0.4],
  all_std: [0.05],
  candidates: 30,
  curves: [
    { name: "greedy", std: [[0.2], [0.1]] },
    { name: "random", std: [[0.3], [0.25]] },
  ],
  specimen: { points: whole.specimen!.points, cells: whole.specimen!.cells },
  fields: [{ title: "Y0, x displacement", value: [0, 1e-6, 2e-6, 3e-6], units: "m", chosen: { x: [0.05], y: [0.05] } }],
};
const curves = {
  kind: "curves" as const,
  figures: [
    {
      x: [
        [0, 1],
        [0, 0.5, 1],
      ],
      y: [
        [0, 2],
        [0, 1, 3],
      ],
      labels: ["5 mm", "2 mm"],
      xLabel: "imposed displacement [mm]",
      yLabel: "force [N]",
    },
  ],
};

const study = {
  kind: "study" as const,
  faces: [{ points: whole.specimen!.points, cells: whole.specimen!.cells }],
  drawings: [
    {
      kind: "chart" as const,
      title: "Truth off by",
      x: "step [–]",
      y: "truth off by, logarithmic [std]",
      logarithmic: true,
      curves: [
        { label: "a", x: [1, 2, 3], y: [1, null, 4], points: true },
        { label: "b", x: [1, 3], y: [2, 300], colour: "red" as const, look: "points" as const },
      ],
      bands: [{ label: "a, middle 90 %", x: [1, 3], low: [0.5, 2], high: [2, 8], colour: 0 }],
      marks: [
        { label: "limit", colour: "faint" as const, y: 1000 },
        { label: "onset", x: 2 },
      ],
    },
    {
      kind: "densities" as const,
      title: "Crack length",
      label: "crack length at the end",
      units: "m",
      steps: [0, 9].map((step) => ({ step, points: [0.01, 0.02, 0.03], density: [0, 100, 0] })),
      truth: 0.02,
    },
    {
      kind: "map" as const,
      title: "Space mode 1",
      face: 0,
      label: "horizontal component, largest 1",
      units: "1",
      signed: true,
      field: { x: [0, 0.5, 1, 0.5], y: [0, 0, -2, 0] },
      sensors: [{ x: 0.05, y: 0.05, words: "chosen, horizontal" }],
    },
    { kind: "map" as const, title: "Sensors", face: 0, label: "", units: "", signed: false },
  ],
};

/** A square of two by one elements of 10 px, stretched by 1 % to the right in the second picture. */
const grid: [number, number][] = [
  [0, 0],
  [10, 0],
  [20, 0],
  [0, 10],
  [10, 10],
  [20, 10],
];
const maps = {
  kind: "maps" as const,
  unit: "px",
  labels: ["u, to the right", "v, down"] as [string, string],
  up: -1,
  points: grid,
  cells: [
    [0, 1, 4, 3],
    [1, 2, 5, 4],
  ],
  pictures: [
    { name: "a.pgm", time: 0.5, u: grid.map(() => 0.3), v: grid.map(() => -0.2), out: [], noise: 0.01 },
    { name: "b.pgm", time: 1, u: grid.map(([x]) => 0.01 * x), v: grid.map(([, y]) => 0.002 * y), out: [], noise: 0.01 },
    { name: "c.pgm", time: 2, u: [], v: [], out: [0, 1], noise: 0 },
  ],
};

const all: [Report, string[]][] = [
  [
    whole,
    "specimen measured:0 load residuals quantiles noise residual_map:x marginal:0 parameter:0 pairs forecast:crack forecast_density:crack information decisions risk evidence monitor models timing order diagnostic mode:0 crack:0 functions:0".split(
      " ",
    ),
  ],
  [inference, ["marginal:0", "pairs", "pull_back:1", "orders:diagnostic", "orders:objective"]],
  [comparison, ["marginal:1"]],
  [selection, ["curve:0", "field:0"]],
  [curves, ["curves:0"]],
  [study, ["drawing:0", "drawing:1", "drawing:2", "drawing:3"]],
  [maps, ["map:u", "map:v", "slice", "extensometer"]],
];

test("every figure has axes with units, a legend, and a drawing that is sound", () => {
  for (const [report, figures] of all)
    for (const figure of figures) {
      const found = content(figure, report, report.kind === "maps" ? 1 : last);
      const drawing = contentSvg(found, light);
      assert.doesNotMatch(drawing, /NaN|Infinity|undefined/, figure);
      // Every element is closed in order.
      const open: string[] = [];
      for (const [, close, name, self] of drawing.matchAll(/<(\/?)(\w+)[^>]*?(\/?)>/g))
        if (close) assert.equal(open.pop(), name, figure);
        else if (!self) open.push(name!);
      assert.deepEqual(open, []);
      assert.match(contentTable(found), /\r\n.*\d/, figure);
      if (!("charts" in found)) continue;
      for (const spec of found.charts) {
        assert.match(spec.yLabel, /\[.+\]$/, `${figure}: ${spec.yLabel}`);
        if (!/order of the map|number of dofs/.test(spec.xLabel))
          assert.match(spec.xLabel, /\[.+\]$/, `${figure}: ${spec.xLabel}`);
        assert.ok(legendOf(spec, undefined, light).length > 0, figure);
        for (const s of spec.series) assert.equal(s.values.length, spec.times.length, figure);
        assert.ok(drawing.includes(spec.yLabel.replace(/&/g, "&amp;").replace(/>/g, "&gt;")), figure);
      }
    }
});

test("what is not in the record is not drawn", () => {
  const { measured, residuals, sensors, specimen, load, functions, ...rest } = whole;
  void [measured, residuals, sensors, specimen, load, functions];
  for (const figure of "specimen measured:0 load residuals quantiles residual_map:x mode:0 crack:0 functions:0 measured:7 nonsense".split(
    " ",
  ))
    assert.equal(contentOf(rest, figure, light, last), undefined, figure);
});

test("edges of bands are the record's quantiles, and the legend says them", () => {
  const parameter = chart("parameter:0");
  const [low, high, median] = parameter.series;
  whole.lines.forEach((l, i) => {
    near(low!.values[i], l.quantiles.values[0]![0]!);
    near(high!.values[i], l.quantiles.values[0]![2]!);
    near(median!.values[i], l.quantiles.values[0]![1]!);
  });
  const band = legendOf(parameter, last, light).find((e) => e.look === "band")!;
  const [from, to] = band.value!.split(" … ").map(parseFloat);
  near(from, 216 * whole.lines[last]!.quantiles.values[0]![0]!, 1); // J/m³
  near(to, 216 * whole.lines[last]!.quantiles.values[0]![2]!, 1);
  assert.equal(parameter.yLabel, "Y₀ [J/m³]");
  const forecast = chart("forecast:crack");
  near(forecast.series[0]!.values[3]! * forecast.factor!, 14);
  near(forecast.series[1]!.values[3]! * forecast.factor!, 26);
  assert.match(forecast.yLabel, /\[mm\]/);
});

test("a band is drawn where its numbers are", () => {
  const spec = chart("measured:0");
  const drawing = chartSvg(spec, light, 520);
  const points = /class="band" d="M([^"]+)Z"/
    .exec(drawing)![1]!
    .split("L")
    .map((p) => p.split(" ").map(Number));
  const n = spec.times.length;
  assert.equal(points.length, 2 * n);
  // Along x by time, and 4 µm high in units of the axis: the same height everywhere.
  const [first, middle, end] = [points[0]!, points[Math.floor(n / 2)]!, points[n - 1]!];
  near(
    (middle[0]! - first[0]!) / (end[0]! - first[0]!),
    (spec.times[Math.floor(n / 2)]! - spec.times[0]!) / (spec.times[n - 1]! - spec.times[0]!),
    2e-3,
  );
  const heights = points.slice(0, n).map((p, i) => points[2 * n - 1 - i]![1]! - p[1]!);
  for (const h of heights) near(h, heights[0]!, 0.02);
  const whole_ = Math.abs(end[1]! - first[1]!);
  near(heights[0]! / whole_, 4e-6 / (1e-4 * (spec.times[n - 1]! - spec.times[0]!)), 0.02);
});

test("a measured signal: dots with their gap, in a unit of its size", () => {
  const spec = chart("measured:0");
  assert.equal(spec.yLabel, "u_y [µm]");
  const dots = spec.series.find((s) => s.dots)!;
  assert.equal(dots.values[5], null);
  near(dots.values[6], -100 * whole.lines[6]!.time);
});

test("a load curve: what lies behind the last datum is a forecast", () => {
  const spec = chart("load");
  assert.equal(spec.xLabel, "imposed displacement [mm]");
  const forecast = spec.series.find((s) => s.label === "forecast")!;
  const mean = spec.series.find((s) => s.label === "posterior mean")!;
  // The last datum is at 0.4: both curves meet there.
  assert.deepEqual(forecast.values, [null, null, 2, 1.5, 1, 0.5]);
  assert.deepEqual(mean.values, [0, 1, 2, null, null, null]);
  assert.equal(spec.vertical![0]!.at, 0.2);
  const there = record();
  there.load!.displacement = [0, 1e-4, 2e-4, 1e-4, 2e-4, 3e-4];
  const unloading = chart("load", there);
  assert.equal(unloading.xLabel, "model time t [–]");
  assert.deepEqual(unloading.times, there.load!.time);
});

test("quantiles of the standard normal, from tables", () => {
  for (const [p, z] of [
    [0.5, 0],
    [0.975, 1.959963985],
    [0.001, -3.090232306],
    [0.99, 2.326347874],
    [0.841344746, 1],
  ] as const)
    assert.ok(Math.abs(normalQuantile(p) - z) < 2e-8, `${p}`);
});

test("residuals of a standard normal lie on the line", () => {
  const n = 500;
  const value = Array.from({ length: n }, (_, i) => normalQuantile((((i * 137) % n) + 0.5) / n));
  const spec = chart("quantiles", record({ residuals: { time: value.map((_, i) => i), value } }));
  spec.times.forEach((t, i) => near(spec.series[1]!.values[i], t, 1e-9));
  assert.equal(chart("residuals").horizontal!.length, 3);
});

test("densities are those of the step looked at, over the prior", () => {
  const spec = chart("marginal:0", whole, 9);
  const front = spec.series[spec.series.length - 1]!;
  assert.equal(front.label, "step 9");
  const density = whole.lines[9]!.marginals!.Y0!;
  const at = spec.times.reduce(
    (best, t, i) =>
      Math.abs(t / 216 - density.points[50]!) < Math.abs(spec.times[best]! / 216 - density.points[50]!) ? i : best,
    0,
  );
  near(216 * front.values[at]!, density.density![50]!, 0.01); // per J/m³
  assert.equal(spec.series[0]!.label, "prior");
  assert.deepEqual(
    spec.vertical!.map((m) => [m.at, m.label]),
    [[1.05 * 216, "true value"]],
  );
  assert.equal(spec.xLabel, "Y₀ [J/m³]");
  assert.equal(spec.yLabel, "probability density [1/(J/m³)]");
  // 100 per metre is 0.1 per millimetre.
  const crack = chart("forecast_density:crack");
  near(Math.max(...crack.series[crack.series.length - 1]!.values.map((v) => v ?? 0)), 0.1, 1e-6);
  assert.equal(crack.yLabel, "probability density [1/mm]");
});

test("on paper, too, earlier densities are drawn, and dots and bars at the ends are whole", () => {
  const marginal = chart("marginal:0");
  assert.ok(marginal.series.filter((x) => x.hidden).length > 3);
  assert.equal(chartSvg(marginal, light).match(/class="line"/g)!.length, marginal.series.length);
  for (const figure of ["residuals", "information"]) {
    const spec = chart(figure);
    const [first, end] = [spec.times[0]!, spec.times[spec.times.length - 1]!];
    const [low, high] = horizontalRange(spec, first, end);
    assert.ok(low < first && high > end, figure);
    for (const [, x] of chartSvg(spec, light, 520).matchAll(/<circle cx="(\S+)"/g)) assert.ok(+x! > 68 && +x! < 506, x);
  }
  const plain = chart("monitor");
  assert.deepEqual(horizontalRange(plain, 0.1, 0.9), [0.1, 0.9]);
});

test("words at axes and marks are not cut, and do not meet", () => {
  assert.equal(labelSize("force [kN]", 180), 12);
  assert.ok(labelSize("largest displacement by the mode [mm]", 180) < 10);
  assert.equal(wordsAtTop([110], 10, 200), false);
  assert.equal(wordsAtTop([190], 10, 200), true);
  assert.equal(wordsAtTop([190, 20], 10, 200), false);
});

test("of an interval drawn as two lines the legend says both ends; a legend below another says less", () => {
  const spec: ChartSpec = {
    name: "two",
    times: [0, 1],
    series: [
      { label: "published", values: [5, null], colour: "red", dash: [5, 3], edgeOf: 1 },
      { label: "low", values: [3, null], colour: "red", bare: true },
    ],
    xLabel: "t",
    yLabel: "q",
    legend: [{ label: "prior 95 %", colour: "grey", look: "dash", once: true }],
  };
  const words = (one: ChartSpec, at: number) =>
    legendOf(one, at, light).map((e) => `${e.label} ${e.value ?? ""}`.trim());
  assert.deepEqual(words(spec, 0), ["published 3.00 … 5.00", "prior 95 %"]);
  assert.deepEqual(words({ ...spec, brief: true }, 1), ["published"]);
});

test("densities far narrower than the axis are drawn: an answer that jumps between two wrong places", () => {
  const wrong = record();
  wrong.lines.forEach((l, i) => {
    const [middle, std] = [i < 20 ? 0.5 + 2e-6 : 1.5 - 2e-6, 1e-7];
    const points = Array.from({ length: 41 }, (_, k) => middle + std * (-4 + k / 5));
    l.marginals!.Y0 = {
      points,
      density: points.map((x) => Math.exp(-0.5 * ((x - middle) / std) ** 2) / (std * Math.sqrt(2 * Math.PI))),
    };
  });
  const spec = chart("marginal:0", wrong);
  const peak = 1 / (216 * 1e-7 * Math.sqrt(2 * Math.PI));
  for (const s of spec.series.slice(1)) near(Math.max(...s.values.map((v) => v ?? 0)), peak, 1e-6);
  // Beside its points a density is 0, not a slope to the next point of the grid.
  const front = spec.series.at(-1)!;
  const beside = spec.times.filter((_, i) => front.values[i]! > 0).map((t) => Math.abs(t / 216 - 1.5));
  assert.ok(Math.max(...beside) < 5e-6);
  // And of one method beside another.
  const pair = chart("marginal:1", {
    ...comparison,
    contents: [0, 1].map((k) => ({
      ...inference.content,
      figures: {
        ...inference.content.figures,
        posterior: [0, 1].map(() => ({ points: [k, k + 1e-6, k + 2e-6], density: [0, 1e6, 0] })),
      },
    })) as never,
  });
  for (const s of pair.series) near(Math.max(...s.values.map((v) => v ?? 0)), 1e6, 1e-6);
});

test("information is the logarithm of the ratio of deviations", () => {
  const spec = chart("information");
  near(spec.series[0]!.values[8], 0.5 * Math.log(9 / 8), 1e-9);
  assert.equal(spec.series[0]!.values[0], null);
});

test("decisions: loads in the unit of what is imposed, each action by its own mark, the risk beside the allowed one", () => {
  const spec = chart("decisions");
  // Of the record: 0.5 mm imposed at time 1, so 0.1 mm at 0.2.
  assert.equal(spec.yLabel, "imposed [mm]");
  const of = (label: string) => spec.series.find((s) => s.label.startsWith(label))!;
  const at = whole.lines.findIndex((l) => l.time >= 0.2 - 1e-9);
  const { time, decision } = whole.lines[at]!;
  near(of("load to").values[at], 0.5 * decision!.time, 1e-6);
  near(of("where the specimen is").values[at], 0.5 * time, 1e-6);
  assert.equal(of("load to").values[last], null);
  near(of("hold").values[last], 0.5 * whole.lines[last]!.time, 1e-6);
  assert.equal(of("stop"), undefined);
  const risk = chart("risk");
  near(risk.series[1]!.values[5], whole.lines[5]!.decision!.failure_probability!);
  near(risk.series[0]!.values[5], 0.05);
  const { load, ...none } = whole;
  void load;
  assert.equal(chart("decisions", none as Report).yLabel, "model time t [–]");
});

test("an alarm is marked where it begins", () => {
  const spec = chart("monitor");
  assert.deepEqual(
    spec.vertical!.map((m) => m.label),
    ["alarm, step 32"],
  );
  assert.equal(spec.horizontal![0]!.at, 9.5);
});

test("the specimen: sensors at their places, the shape of the step looked at, values under the cursor", () => {
  const spec = mesh("specimen", 15);
  assert.match(spec.label, /t = 0\.2$/);
  near(rangeOfMesh(spec)[1], Math.hypot(1e-4, 2e-4));
  const drawing = meshSvg(spec, light);
  assert.equal(drawing.match(/class="sensor"/g)!.length, 2);
  assert.match(drawing, /displacement \[µm\], drawn 15\.?\d* × larger/);
  assert.match(meshReadout(spec, 0.02, 0.05), /^sensor 0, u_x at \(20\.0, 50\.0\) mm/);
  assert.match(meshReadout(spec, 0.1, 0.1), /: 223\.6 µm$/);
  assert.equal(meshReadout(spec, 5, 5), "");
});

test("a map of residuals is symmetric about 0", () => {
  const spec = mesh("residual_map:y");
  assert.deepEqual(rangeOfMesh(spec), [-2e-6, 2e-6]);
  assert.equal(spec.sensors!.length, 1);
});

test("selection: from the prior down, each curve over its own numbers", () => {
  const spec = chart("curve:0", selection);
  assert.deepEqual(spec.times, [0, 1, 2]);
  assert.deepEqual(spec.series[0]!.values, [0.4, 0.2, 0.1]);
  const plain = chart("curves:0", curves);
  assert.deepEqual(plain.series[0]!.values, [0, undefined, 2]);
  assert.deepEqual(plain.series[1]!.values, [0, 1, 3]);
});

test("the study: curves, bands and marks as its record has them, colours of the theme", () => {
  const spec = chart("drawing:0", study);
  assert.deepEqual(spec.times, [1, 2, 3]);
  assert.deepEqual(
    spec.series.map((s) => [s.label, s.values]),
    [
      ["a, middle 90 %, low", [0.5, undefined, 2]],
      ["a, middle 90 %", [2, undefined, 8]],
      ["a", [1, null, 4]],
      ["b", [2, undefined, 300]],
    ],
  );
  assert.equal(spec.series[1]!.bandTo, 0);
  assert.deepEqual(
    spec.series.map((s) => s.colour),
    [light.series[0], light.series[0], light.series[0], light.red],
  );
  assert.deepEqual([spec.horizontal![0]!.at, spec.vertical![0]!.at], [1000, 2]);
  assert.equal(spec.ticks!(2), ""); // 0.5 to 1000: powers of ten alone
  const dark = theme(true);
  const other = contentOf(study, "drawing:0", dark, 0);
  assert.ok(other && "charts" in other);
  assert.equal(other.charts[0]!.series[3]!.colour, dark.red);
  const crack = chart("drawing:1", study);
  assert.equal(crack.xLabel, "crack length at the end [mm]");
  near(Math.max(...crack.series.at(-1)!.values.map((v) => v ?? 0)), 0.1);
  assert.deepEqual(
    crack.vertical!.map((m) => m.at),
    [20],
  );
  // Moved so that its largest component is 3 % of the length.
  const mode = content("drawing:2", study);
  assert.ok("mesh" in mode);
  const length =
    Math.max(...study.faces[0]!.points.map((p) => p[0])) - Math.min(...study.faces[0]!.points.map((p) => p[0]));
  near(mode.mesh.shift!.y[2], -0.03 * length);
  assert.deepEqual(rangeOfMesh(mode.mesh), [-1, 1]);
  assert.equal(contentOf(study, "drawing:9", light, 0), undefined);
});

test("elements of one colour are one path, and cover what they did apart", () => {
  const [nx, ny] = [40, 30];
  const points: [number, number][] = [];
  for (let j = 0; j <= ny; j += 1) for (let i = 0; i <= nx; i += 1) points.push([i, j]);
  const cells = Array.from({ length: nx * ny }, (_, e) => {
    const first = (e % nx) + (nx + 1) * Math.floor(e / nx);
    return [first, first + 1, first + nx + 2, first + nx + 1];
  });
  const drawing = meshSvg(
    { title: "t", points, cells, value: points.map(([x]) => (x < 20 ? 0 : 1)), label: "", units: "1" },
    light,
  );
  assert.ok(drawing.match(/<path/g)!.length <= 49);
  assert.ok(drawing.match(/M[\d.]+ [\d.]+L/g)!.length >= nx * ny);
});

test("a line on a map: values along it, and how much longer it becomes", () => {
  // A shift makes nothing longer; a strain of 1 % makes 15 px longer by 0.15 px.
  const along = elongations(maps, [2, 5, 17, 5]);
  near(along[0], 0, 1e-12);
  near(along[1], 0.15, 1e-9);
  assert.equal(along[2], null);
  // Upwards: v is down, y up.
  near(elongations(maps, [5, 1, 5, 9])[1], -0.016, 1e-9);
  assert.equal(elongations(maps, [-5, 5, 15, 5])[1], null);
  const place = locate(maps, 12, 7)!;
  assert.equal(place.cell, 1);
  near(
    place.weights.reduce((sum, w, k) => sum + w * grid[place.nodes[k]!]![0], 0),
    12,
    1e-12,
  );
  const found = contentOf(maps, "slice", light, 1, [0, 5, 20, 5]);
  assert.ok(found && "charts" in found);
  const [low, high, u] = found.charts[0]!.series;
  found.charts[0]!.times.forEach((x, i) => {
    near(u!.values[i], 0.01 * x, 1e-9);
    near(high!.values[i]! - low!.values[i]!, 0.04, 1e-9);
  });
  assert.equal(contentOf(maps, "map:u", light, 2)!.hasOwnProperty("mesh"), true);
  const drawn = contentSvg(content("map:u", maps, 1), light);
  assert.match(drawn, /class="probe"/);
  assert.match(drawn, /class="noise"/);
  // All to the right, from 0 on: the range is the field's own.
  const shown = content("map:u", maps, 1);
  assert.ok("mesh" in shown);
  assert.deepEqual(rangeOfMesh(shown.mesh), [0, 0.2]);
});

test("the model of the live page is made from the summary", () => {
  const model = modelOf(whole);
  assert.equal(model.parameters[0]!.name, "Y₀");
  assert.equal(model.quantities[0]!.threshold, 0.025);
  const [low, middle, high] = model.parameters[0]!.values!;
  near(low, 0.9 - 1.96 * 0.4, 2e-3);
  near(middle, 0.9, 1e-3);
  near(high, 0.9 + 1.96 * 0.4, 2e-3);
  assert.deepEqual(quantilesOf({ points: [0, 1], density: [1, 1] }, [0.25, 1]), [0.25, 1]);
  assert.equal(prettyUnits("J/m3"), "J/m³");
  assert.equal(prettyUnits("1"), "");
});

test("a table is in the units of the axes", () => {
  const [header, first] = contentTable(content("load")).split("\r\n");
  assert.match(header!, /imposed displacement \[mm\],reaction force \[kN\]: low,/);
  assert.ok(first!.startsWith("0,0,0,0"));
});

test("axes of time have the solver's unit where it states one", () => {
  assert.equal(chart("parameter:0").xLabel, "model time t [–]");
  const timed = { ...whole, time_units: "s" };
  for (const figure of ["parameter:0", "forecast:crack", "residuals", "information", "timing"])
    assert.equal(chart(figure, timed).xLabel, "model time t [s]", figure);
  const place = content("specimen", timed);
  assert.ok("mesh" in place && place.mesh.label.endsWith("t = 0.2 s"), "mesh" in place ? place.mesh.label : "");
  // What is over something else stays so.
  assert.equal(chart("load", timed).xLabel, chart("load").xLabel);
  assert.equal(chart("parameter:0", { ...whole, time_units: "1" }).xLabel, "model time t [–]");
});

test("an inference is drawn in the units that its model states", () => {
  const content = {
    ...inference.content,
    physical: { a: { mean: 2e9, std: 4e8, units: "Pa" }, b: { mean: 2, std: 0.1 } },
  };
  const spec = chart("marginal:0", { ...inference, content } as never);
  assert.equal(spec.xLabel, "a [GPa]");
  assert.equal(spec.yLabel, "probability density [1/GPa]");
  near(spec.vertical![0]!.at, 2, 1e-12);
  near(Math.max(...spec.times), 8, 1e-9);
  const drawn = contentOf({ ...inference, content } as never, "pairs", light, 0, undefined)!;
  assert.ok("pairs" in drawn);
  const [header, , second] = contentTable(drawn).split("\r\n");
  assert.equal(header, "a [GPa],b");
  near(Number(second!.split(",")[0]), 2.2, 1e-12);
  assert.equal(
    chart("marginal:1", { ...inference, content } as never).xLabel,
    "b [unit of the project file]",
    "not known is not none",
  );
});

test("what was observed is drawn beside its prediction; values of several kinds as residuals alone", () => {
  const of = (observations: object): ChartSpec[] => {
    const figures = { ...inference.content.figures, observations };
    const drawn = content("observations", { ...inference, content: { ...inference.content, figures } } as never);
    assert.ok("charts" in drawn);
    return drawn.charts;
  };
  const residual = [0.5, -1];
  const [values, residuals] = of({ residual, measured: [1.1, 2], predicted: [1, 2.4], std: [0.2, 0.4] });
  const [low, high, predicted, measured] = values!.series;
  near(low!.values[1]!, 2.4 - 1.96 * 0.4);
  near(high!.values[1]!, 2.4 + 1.96 * 0.4);
  assert.deepEqual(
    [predicted!, measured!].map((s) => [s.label, s.values]),
    [
      ["predicted", [1, 2.4]],
      ["measured", [1.1, 2]],
    ],
  );
  assert.deepEqual(residuals!.series[0]!.values, residual);
  assert.deepEqual(
    of({ residual }).map((spec) => spec.yLabel),
    ["standardised residual [σ]"],
  );
});

test("a density of draws is smooth, hardly wider, and keeps its bounds and modes", () => {
  const points = Array.from({ length: 161 }, (_, i) => -4 + i / 20);
  const maxima = (values: readonly number[]) =>
    values.filter((v, i) => i > 0 && i < values.length - 1 && v > values[i - 1]! && v > values[i + 1]!).length;
  const deviation = (values: readonly number[]) => {
    const mass = values.reduce((a, b) => a + b, 0);
    return Math.sqrt(values.reduce((sum, v, i) => sum + v * points[i]! ** 2, 0) / mass);
  };
  const normal = points.map((x) => Math.exp(-0.5 * x * x));
  const jagged = normal.map((v, i) => v * (1 + 0.1 * Math.sin(1.3 * i)));
  assert.ok(maxima(jagged) > 5);
  const smooth = smoothed({ points, density: jagged }).density!;
  assert.equal(maxima(smooth), 1);
  near(deviation(smooth) / deviation(normal), 1.03, 0.01);
  const flat = smoothed({ points, density: points.map(() => 1) }).density!;
  near(flat[0]!, 1, 1e-12);
  const two = smoothed({
    points,
    density: points.map((x) => Math.exp(-8 * (x - 2) ** 2) + Math.exp(-8 * (x + 2) ** 2)),
  });
  assert.equal(maxima(two.density!), 2);
  assert.ok(two.density![80]! < 0.01);
});
