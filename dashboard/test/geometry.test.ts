import assert from "node:assert/strict";
import { test } from "node:test";
import { fit, front, oblique, project, rotation, roundLength, roundUp, type Vec3 } from "../src/camera";
import { colourAt, stateLook, theme } from "../src/colour";
import { viewOf } from "../src/field";
import { boxOf, displayFactor, rangeOf, scalars, shapeOf, surfaceOf } from "../src/mesh";
import { axisOf, correlation, ellipse, isNarrow, smoothDensity } from "../src/pair";
import { stepLine } from "./support";

/** nx × ny × nz bricks of size 1. */
function bricks(nx: number, ny: number, nz: number) {
  const points: number[][] = [];
  const at = (i: number, j: number, k: number): number => i + (nx + 1) * (j + (ny + 1) * k);
  for (let k = 0; k <= nz; k += 1)
    for (let j = 0; j <= ny; j += 1) for (let i = 0; i <= nx; i += 1) points.push([i, j, k]);
  const cells: number[][] = [];
  for (let k = 0; k < nz; k += 1)
    for (let j = 0; j < ny; j += 1)
      for (let i = 0; i < nx; i += 1)
        cells.push([
          at(i, j, k),
          at(i + 1, j, k),
          at(i + 1, j + 1, k),
          at(i, j + 1, k),
          at(i, j, k + 1),
          at(i + 1, j, k + 1),
          at(i + 1, j + 1, k + 1),
          at(i, j + 1, k + 1),
        ]);
  return { type: "VTK_HEXAHEDRON", points, cells };
}

test("the surface of bricks: inner faces are gone, Euler's formula holds, area and volume are right", () => {
  const mesh = bricks(3, 2, 2);
  const surface = surfaceOf(mesh);
  const faces = surface.triangles.length / 6;
  assert.equal(faces, 2 * (3 * 2 + 3 * 2 + 2 * 2));
  assert.equal(surface.nodes.length - surface.edges.length / 2 + faces, 2);
  let area = 0;
  let volume = 0;
  for (let t = 0; t < surface.triangles.length; t += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => mesh.points[surface.triangles[t + k]!]!) as [number[], number[], number[]];
    const u = b.map((v, k) => v - a[k]!);
    const v = c.map((w, k) => w - a[k]!);
    const n = [u[1]! * v[2]! - u[2]! * v[1]!, u[2]! * v[0]! - u[0]! * v[2]!, u[0]! * v[1]! - u[1]! * v[0]!];
    area += Math.hypot(...n) / 2;
    volume += (a[0]! * n[0]! + a[1]! * n[1]! + a[2]! * n[2]!) / 6;
  }
  assert.ok(Math.abs(area - 32) < 1e-12);
  assert.ok(Math.abs(volume - 12) < 1e-12, "all faces look outward");
});

test("other shapes: a tetrahedron, two triangles, a wedge with a pyramid's names", () => {
  const tetra = surfaceOf({
    type: "tetra10",
    points: [
      [0, 0, 0],
      [1, 0, 0],
      [0, 1, 0],
      [0, 0, 1],
    ],
    cells: [[0, 1, 2, 3]],
  });
  assert.equal(tetra.triangles.length / 3, 4);
  const flat = surfaceOf({
    type: "VTK_TRIANGLE",
    points: [
      [0, 0, 0],
      [1, 0, 0],
      [0, 1, 0],
      [1, 1, 0],
    ],
    cells: [
      [0, 1, 2],
      [1, 3, 2],
    ],
  });
  assert.equal(flat.triangles.length / 3, 2);
  assert.equal(flat.edges.length / 2, 5);
  for (const [name, shape] of [
    ["VTK_QUADRATIC_HEXAHEDRON", "hexahedron"],
    ["hexahedron27", "hexahedron"],
    ["VTK_TETRA", "tetra"],
    ["VTK_TRIQUADRATIC_HEXAHEDRON", "hexahedron"],
    ["wedge", "wedge"],
    ["quad8", "quad"],
  ])
    assert.equal(shapeOf(name!), shape);
  assert.equal(surfaceOf({ type: "VTK_POLYHEDRON", points: [], cells: [[0, 1]] }).triangles.length, 0);
});

