/** Posterior of the parameters two by two, with the path that led there. */
import { useEffect, useRef, useState } from "preact/hooks";
import { through, type Theme } from "./colour";
import { csv } from "./csv";
import { axisLabel, given, significant, type Scale } from "./format";
import { axisOf, correlation, ellipse, isNarrow, smoothDensity, ticks, type Interval } from "./pair";
import { Panel } from "./panel";
import { composePng } from "./png";
import { parameterScale } from "./specs";
import { Legend, type LegendEntry } from "./chart";
import type { Detail } from "./store";
import type { Model, SamplesAnswer, StepLine } from "./types";

/** More do not fit: the first ones are shown. */
const most = 5;
const trail = 40;

interface Props {
  model: Model | undefined;
  line: StepLine | undefined;
  lines: readonly StepLine[];
  names: readonly string[];
  samples: Detail<SamplesAnswer>;
  theme: Theme;
}

export function PairPanel({ model, line, lines, names, samples, theme }: Props) {
  const [whole, setWhole] = useState<boolean>();
  const canvas = useRef<HTMLCanvasElement>(null);
  const [width, setWidth] = useState(400);
  const count = Math.min(most, names.length);
  const isWhole = whole ?? !(line && isNarrow(line, model?.parameters ?? []));
  const points = samples.value?.points ?? [];
  const scales = names.map((_, k) => parameterScale(model?.parameters[k]));
  useEffect(() => {
    const observer = new ResizeObserver(() => setWidth(canvas.current!.parentElement!.clientWidth));
    observer.observe(canvas.current!.parentElement!);
    return () => observer.disconnect();
  }, []);
  const height = Math.min(width, 470);
  useEffect(() => {
    const target = canvas.current!;
    const ratio = devicePixelRatio;
    target.width = Math.round(width * ratio);
    target.height = Math.round(height * ratio);
    const ctx = target.getContext("2d")!;
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (line)
      drawPairs(ctx, { width, height, count, line, lines, names, scales, points, model, theme, whole: isWhole });
  }, [width, height, count, line, samples.value, model, theme, isWhole]);
  const legend: LegendEntry[] = [
    {
      label: "draws of the posterior",
      colour: theme.blue,
      look: "bar",
      ...(points.length ? {} : { value: samples.problem ?? "none" }),
    },
    { label: "50 % and 95 % of a Gaussian with its moments", colour: theme.text, look: "dash" },
    { label: `path of the mean, last ${trail} steps`, colour: theme.orange, look: "line" },
    { label: "most probable", colour: theme.red, look: "bar" },
  ];
  const title = `Parameter pairs${line ? `, step ${line.step}` : ""}`;
  const words =
    line && count > 1 ? `Correlation of ${names[0]} and ${names[1]}: ${significant(correlation(line, 0, 1), 2)}` : "";
  return (
    <Panel
      id="pairs"
      title={title}
      png={() => composePng({ title, legend, picture: canvas.current!, theme, ratio: devicePixelRatio })}
      csv={() => pairsTable(names, scales, points)}
      controls={
        <select
          aria-label="Range of the pair plot"
          value={isWhole ? "box" : "close"}
          onChange={(e) => setWhole(e.currentTarget.value === "box")}
        >
          <option value="box">whole prior</option>
          <option value="close">close up</option>
        </select>
      }
    >
      <Legend entries={legend} theme={theme} />
      <div class="pair">
        <canvas ref={canvas} style={{ width: "100%", height: `${height}px` }} role="img" aria-label={words} />
      </div>
    </Panel>
  );
}

export interface PairPicture {
  width: number;
  height: number;
  count: number;
  line: StepLine;
  lines: readonly StepLine[];
  names: readonly string[];
  /** From each parameter to its axis. */
  scales: readonly Scale[];
  points: readonly number[][];
  /** Draws of something else, behind these. */
  others?: readonly number[][];
  model: Model | undefined;
  theme: Theme;
  whole: boolean;
}

/** The draws, in the units of the axes. */
export function pairsTable(
  names: readonly string[],
  scales: readonly Scale[],
  points: readonly (readonly number[])[],
): string {
  return csv(
    names.map((name, k) => axisLabel(name, scales[k]!.units)),
    points.map((point) => point.map((v, k) => v * scales[k]!.factor)),
  );
}

/** Of a marginal density. */
const densityPoints = 121;

interface Cell {
  x: number;
  y: number;
  w: number;
  h: number;
  horizontal: Interval;
}

