/** Two tests in one plot: bands and medians of both over the model's time. Pure. */
import type { ChartSpec, Series } from "./chart";
import type { Theme } from "./colour";
import { axisLabel, probability, scaleFor, significant, withSpread, type Scale } from "./format";
import { bandsOf, medianPeriod, type Row } from "./history";
import {
  inTimeUnits,
  modelShift,
  parameterNames,
  parameterScale,
  quantityWords,
  thresholdMarks,
  timeLabel,
} from "./specs";
import type { Model, QuantityDescription, StepLine } from "./types";

/** A test, as it is compared: `label` stands in the legend. */
export interface Side {
  label: string;
  lines: readonly StepLine[];
}

interface Drawn extends Side {
  colour: string;
  dash?: number[];
  rows: readonly Row[];
}

/** What is compared: of a line its quantiles, at levels. */
type Quantiles = (line: StepLine) => { levels: readonly number[]; values: readonly number[] } | undefined;

/** Gaps are where no datum was used, and pauses; steps that this test never measures are none. */
export function rowsOf(lines: readonly StepLine[]): Row[] {
  const limit = 1.5 * medianPeriod(lines);
  return lines.flatMap((line, k): Row[] => {
    const before = lines[k - 1];
    const row = { time: line.time, line: line.used > 0 ? line : undefined };
    const pause = before && line.time - before.time > limit;
    return pause ? [{ time: (before.time + line.time) / 2, line: undefined }, row] : [row];
  });
}

/** The one that runs is blue, the other orange and dashed: nothing is said by colour alone. */
function drawn(sides: readonly [Side, Side], theme: Theme): Drawn[] {
  const looks = [{ colour: theme.blue }, { colour: theme.orange, dash: [7, 4] }];
  return sides.map((side, k) => ({ ...side, ...looks[k]!, rows: rowsOf(side.lines) }));
}

/** All times of both, in order; times that differ by less than a millionth of the whole are one. */
export function commonTimes(sides: readonly { rows: readonly Row[] }[]): number[] {
  const all = sides.flatMap((side) => side.rows.map((row) => row.time)).sort((a, b) => a - b);
  const same = 1e-6 * ((all[all.length - 1] ?? 0) - (all[0] ?? 0));
  return all.filter((time, k) => k === 0 || time - all[k - 1]! > same);
}

/** One value per time: `null`, a gap, where the test has no datum; `undefined`, no gap, at a time that is the other's alone. */
export function aligned(
  times: readonly number[],
  rows: readonly Row[],
  value: (line: StepLine) => number | undefined,
): (number | null | undefined)[] {
  const values: (number | null | undefined)[] = times.map(() => undefined);
  const same = 1e-6 * ((times[times.length - 1] ?? 0) - (times[0] ?? 0));
  let k = 0;
  for (const row of rows) {
    while (k + 1 < times.length && times[k]! < row.time - same) k += 1;
    const v = row.line && value(row.line);
    values[k] = v !== undefined && Number.isFinite(v) ? v : null;
  }
  return values;
}

/** What was known last, at times that are the other test's alone; nothing behind the end. */
export function held(values: readonly (number | null | undefined)[]): (number | null | undefined)[] {
  const end = values.reduce<number>((latest, v, k) => (v === undefined ? latest : k), -1);
  let last: number | null | undefined;
  return values.map((v, k) => (k > end ? undefined : (last = v === undefined ? last : v)));
}

function seriesOf(sides: readonly Drawn[], times: readonly number[], of: Quantiles, factor: number): Series[] {
  const series: Series[] = [];
  for (const side of sides) {
    const latest = side.lines[side.lines.length - 1];
    const { pairs, middle } = bandsOf((latest && of(latest)?.levels) ?? []);
    const at = (level: number) => aligned(times, side.rows, (line) => of(line)?.values[level]);
    const outer = pairs[0];
    const format = (v: number): string => significant(v * factor, 4);
    const look = { colour: side.colour, format, ...(side.dash ? { dash: side.dash } : {}) };
    if (outer) {
      series.push({ label: `${side.label}: low`, values: at(outer.low), ...look, hidden: true });
      const label = `${side.label}: ${outer.percent} % of the probability`;
      series.push({ label, values: at(outer.high), ...look, bandTo: series.length - 1, opacity: 0.2 });
    }
    if (middle !== undefined) {
      const values = at(middle);
      series.push({
        label: `${side.label}: median`,
        values,
        said: held(values),
        ...look,
        width: 2,
      });
    }
  }
  return series;
}

/** A mean and a standard deviation, with the reduced model's error where it is known. */
export interface Moments {
  mean: number;
  std: number;
  /** By an answer that is not to be used: two digits. */
  rejected?: boolean;
}

