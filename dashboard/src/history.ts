/** The steps the page knows, in order, and what plots take from them. Pure. */
import type { StepLine } from "./types";

/** More are forgotten from the front: a browser's memory is finite. */
export const mostSteps = 20000;

export class History {
  readonly lines: StepLine[] = [];
  /** Grows with every change. */
  version = 0;

  /** A line with the number of an earlier one replaces it: a datum that came late changes the steps after it. */
  add(line: StepLine): void {
    const at = this.position(line.step);
    if (this.lines[at]?.step === line.step) this.lines[at] = line;
    else this.lines.splice(at, 0, line);
    if (this.lines.length > mostSteps) this.lines.splice(0, this.lines.length - mostSteps);
    this.version += 1;
  }

  remove(step: number): void {
    const at = this.position(step);
    if (this.lines[at]?.step !== step) return;
    this.lines.splice(at, 1);
    this.version += 1;
  }

  clear(): void {
    this.lines.length = 0;
    this.version += 1;
  }

  get latest(): StepLine | undefined {
    return this.lines[this.lines.length - 1];
  }

  /** Index of the first line whose step is not below `step`. */
  position(step: number): number {
    let low = 0;
    let high = this.lines.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.lines[middle]!.step < step) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  find(step: number): StepLine | undefined {
    const line = this.lines[this.position(step)];
    return line?.step === step ? line : undefined;
  }

  /** The line closest in time. */
  nearest(time: number): StepLine | undefined {
    let best: StepLine | undefined;
    for (const line of this.lines) if (!best || Math.abs(line.time - time) < Math.abs(best.time - time)) best = line;
    return best;
  }
}

/** A row of a plot: a line, or `undefined` where there is a gap, at a time. */
export interface Row {
  time: number;
  line: StepLine | undefined;
}

export interface Gap {
  from: number;
  to: number;
  /** "no datum": steps computed without any; "no step": times that never came. */
  cause: "no datum" | "no step";
}

export interface Timeline {
  rows: Row[];
  gaps: Gap[];
}

/**
 * Where there are no data the plots have gaps: at steps that used none, and where steps are further apart than usual (by number, or by
 * more than 1.5 times the median period).
 */
export function timeline(lines: readonly StepLine[]): Timeline {
  const rows: Row[] = [];
  const gaps: Gap[] = [];
  const limit = 1.5 * medianPeriod(lines);
  const open = (from: number, to: number, cause: Gap["cause"]): void => {
    const last = gaps[gaps.length - 1];
    if (last && last.cause === cause && last.to >= from) last.to = to;
    else gaps.push({ from, to, cause });
  };
  lines.forEach((line, i) => {
    const before = lines[i - 1];
    if (before && (line.step > before.step + 1 || line.time - before.time > limit)) {
      rows.push({ time: (before.time + line.time) / 2, line: undefined });
      open(before.time, line.time, "no step");
    }
    if (line.used > 0) rows.push({ time: line.time, line });
    else {
      rows.push({ time: line.time, line: undefined });
      open(before?.time ?? line.time, lines[i + 1]?.time ?? line.time, "no datum");
    }
  });
  return { rows, gaps };
}

export function medianPeriod(lines: readonly StepLine[]): number {
  const periods = lines.slice(1).map((line, i) => line.time - lines[i]!.time);
  return median(periods.filter((p) => p > 0)) ?? Infinity;
}

export function median(values: readonly number[]): number | undefined {
  return quantile(values, 0.5);
}

/** Linear interpolation between order statistics. */
export function quantile(values: readonly number[], level: number): number | undefined {
  if (values.length === 0) return undefined;
  const sorted = [...values].sort((a, b) => a - b);
  const at = level * (sorted.length - 1);
  const low = Math.floor(at);
  const a = sorted[low]!;
  return a + (at - low) * ((sorted[low + 1] ?? a) - a);
}

/** One number per row; `null`, uPlot's gap, where there is no line or no finite number. */
export function column(rows: readonly Row[], value: (line: StepLine) => number | undefined): (number | null)[] {
  return rows.map(({ line }) => {
    const v = line && value(line);
    return v !== undefined && Number.isFinite(v) ? v : null;
  });
}

export interface Bands {
  /** Indices into the levels: outermost pair first. */
  pairs: { low: number; high: number; percent: number }[];
  middle: number | undefined;
}

/** Symmetric pairs of levels, e.g. 0.025 and 0.975 → 95 %, and the median. */
export function bandsOf(levels: readonly number[]): Bands {
  const order = levels.map((level, index) => ({ level, index })).sort((a, b) => a.level - b.level);
  const pairs: Bands["pairs"] = [];
  for (let low = 0, high = order.length - 1; low < high; low += 1, high -= 1) {
    const percent = Math.round(1000 * (order[high]!.level - order[low]!.level)) / 10;
    pairs.push({ low: order[low]!.index, high: order[high]!.index, percent });
  }
  const middle = order.length % 2 ? order[(order.length - 1) / 2]!.index : undefined;
  return { pairs, middle };
}

/** The parts of a step's time, without the sums of others: `update` is projection, map and correction where these are told apart. */
export function phasesOf(elapsed: Record<string, number>): string[] {
  const parts = Object.keys(elapsed).filter((name) => name !== "total");
  const divided = parts.some((name) => name === "map" || name === "projection");
  return divided ? parts.filter((name) => name !== "update") : parts;
}