export function drawPairs(ctx: CanvasRenderingContext2D, p: PairPicture): void {
  const [bottom, gap] = [40, 10];
  const h = (p.height - bottom - 8 - gap * (p.count - 1)) / p.count;
  const axes = Array.from({ length: p.count }, (_, k) => axisOf(k, p.line, p.model?.parameters[k], p.whole));
  // The name stands before the longest number.
  const longest = Math.max(...axes.slice(1).flatMap((_, k) => rowTicks(p, axes, k + 1, h).map((v) => given(v).length)));
  const left = Math.max(58, 32 + 6.6 * longest);
  const w = (p.width - left - 10 - gap * (p.count - 1)) / p.count;
  ctx.clearRect(0, 0, p.width, p.height);
  ctx.font = "12px system-ui, sans-serif";
  for (let row = 0; row < p.count; row += 1)
    for (let column = 0; column < p.count; column += 1) {
      const cell: Cell = { x: left + column * (w + gap), y: 8 + row * (h + gap), w, h, horizontal: axes[column]! };
      if (column > row) writeCorrelation(ctx, p, cell, column, row);
      else {
        frame(ctx, p, cell);
        if (column === row) marginal(ctx, p, cell, row);
        else scatter(ctx, p, cell, axes[row]!, column, row);
        if (row === p.count - 1) horizontalAxis(ctx, p, cell, column);
        if (column === 0) verticalAxis(ctx, p, cell, axes, row);
      }
    }
}

function frame(ctx: CanvasRenderingContext2D, { theme }: PairPicture, { x, y, w, h }: Cell): void {
  ctx.strokeStyle = theme.grid;
  ctx.lineWidth = 1;
  ctx.strokeRect(x + 0.5, y + 0.5, w, h);
}

/** Everything inside a cell is drawn in its own coordinates and cut at its edges. */
function inside(ctx: CanvasRenderingContext2D, cell: Cell, work: () => void): void {
  ctx.save();
  ctx.beginPath();
  ctx.rect(cell.x, cell.y, cell.w, cell.h);
  ctx.clip();
  work();
  ctx.restore();
}

function marginal(ctx: CanvasRenderingContext2D, p: PairPicture, cell: Cell, k: number): void {
  const { theme } = p;
  const values = p.points.map((point) => point[k]!);
  const toX = (v: number): number =>
    cell.x + ((v - cell.horizontal.low) / (cell.horizontal.high - cell.horizontal.low)) * cell.w;
  inside(ctx, cell, () => {
    const heights = smoothDensity(values, cell.horizontal, densityPoints);
    const tallest = Math.max(...heights) * 1.12 || 1;
    ctx.fillStyle = through(theme.blue, 0.55);
    ctx.beginPath();
    ctx.moveTo(cell.x, cell.y + cell.h);
    heights.forEach((height, i) =>
      ctx.lineTo(cell.x + (i / (densityPoints - 1)) * cell.w, cell.y + cell.h * (1 - height / tallest)),
    );
    ctx.lineTo(cell.x + cell.w, cell.y + cell.h);
    ctx.closePath();
    ctx.fill();
    const quantiles = p.line.quantiles.values[k] ?? [];
    const middle = (quantiles.length - 1) / 2;
    quantiles.forEach((v, i) => {
      if (i !== 0 && i !== middle && i !== quantiles.length - 1) return;
      ctx.strokeStyle = theme.text;
      ctx.setLineDash(i === middle ? [] : [4, 3]);
      ctx.beginPath();
      ctx.moveTo(toX(v), cell.y);
      ctx.lineTo(toX(v), cell.y + cell.h);
      ctx.stroke();
    });
    ctx.setLineDash([]);
  });
}