/** The area that two normal densities share: 1 where they are the same, 0 where nothing of one lies in the other. */
export function overlap(a: Moments, b: Moments): number {
  const density = (x: number, of: Moments): number =>
    Math.exp(-0.5 * ((x - of.mean) / of.std) ** 2) / (of.std * Math.sqrt(2 * Math.PI));
  const step = 0.01;
  let area = 0;
  for (let z = -8; z <= 8; z += step) {
    const x = a.mean + z * a.std;
    area += Math.min(density(x, a), density(x, b)) * a.std * step;
  }
  return area;
}

/** What a table of two tests says of a quantity. */
export interface ComparedRow {
  name: string;
  units: string;
  here: string;
  other: string;
  difference: string;
  overlap: string;
}

function comparedRow(name: string, a: Moments | undefined, b: Moments | undefined, scale: Scale): ComparedRow[] {
  if (!a || !b || !(a.std > 0) || !(b.std > 0)) return [];
  const written = ({ mean, std, rejected }: Moments): string => {
    if (rejected) return significant(Number((scale.factor * mean).toPrecision(2)), 2);
    const spread = Math.abs(scale.factor) * std;
    return `${withSpread(scale.factor * mean, spread)} ± ${withSpread(spread, spread)}`;
  };
  const rejected = a.rejected === true || b.rejected === true;
  const difference = { mean: a.mean - b.mean, std: Math.hypot(a.std, b.std), rejected };
  const sigmas = significant(Math.abs(difference.mean) / difference.std, 2);
  return [
    {
      name,
      units: scale.units,
      here: written(a),
      other: written(b),
      difference: `${written(difference)} (${sigmas} σ)`,
      overlap: probability(overlap(a, b)),
    },
  ];
}

/** As known at the end of each test. */
export function comparedRows(
  sides: readonly [Side, Side],
  model: Model | undefined,
  quantities: readonly QuantityDescription[],
): ComparedRow[] {
  const [a, b] = sides.map((side) => side.lines[side.lines.length - 1]);
  if (!a || !b) return [];
  const moments = (line: StepLine, mean: number, std: number, k?: number): Moments => ({
    mean,
    std: std * Math.hypot(1, modelShift(line, k)),
    rejected: line.verdict?.level === "reject",
  });
  const parameter = (line: StepLine, k: number): Moments =>
    moments(line, line.mean[k] ?? NaN, Math.sqrt(line.covariance[k]?.[k] ?? NaN), k);
  const forecast = (line: StepLine, name: string): Moments | undefined => {
    const f = line.forecast[name];
    return f && moments(line, f.mean, f.std);
  };
  return [
    ...parameterNames(model, a).flatMap((name, k) =>
      comparedRow(name, parameter(a, k), parameter(b, k), parameterScale(model?.parameters[k])),
    ),
    ...quantities.flatMap((q) => {
      const [here, other] = [forecast(a, q.name), forecast(b, q.name)];
      const scale = scaleFor(q.units ?? a.forecast[q.name]?.units, Math.abs(here?.mean ?? 0));
      return comparedRow(quantityWords(q), here, other, scale);
    }),
  ];
}

export function parameterComparison(
  sides: readonly [Side, Side],
  k: number,
  name: string,
  scale: Scale,
  theme: Theme,
): ChartSpec {
  const both = drawn(sides, theme);
  const times = commonTimes(both);
  const of: Quantiles = (line) => {
    const values = line.quantiles.values[k];
    return values && { levels: line.quantiles.levels, values };
  };
  return {
    name: `comparison ${name}`,
    times,
    series: seriesOf(both, times, of, scale.factor),
    xLabel: timeLabel,
    yLabel: axisLabel(name, scale.units || "–"),
    factor: scale.factor,
    height: 220,
  };
}

export function forecastComparison(sides: readonly [Side, Side], q: QuantityDescription, theme: Theme): ChartSpec {
  const both = drawn(sides, theme);
  const times = commonTimes(both);
  const sizes = sides.flatMap((side) => side.lines[side.lines.length - 1]?.forecast[q.name]?.values ?? []);
  const scale = scaleFor(q.units, Math.max(0, ...sizes.map(Math.abs)));
  const threshold = thresholdMarks(q, scale, theme);
  return {
    name: `comparison ${q.name}`,
    times,
    series: seriesOf(both, times, (line) => line.forecast[q.name], scale.factor),
    xLabel: timeLabel,
    yLabel: axisLabel(quantityWords(q), scale.units),
    factor: scale.factor,
    horizontal: threshold,
    height: 220,
  };
}

/** All parameters, then all forecasts. */
export function comparisonSpecs(
  sides: readonly [Side, Side],
  model: Model | undefined,
  quantities: readonly QuantityDescription[],
  theme: Theme,
): ChartSpec[] {
  const line = sides[0].lines[0] ?? sides[1].lines[0];
  return [
    ...parameterNames(model, line).map((name, k) =>
      parameterComparison(sides, k, name, parameterScale(model?.parameters[k]), theme),
    ),
    ...quantities.map((q) => forecastComparison(sides, q, theme)),
  ].map((spec) => inTimeUnits(spec, model?.time?.units));
}