test("turning is a rotation; the front view has x to the right and y up", () => {
  const [r, u, o] = rotation(oblique);
  const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  for (const [a, b, expected] of [
    [r, r, 1],
    [u, u, 1],
    [o, o, 1],
    [r, u, 0],
    [u, o, 0],
    [r, o, 0],
  ] as const)
    assert.ok(Math.abs(dot(a, b) - expected) < 1e-15);
  const box = boxOf([
    [0, 0, 0],
    [2, 1, 0.1],
  ]);
  const view = { width: 400, height: 300, foot: 50 };
  const scale = fit(box, front, view);
  const corner = project([2, 1, 0.05], box, front, view, scale);
  const centre = project([1, 0.5, 0.05], box, front, view, scale);
  assert.deepEqual(centre.slice(0, 2), [200, 125]);
  assert.ok(corner[0] > 370 && corner[0] < 400 && corner[1] < 125);
  for (const x of [0, 2])
    for (const y of [0, 1])
      for (const z of [0, 0.1]) {
        const [px, py] = project([x, y, z], box, oblique, view, fit(box, oblique, view));
        assert.ok(px >= 0 && px <= 400 && py >= 0 && py <= 250, "everything fits, however it is turned");
      }
});

test("round numbers", () => {
  assert.deepEqual([0.0012, 0.9, 1, 3.2, 7.1, 0].map(roundUp), [0.0015, 1, 1, 5, 10, 1]);
  assert.ok(Math.abs(roundLength(90, 1000) - 0.05) < 1e-15);
});

test("fields: magnitude, components, ranges with 0 in the middle", () => {
  assert.deepEqual(
    [
      ...scalars(
        [
          [3, 4, 0],
          [0, -2, 0],
        ],
        "magnitude",
      ),
    ],
    [5, 2],
  );
  assert.deepEqual(
    [
      ...scalars(
        [
          [3, 4, 0],
          [0, -2, 0],
        ],
        "y",
      ),
    ],
    [4, -2],
  );
  assert.deepEqual(rangeOf([1, -3], true), { low: -3, high: 3 });
  assert.deepEqual(rangeOf([1, 3], false), { low: 0, high: 3 });
  assert.deepEqual(rangeOf([], true), { low: 0, high: 1 });
  const box = boxOf([
    [0, 0, 0],
    [0.3, 0.1, 0.01],
  ]);
  assert.equal(displayFactor([[1e-4, 0, 0]], box), 100);
  assert.equal(displayFactor([[0, 0, 0]], box), 1);
});

