/** Displacements from pictures: maps, values along a line, and the line as an extensometer. Pure. */
import type { ChartSpec } from "../chart";
import type { Theme } from "../colour";
import { axisLabel, scaleFor } from "../format";
import { charts, type Content } from "./content";
import type { Maps, Probe } from "./record";

const slicePoints = 200;

/** Across the middle, an eighth from either end. */
export function firstProbe(r: Maps): Probe {
  const xs = r.points.map((p) => p[0]);
  const ys = r.points.map((p) => p[1]);
  const ends = (v: readonly number[]): [number, number] => [
    v.reduce((a, b) => Math.min(a, b), Infinity),
    v.reduce((a, b) => Math.max(a, b), -Infinity),
  ];
  const [x0, x1] = ends(xs);
  const [y0, y1] = ends(ys);
  const y = 0.5 * (y0 + y1);
  return [x0 + (x1 - x0) / 8, y, x1 - (x1 - x0) / 8, y];
}

/** The triangle that holds a place, and the weights of its corners; quadrilaterals are two triangles. */
export function locate(
  r: Maps,
  x: number,
  y: number,
): { cell: number; nodes: number[]; weights: number[] } | undefined {
  for (let cell = 0; cell < r.cells.length; cell += 1) {
    const corners = r.cells[cell]!;
    for (let k = 2; k < corners.length; k += 1) {
      const nodes = [corners[0]!, corners[k - 1]!, corners[k]!];
      const [a, b, c] = nodes.map((n) => r.points[n]!) as [[number, number], [number, number], [number, number]];
      const area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
      const second = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area;
      const third = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area;
      const weights = [1 - second - third, second, third];
      if (weights.every((w) => w >= -1e-9)) return { cell, nodes, weights };
    }
  }
  return undefined;
}

type Component = "u" | "v";

/** At a place of a picture; nothing outside, or where an element is out. */
function valueAt(r: Maps, picture: number, component: Component, place: ReturnType<typeof locate>): number | null {
  const p = r.pictures[picture];
  if (!place || !p || p[component].length === 0 || p.out.includes(place.cell)) return null;
  return place.nodes.reduce((sum, n, k) => sum + place.weights[k]! * p[component][n]!, 0);
}

function map(r: Maps, component: Component, chosen: number, probe: Probe): Content | undefined {
  const p = r.pictures[chosen];
  if (!p) return undefined;
  const out = new Set(p.out);
  const values = p[component];
  const there = values.length > 0;
  return {
    mesh: {
      title: `${r.labels[component === "u" ? 0 : 1]}, ${p.name}`,
      points: r.points,
      cells: r.cells.filter((_, e) => !out.has(e)),
      ...(there ? { value: values } : {}),
      label: `${r.labels[component === "u" ? 0 : 1]}, ${p.name}${there ? "" : ": not measured"}`,
      units: r.unit,
      // A field that is of one sign is seen by its differences.
      signed: values.some((v) => v < 0) && values.some((v) => v > 0),
      noise: p.noise,
      probe,
    },
  };
}

function slice(r: Maps, chosen: number, [x0, y0, x1, y1]: Probe, theme: Theme): ChartSpec {
  const p = r.pictures[chosen]!;
  const along = Array.from({ length: slicePoints + 1 }, (_, i) => i / slicePoints);
  const places = along.map((s) => locate(r, x0 + s * (x1 - x0), y0 + s * (y1 - y0)));
  const values = (c: Component): (number | null)[] => places.map((place) => valueAt(r, chosen, c, place));
  const [u, v] = [values("u"), values("v")];
  const length = Math.hypot(x1 - x0, y1 - y0);
  const across = scaleFor(r.unit, length);
  const up = scaleFor(
    r.unit,
    [...u, ...v].reduce<number>((a, b) => Math.max(a, Math.abs(b ?? 0)), 0),
  );
  const scaled = (list: (number | null)[], by = 0): (number | null)[] =>
    list.map((x) => (x === null ? null : (x + by) * up.factor));
  const two = 2 * p.noise;
  return {
    name: "slice",
    times: along.map((s) => s * length * across.factor),
    series: [
      { label: "low", values: scaled(u, -two), colour: theme.blue, hidden: true },
      { label: `${r.labels[0]}, ± 2 of its noise`, values: scaled(u, two), colour: theme.blue, bandTo: 0 },
      { label: r.labels[0], values: scaled(u), colour: theme.blue },
      { label: "low", values: scaled(v, -two), colour: theme.orange, hidden: true },
      { label: `${r.labels[1]}, ± 2 of its noise`, values: scaled(v, two), colour: theme.orange, bandTo: 3 },
      { label: r.labels[1], values: scaled(v), colour: theme.orange },
    ],
    xLabel: axisLabel("along the line", across.units),
    yLabel: axisLabel("displacement", up.units),
    height: 240,
    sync: "",
  };
}

/** How much longer the line is than in the reference, picture by picture. */
export function elongations(r: Maps, [x0, y0, x1, y1]: Probe): (number | null)[] {
  const [a, b] = [locate(r, x0, y0), locate(r, x1, y1)];
  return r.pictures.map((_, k) => {
    const [ua, va, ub, vb] = [
      valueAt(r, k, "u", a),
      valueAt(r, k, "v", a),
      valueAt(r, k, "u", b),
      valueAt(r, k, "v", b),
    ];
    if (ua === null || va === null || ub === null || vb === null) return null;
    const now = Math.hypot(x1 - x0 + ub - ua, y1 - y0 + r.up * (vb - va));
    return now - Math.hypot(x1 - x0, y1 - y0);
  });
}

function extensometer(r: Maps, probe: Probe, theme: Theme): ChartSpec {
  const values = elongations(r, probe);
  const up = scaleFor(
    r.unit,
    values.reduce<number>((a, b) => Math.max(a, Math.abs(b ?? 0)), 0),
  );
  // Of the difference of two displacements.
  const two = r.pictures.map((p) => 2 * Math.SQRT2 * p.noise);
  const edge = (sign: number): (number | null)[] =>
    values.map((v, k) => (v === null ? null : (v + sign * two[k]!) * up.factor));
  return {
    name: "extensometer",
    times: r.pictures.map((p) => p.time),
    series: [
      { label: "low", values: edge(-1), colour: theme.green, hidden: true },
      { label: "± 2 of its noise", values: edge(1), colour: theme.green, bandTo: 0 },
      { label: "elongation", values: edge(0), colour: theme.green, points: true },
    ],
    xLabel: "time of the picture [–]",
    yLabel: axisLabel("elongation of the line", up.units),
    height: 240,
    sync: "pictures",
  };
}

export function mapsContent(
  r: Maps,
  name: string,
  of: string,
  theme: Theme,
  chosen: number,
  probe: Probe,
): Content | undefined {
  if (!r.pictures[chosen]) return undefined;
  if (name === "map") return map(r, of as Component, chosen, probe);
  if (name === "slice") return charts(slice(r, chosen, probe, theme));
  if (name === "extensometer") return charts(extensometer(r, probe, theme));
  return undefined;
}
