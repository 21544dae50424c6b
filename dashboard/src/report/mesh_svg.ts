/** A face of a mesh, coloured by a number at its nodes, with sensors: drawn flat, so that it prints and is found again. Pure. */
import { colourAt, rgb, type Theme } from "../colour";
import { axisLabel, scaleFor, significant } from "../format";
import { svg, tag, text } from "./chart_svg";

export interface MeshSpec {
  title: string;
  points: readonly (readonly [number, number])[];
  cells: readonly (readonly number[])[];
  /** At the nodes, SI; none: the bare structure. */
  value?: readonly number[];
  /** Drawn displacements, m. */
  shift?: { x: readonly number[]; y: readonly number[] };
  label: string;
  units: string;
  /** Symmetric about 0, where colours have a neutral middle. */
  signed?: boolean;
  /** In `units` of SI; those of the values where left out. */
  range?: [number, number];
  sensors?: readonly MeshSensor[];
  /** Standard deviation of the values: what is less is not to be seen. */
  noise?: number;
  /** A line that is drawn on it: from, to. */
  probe?: readonly [number, number, number, number];
}

export interface MeshSensor {
  x: number;
  y: number;
  /** What the cursor says. */
  words?: string;
  /** Coloured where given. */
  value?: number;
  component?: string;
  /** Moved with the structure, m. */
  shift?: [number, number];
}

export interface MeshView {
  toX: (x: number) => number;
  toY: (y: number) => number;
  /** Back to m. */
  from: (x: number, y: number) => [number, number];
  width: number;
  height: number;
}

const colours = 48;

export function rangeOfMesh(spec: MeshSpec): [number, number] {
  if (spec.range) return spec.range;
  const all = [...(spec.value ?? []), ...(spec.sensors ?? []).flatMap((s) => (s.value === undefined ? [] : [s.value]))];
  let low = all.reduce((a, b) => Math.min(a, b), Infinity);
  let high = all.reduce((a, b) => Math.max(a, b), -Infinity);
  if (!Number.isFinite(low)) return [0, 1];
  if (spec.signed) {
    high = Math.max(Math.abs(low), Math.abs(high));
    low = -high;
  }
  return high > low ? [low, high] : [low, low + Math.max(Math.abs(low), 1e-12)];
}

/** Places on the drawing; the structure fills its width. */
export function meshView(spec: MeshSpec, width = 520): MeshView {
  const xs = [...spec.points.map((p) => p[0]), ...(spec.sensors ?? []).map((s) => s.x)];
  const ys = [...spec.points.map((p) => p[1]), ...(spec.sensors ?? []).map((s) => s.y)];
  const ends = (v: readonly number[]): [number, number] => [
    v.reduce((a, b) => Math.min(a, b), Infinity),
    v.reduce((a, b) => Math.max(a, b), -Infinity),
  ];
  const [x0, x1] = ends(xs);
  const [y0, y1] = ends(ys);
  const size = Math.max(x1 - x0, 1e-12);
  const air = 0.05 * Math.max(size, y1 - y0);
  const most = 300;
  const scale = Math.min((width - 24) / (size + 2 * air), most / (y1 - y0 + 2 * air));
  const inside = scale * (y1 - y0 + 2 * air);
  const left = (width - scale * (x1 - x0)) / 2;
  const top = 8 + scale * air;
  return {
    toX: (x) => left + scale * (x - x0),
    toY: (y) => top + scale * (y1 - y),
    from: (x, y) => [x0 + (x - left) / scale, y1 - (y - top) / scale],
    width,
    height: 16 + inside + (spec.label || spec.value ? 46 : 8),
  };
}

function mix(c: readonly number[], s: number, t: number): number {
  return (1 - s) * (1 - t) * c[0]! + s * (1 - t) * c[1]! + s * t * c[2]! + (1 - s) * t * c[3]!;
}

/** Outlines by colour: one path each, however many elements. */
type Outlines = Map<string, string>;