test("what the field view shows of a step, and why it shows nothing", () => {
  const fields = { step: 1, displacement: [[1e-4, -2e-4, 0]], sensitivity: { Y0: [[0, 3e-6, 0]] } };
  const sensors = { step: 1, status: ["used", "missing", "used"], reason: {}, residual: [-1.2e-6, undefined, 4.1e-6] };
  const u = viewOf("displacement", "y", fields, sensors, [1e-6, 1e-6, 1e-6]);
  assert.equal(u.map, "signed");
  assert.deepEqual(u.range, { low: -roundUp(2e-4), high: roundUp(2e-4) });
  assert.equal(u.scale.units, "µm");
  assert.equal(viewOf("sensitivity:Y0", "magnitude", fields, sensors, [1e-6, 1e-6, 1e-6]).map, "viridis");
  const residual = viewOf("residual", "magnitude", fields, sensors, [1e-6, 1e-6, 1e-6]);
  assert.equal(residual.sensors![1], undefined);
  assert.ok(
    Math.abs(residual.sensors![0]! + 1.2) < 1e-12 && Math.abs(residual.sensors![2]! - 4.1) < 1e-12,
    "in standard deviations",
  );
  assert.equal(viewOf("residual", "magnitude", fields, sensors, []).scale.units, "µm");
  assert.deepEqual(residual.range, { low: -5, high: 5 });
  assert.match(viewOf("bias", "x", fields, sensors, [1e-6, 1e-6, 1e-6]).problem!, /No correction of the model's bias/);
  assert.ok(viewOf("bias", "x", { ...fields, bias: [[1e-6, 0, 0]] }, sensors, []).nodes);
  assert.equal(viewOf("sensitivity:nu", "x", fields, sensors, []).nodes, undefined, "not asked for yet");
});

test("the ellipse of 95 % has its points at the right distance in the metric of the covariance", () => {
  const line = stepLine(0);
  const [[a, b], [, d]] = line.covariance as [[number, number], [number, number]];
  const determinant = a * d - b * b;
  for (const [x, y] of ellipse(line, 0, 1, 0.95)) {
    const [u, v] = [x - 1, y - 2];
    const squared = (d * u * u - 2 * b * u * v + a * v * v) / determinant;
    assert.ok(Math.abs(squared - 5.991464547107979) < 1e-9, "the chi-squared quantile of two degrees of freedom");
  }
  assert.ok(Math.abs(correlation(line, 0, 1) - 0.3) < 1e-12);
});

test("axes of the pair plot, and its densities", () => {
  const line = stepLine(0);
  assert.deepEqual(axisOf(0, line, { name: "a", lower: 0.5, upper: 1.5 }, true), { low: 0.5, high: 1.5 });
  assert.deepEqual(axisOf(1, line, { name: "b", lower: 0.5, upper: 2.2 }, false), { low: 2 - 4.5 * 0.1, high: 2.2 });
  assert.equal(isNarrow(line, [{ name: "a", lower: 0, upper: 100 }]), true);
  assert.equal(isNarrow(line, [{ name: "a", lower: 0.5, upper: 1.5 }]), false);
  const mass = (heights: readonly number[], low: number, high: number): number =>
    (heights.reduce((a, b) => a + b, 0) * (high - low)) / (heights.length - 1);
  const normal = Array.from({ length: 999 }, (_, i) => Math.log((i + 1) / (999 - i)) / 1.702);
  const heights = smoothDensity(normal, { low: -5, high: 5 }, 121);
  assert.ok(Math.abs(mass(heights, -5, 5) - 1) < 1e-3, "a density");
  const peak = heights.indexOf(Math.max(...heights));
  assert.equal(peak, 60);
  heights.forEach((h, i) =>
    assert.ok(i === 0 || (i <= peak ? h >= heights[i - 1]! : h <= heights[i - 1]!), "one peak"),
  );
  const flat = smoothDensity(
    Array.from({ length: 500 }, (_, i) => (i + 0.5) / 500),
    { low: 0, high: 1 },
    101,
  );
  flat.forEach((h) => assert.ok(Math.abs(h - 1) < 0.03, "no fall towards a bound"));
  assert.ok(Math.abs(mass(smoothDensity([0.1, 0.1, 0.6, 5], { low: 0, high: 1 }, 101), 0, 1) - 0.75) < 0.05, "cut");
});

/** Relative luminance, WCAG 2. */
function luminance(hex: string): number {
  const [r, g, b] = [1, 3, 5]
    .map((k) => parseInt(hex.slice(k, k + 2), 16) / 255)
    .map((c) => (c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4)) as [number, number, number];
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

function contrast(a: string, b: string): number {
  const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y) as [number, number];
  return (high + 0.05) / (low + 0.05);
}

test("text can be read (WCAG AA, 4.5), lines can be seen (3) in light and dark", () => {
  for (const look of [theme(false), theme(true)]) {
    for (const ink of [look.text, look.faint])
      assert.ok(contrast(ink, look.panel) >= 4.5, `${ink} on ${look.panel}: ${contrast(ink, look.panel)}`);
    for (const line of [
      look.blue,
      look.orange,
      look.green,
      look.red,
      look.purple,
      look.prior,
      look.threshold,
      ...look.series,
    ])
      assert.ok(contrast(line, look.panel) >= 3, `${line} on ${look.panel}: ${contrast(line, look.panel)}`);
  }
  for (const [word, { colour, ink }] of Object.entries(stateLook))
    assert.ok(contrast(colour, ink) >= 4.5, `${word}: ${contrast(colour, ink)}`);
});

test("colour maps: ends, middle, and what is outside", () => {
  assert.deepEqual(colourAt("viridis", 0), [68, 1, 84]);
  assert.deepEqual(colourAt("viridis", 2), [253, 231, 37]);
  assert.deepEqual(colourAt("signed", 0.5), [247, 247, 247]);
  assert.deepEqual(colourAt("signed", NaN), colourAt("signed", 0));
});