function scatter(
  ctx: CanvasRenderingContext2D,
  p: PairPicture,
  cell: Cell,
  vertical: Interval,
  i: number,
  j: number,
): void {
  const { theme, line } = p;
  const toX = (v: number): number =>
    cell.x + ((v - cell.horizontal.low) / (cell.horizontal.high - cell.horizontal.low)) * cell.w;
  const toY = (v: number): number => cell.y + cell.h - ((v - vertical.low) / (vertical.high - vertical.low)) * cell.h;
  const path = (points: readonly (readonly [number, number])[]): void => {
    ctx.beginPath();
    points.forEach(([a, b], k) => (k ? ctx.lineTo(toX(a), toY(b)) : ctx.moveTo(toX(a), toY(b))));
    ctx.stroke();
  };
  inside(ctx, cell, () => {
    for (const [points, colour] of [[p.others ?? [], theme.orange] as const, [p.points, theme.blue] as const]) {
      ctx.fillStyle = through(colour, 0.45);
      for (const point of points) {
        ctx.beginPath();
        ctx.arc(toX(point[i]!), toY(point[j]!), 2.2, 0, 7);
        ctx.fill();
      }
    }
    const end = p.lines.findIndex((l) => l.step > line.step);
    const past = p.lines.slice(0, end < 0 ? undefined : end).slice(-trail);
    ctx.strokeStyle = through(theme.orange, 0.75);
    ctx.lineWidth = 1.2;
    path(past.map((l) => [l.mean[i]!, l.mean[j]!] as const));
    ctx.strokeStyle = theme.text;
    ctx.lineWidth = 1.2;
    for (const mass of [0.5, 0.95]) {
      ctx.setLineDash(mass === 0.5 ? [2, 2] : [6, 3]);
      path(ellipse(line, i, j, mass));
    }
    ctx.setLineDash([]);
    const [x, y] = [toX(line.maximum_a_posteriori[i]!), toY(line.maximum_a_posteriori[j]!)];
    ctx.fillStyle = theme.red;
    ctx.strokeStyle = theme.panel;
    ctx.beginPath();
    for (const [a, b] of [
      [0, -6],
      [6, 0],
      [0, 6],
      [-6, 0],
    ] as const)
      ctx.lineTo(x + a, y + b);
    ctx.closePath();
    ctx.fill();
    ctx.stroke();
  });
}

function writeCorrelation(
  ctx: CanvasRenderingContext2D,
  { theme, line, names }: PairPicture,
  { x, y, w, h }: Cell,
  i: number,
  j: number,
): void {
  ctx.fillStyle = theme.faint;
  ctx.textAlign = "center";
  ctx.fillText(`correlation of ${names[j]} and ${names[i]}`, x + w / 2, y + h / 2 - 8);
  ctx.fillStyle = line.verdict?.level === "reject" ? theme.faint : theme.text;
  ctx.font = "600 20px system-ui, sans-serif";
  ctx.fillText(significant(correlation(line, i, j), 2), x + w / 2, y + h / 2 + 18);
  ctx.font = "12px system-ui, sans-serif";
}

/** An axis as its numbers are written. */
const shown = ({ low, high }: Interval, { factor }: Scale): Interval => ({ low: low * factor, high: high * factor });
const labelOf = ({ names, scales }: PairPicture, k: number): string => axisLabel(names[k]!, scales[k]!.units);

const rowTicks = ({ scales }: PairPicture, axes: readonly Interval[], k: number, height: number): number[] =>
  ticks(shown(axes[k]!, scales[k]!), Math.max(2, height / 36));

function horizontalAxis(ctx: CanvasRenderingContext2D, p: PairPicture, cell: Cell, k: number): void {
  ctx.fillStyle = p.theme.faint;
  ctx.textAlign = "center";
  const { low, high } = shown(cell.horizontal, p.scales[k]!);
  for (const v of ticks({ low, high }, Math.max(2, cell.w / 42))) {
    const x = cell.x + ((v - low) / (high - low)) * cell.w;
    ctx.fillRect(x, cell.y + cell.h, 1, 4);
    // Not into the next cell's numbers.
    const half = 3.3 * given(v).length;
    const at = Math.max(cell.x + half - 4, Math.min(x, cell.x + cell.w - half + 4));
    ctx.fillText(given(v), at, cell.y + cell.h + 16);
  }
  ctx.fillText(labelOf(p, k), cell.x + cell.w / 2, cell.y + cell.h + 34);
}

/** Of the first row, which holds a density, the name alone. */
function verticalAxis(
  ctx: CanvasRenderingContext2D,
  p: PairPicture,
  cell: Cell,
  axes: readonly Interval[],
  k: number,
): void {
  ctx.fillStyle = p.theme.faint;
  ctx.textAlign = "right";
  const { low, high } = shown(axes[k]!, p.scales[k]!);
  for (const v of k > 0 ? rowTicks(p, axes, k, cell.h) : []) {
    const y = cell.y + cell.h - ((v - low) / (high - low)) * cell.h;
    ctx.fillRect(cell.x - 4, y, 4, 1);
    ctx.fillText(given(v), cell.x - 7, y + 4);
  }
  ctx.save();
  ctx.translate(13, cell.y + cell.h / 2);
  ctx.rotate(-Math.PI / 2);
  ctx.textAlign = "center";
  ctx.fillText(k > 0 ? labelOf(p, k) : "density", 0, 0);
  ctx.restore();
}