/** Split where the colour changes within the element, so that coarse elements are shaded too. */
function addCell(
  outlines: Outlines,
  spec: MeshSpec,
  view: MeshView,
  cell: readonly number[],
  colour: (v: number) => string,
  most: number,
  step: number,
): void {
  const x = cell.map((n) => view.toX(spec.points[n]![0] + (spec.shift?.x[n] ?? 0)));
  const y = cell.map((n) => view.toY(spec.points[n]![1] + (spec.shift?.y[n] ?? 0)));
  const add = (fill: string, d: string): void => void outlines.set(fill, (outlines.get(fill) ?? "") + d);
  const outline = `M${cell.map((_, k) => `${x[k]!.toFixed(1)} ${y[k]!.toFixed(1)}`).join("L")}Z`;
  if (!spec.value) return add("", outline);
  const v = cell.map((n) => spec.value![n]!);
  if (cell.length !== 4) return add(colour(v.reduce((a, b) => a + b, 0) / v.length), outline);
  const parts = Math.max(1, Math.min(most, Math.ceil((Math.max(...v) - Math.min(...v)) / step)));
  for (let i = 0; i < parts; i += 1)
    for (let j = 0; j < parts; j += 1) {
      const [s0, s1, t0, t1] = [i / parts, (i + 1) / parts, j / parts, (j + 1) / parts];
      const corner = (s: number, t: number): string => `${mix(x, s, t).toFixed(1)} ${mix(y, s, t).toFixed(1)}`;
      add(
        colour(mix(v, (s0 + s1) / 2, (t0 + t1) / 2)),
        `M${corner(s0, t0)}L${corner(s1, t0)}L${corner(s1, t1)}L${corner(s0, t1)}Z`,
      );
    }
}

function cellsSvg(spec: MeshSpec, view: MeshView, colour: (v: number) => string, step: number, theme: Theme): string {
  const outlines: Outlines = new Map();
  const most = Math.max(1, Math.min(6, Math.floor(Math.sqrt(4000 / Math.max(1, spec.cells.length)))));
  for (const cell of spec.cells) addCell(outlines, spec, view, cell, colour, most, step);
  // The stroke hides the hairlines between neighbours; of a bare structure it is the mesh.
  return [...outlines]
    .map(([fill, d]) => tag("path", { d, fill: fill || theme.gap, stroke: fill || theme.prior, "stroke-width": 0.4 }))
    .join("");
}

function sensorSvg(s: MeshSensor, view: MeshView, colour: (v: number) => string, theme: Theme): string {
  const [x, y] = [view.toX(s.x + (s.shift?.[0] ?? 0)), view.toY(s.y + (s.shift?.[1] ?? 0))];
  const fill = s.value === undefined ? theme.panel : colour(s.value);
  // The direction that is measured: a tick through the mark.
  const d =
    s.component === "x"
      ? `M${(x - 6).toFixed(1)} ${y.toFixed(1)}h12`
      : s.component === "y"
        ? `M${x.toFixed(1)} ${(y - 6).toFixed(1)}v12`
        : "";
  return (
    (d ? tag("path", { d, stroke: theme.text, "stroke-width": 1.2 }) : "") +
    tag("circle", { class: "sensor", cx: x, cy: y, r: 3.2, fill, stroke: theme.text, "stroke-width": 1 })
  );
}

export function meshSvg(spec: MeshSpec, theme: Theme, width = 520): string {
  const view = meshView(spec, width);
  const [low, high] = rangeOfMesh(spec);
  const map = spec.signed ? "signed" : "viridis";
  const colour = (v: number): string => rgb(colourAt(map, Math.round(((v - low) / (high - low)) * colours) / colours));
  const cells = cellsSvg(spec, view, colour, (3 * (high - low)) / colours, theme);
  const sensors = (spec.sensors ?? []).map((s) => sensorSvg(s, view, colour, theme)).join("");
  const foot = view.height - 38;
  let bar = "";
  let line = "";
  if (spec.probe) {
    const [x0, y0, x1, y1] = spec.probe;
    const d = `M${view.toX(x0).toFixed(1)} ${view.toY(y0).toFixed(1)}L${view.toX(x1).toFixed(1)} ${view.toY(y1).toFixed(1)}`;
    for (const [stroke, wide] of [
      [theme.panel, 4],
      [theme.text, 1.6],
    ] as const)
      line += tag("path", { class: "probe", d, stroke, "stroke-width": wide });
  }
  if (spec.value || spec.sensors?.some((s) => s.value !== undefined)) {
    const scale = scaleFor(spec.units, Math.max(Math.abs(low), Math.abs(high)));
    const [from, wide] = [width / 2 - 130, 260];
    for (let k = 0; k < colours; k += 1)
      bar += tag("rect", {
        x: from + (k * wide) / colours,
        y: foot,
        width: wide / colours + 0.5,
        height: 10,
        fill: colour(low + ((high - low) * (k + 0.5)) / colours),
      });
    if (spec.noise) {
      // What lies within twice the noise of 0.
      const at = (v: number): number => from + wide * Math.min(1, Math.max(0, (v - low) / (high - low)));
      const [left, right] = [at(-2 * spec.noise), at(2 * spec.noise)];
      bar += tag("path", {
        class: "noise",
        d: `M${left.toFixed(1)} ${foot - 3}V${foot + 13}M${right.toFixed(1)} ${foot - 3}V${foot + 13}`,
        stroke: theme.text,
        "stroke-width": 1.4,
      });
    }
    const least = Math.abs(low) < 1e-9 * Math.abs(high) ? 0 : low;
    bar += text(from - 6, foot + 9, significant(least * scale.factor), theme.text, { "text-anchor": "end" });
    bar += text(
      from + wide + 6,
      foot + 9,
      `${significant(high * scale.factor)}${scale.units ? ` ${scale.units}` : ""}`,
      theme.text,
    );
    bar += text(
      width / 2,
      foot + 25,
      `${spec.label.replace(/^[^,:]*/, (what) => axisLabel(what, scale.units))}${spec.noise ? `; bars: ± 2 × noise ${significant(spec.noise * scale.factor, 2)}` : ""}`,
      theme.faint,
      {
        "text-anchor": "middle",
      },
    );
  } else if (spec.label) bar = text(width / 2, foot + 14, spec.label, theme.faint, { "text-anchor": "middle" });
  return svg(width, view.height, theme, spec.title, cells + sensors + line + bar);
}

/** What is under the cursor: the sensor there, else the nearest node with its value. */
export function meshReadout(spec: MeshSpec, x: number, y: number): string {
  const nearest = <T>(
    list: readonly T[],
    at: (one: T) => readonly [number, number],
  ): [T | undefined, number, number] => {
    let best: [T | undefined, number, number] = [undefined, Infinity, -1];
    list.forEach((one, i) => {
      const [a, b] = at(one);
      const distance = Math.hypot(a - x, b - y);
      if (distance < best[1]) best = [one, distance, i];
    });
    return best;
  };
  const length = spec.units === "px" ? { factor: 1, units: "px" } : { factor: 1e3, units: "mm" };
  const place = (a: number, b: number): string =>
    `(${significant(length.factor * a)}, ${significant(length.factor * b)}) ${length.units}`;
  const view = meshView(spec);
  const close = 8 / Math.abs(view.toX(1) - view.toX(0));
  const [sensor, away] = nearest(spec.sensors ?? [], (s) => [s.x + (s.shift?.[0] ?? 0), s.y + (s.shift?.[1] ?? 0)]);
  const [low, high] = rangeOfMesh(spec);
  const scale = scaleFor(spec.units, Math.max(Math.abs(low), Math.abs(high)));
  const number = (v: number): string => `${significant(v * scale.factor, 4)}${scale.units ? ` ${scale.units}` : ""}`;
  if (sensor && away < close)
    return `${sensor.words ?? "sensor"} at ${place(sensor.x, sensor.y)}${sensor.value === undefined ? "" : `: ${number(sensor.value)}`}`;
  const [node, far, index] = nearest(spec.points, ([a, b]) => [a, b]);
  const value = spec.value?.[index];
  return node && value !== undefined && far < 6 * close ? `${place(node[0], node[1])}: ${number(value)}` : "";
}
