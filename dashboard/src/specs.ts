/** From steps to plots. Pure. */
import type { ChartSpec, LegendEntry, Mark, Series } from "./chart";
import type { Theme } from "./colour";
import {
  axisLabel,
  decade,
  given,
  halfDecade,
  imposed,
  microseconds,
  prettyUnits,
  probability,
  scaleFor,
  significant,
  timeOfDay,
  timeWords,
  withSpread,
  words,
  type Scale,
} from "./format";
import { bandsOf, column, phasesOf, timeline, type Timeline } from "./history";
import { total } from "./events";
import type { Decision, Forecast, Model, ParameterDescription, QuantityDescription, StepLine } from "./types";

export const timeLabel = "model time t [–]";

/** The same plot where the solver's time has a unit. */
export function inTimeUnits(spec: ChartSpec, units: string | undefined): ChartSpec {
  const label = axisLabel("model time t", prettyUnits(units) || "–");
  const said = (words: string): string => (words === timeLabel ? label : words);
  return { ...spec, xLabel: said(spec.xLabel), yLabel: said(spec.yLabel) };
}

/** The step and the time of day at a model time, for the axis above a plot; nothing where the lines do not say when they came. */
export function stepAndClock(lines: readonly StepLine[]): ((time: number) => string) | undefined {
  if (!lines.some((l) => l.received_at !== undefined)) return undefined;
  return (time) => {
    let best: StepLine | undefined;
    for (const l of lines) if (!best || Math.abs(l.time - time) < Math.abs(best.time - time)) best = l;
    if (!best) return "";
    return best.received_at === undefined ? String(best.step) : `${best.step}\n${timeOfDay(best.received_at)}`;
  };
}

interface Base {
  lines: readonly StepLine[];
  line: Timeline;
  theme: Theme;
}

/** Bands between symmetric quantiles, and the median: shared by parameters and forecasts. */
function quantileSeries(
  base: Base,
  levels: readonly number[],
  value: (line: StepLine, level: number) => number | undefined,
  colour: string,
  format: (v: number) => string,
): Series[] {
  const { pairs, middle } = bandsOf(levels);
  const series: Series[] = [];
  pairs.forEach((pair, k) => {
    series.push({
      label: `${pair.percent} % low`,
      values: column(base.line.rows, (l) => value(l, pair.low)),
      colour,
      hidden: true,
      format,
    });
    series.push({
      label: `${pair.percent} % of the probability`,
      values: column(base.line.rows, (l) => value(l, pair.high)),
      colour,
      bandTo: series.length - 1,
      format,
      opacity: k === pairs.length - 1 && k > 0 ? 0.34 : 0.2,
    });
  });
  if (middle !== undefined)
    series.push({
      label: "median",
      values: column(base.line.rows, (l) => value(l, middle)),
      colour,
      width: 2,
      points: true,
      format,
    });
  return series;
}

/** From a parameter to its physical value, where the model says what 1 means; else the parameter itself. */
export function parameterScale(p: ParameterDescription | undefined): Scale {
  const { value = 1, units } = p?.reference ?? {};
  if (!prettyUnits(units)) return { factor: 1, units: "" };
  // Of the size that the prior gives it: a stiffness in Pa is written in GPa.
  const largest = (p?.values ?? [1]).reduce((a, b) => Math.max(a, Math.abs(b)), 0);
  const scale = scaleFor(units, Math.abs(value) * largest);
  return { factor: value * scale.factor, units: prettyUnits(scale.units) };
}

/**
 * As many digits as the whole uncertainty leaves: `shift`, in standard deviations, is by the reduced model's own error. Of what is
 * rejected two.
 */
export function worthDigits(line: StepLine | undefined, value: number, std: number, shift: number): string {
  return line?.verdict?.level === "reject"
    ? significant(Number(value.toPrecision(2)), 2)
    : withSpread(value, std * Math.hypot(1, shift));
}

/** How far the reduced model's own error moves a parameter; without one, the worst of them: a forecast. */
export function modelShift(line: StepLine | undefined, parameter?: number): number {
  const shifts = line?.verdict?.model_shift_std ?? [];
  return parameter === undefined ? Math.max(0, ...shifts) : (shifts[parameter] ?? 0);
}

/** Class of what shows numbers of this step: grey with caveats, struck out where they are rejected. */
export function worthClass(line: StepLine | undefined): string {
  return { ok: "", caution: "demoted", reject: "demoted rejected" }[line?.verdict?.level ?? "ok"];
}

export function parameterSpec(
  base: Base,
  k: number,
  description: ParameterDescription | undefined,
  name: string,
): ChartSpec {
  const { theme } = base;
  const latest = base.lines[base.lines.length - 1];
  const spread = Math.sqrt(latest?.covariance[k]?.[k] ?? NaN);
  const scale = parameterScale(description);
  const units = scale.units || scaleFor(description?.units, 1).units || "–";
  const physical = (v: number): string =>
    `${worthDigits(latest, v * scale.factor, spread * Math.abs(scale.factor), modelShift(latest, k))}${scale.units ? ` ${scale.units}` : ""}`;
  const series = quantileSeries(
    base,
    latest?.quantiles.levels ?? [],
    (l, level) => l.quantiles.values[k]?.[level],
    theme.blue,
    physical,
  );
  const prior =
    description?.levels && description.values ? { levels: description.levels, values: description.values } : undefined;
  const marks: Mark[] = [];
  const legend: LegendEntry[] = [];
  if (prior) {
    const { pairs, middle } = bandsOf(prior.levels);
    const outer = pairs[0];
    const at = (i: number): number => prior.values[i]!;
    if (outer) {
      marks.push({
        at: at(outer.high),
        label: `prior ${outer.percent} %`,
        colour: theme.prior,
        dash: [6, 4],
        include: true,
      });
      marks.push({ at: at(outer.low), label: "", colour: theme.prior, dash: [6, 4], include: true });
      legend.push({ label: `prior ${outer.percent} %`, colour: theme.prior, look: "dash", once: true });
    }
    if (middle !== undefined) {
      marks.push({ at: at(middle), label: "", colour: theme.prior, dash: [1, 3] });
      legend.push({
        label: "prior median",
        colour: theme.prior,
        look: "dash",
        value: `${significant(at(middle) * scale.factor)}${scale.units ? ` ${scale.units}` : ""}`,
        fact: true,
      });
    }
  }
  return {
    name: `parameter ${name}`,
    times: base.line.rows.map((r) => r.time),
    series,
    xLabel: timeLabel,
    yLabel: axisLabel(name, units),
    factor: scale.factor,
    horizontal: marks,
    gaps: base.line.gaps,
    legend,
    brief: k > 0,
    height: 190,
  };
}

/** The threshold of a forecast, a line across its plot; none where it has none. */
export function thresholdMarks(q: QuantityDescription, scale: ReturnType<typeof scaleFor>, theme: Theme): Mark[] {
  if (q.threshold === undefined) return [];
  const label = `threshold ${given(q.threshold * scale.factor)} ${scale.units}`;
  return [{ at: q.threshold, label, colour: theme.threshold, dash: [8, 4], include: true }];
}

/** Of the size of its largest quantile; of its threshold, where all are 0. */
export function forecastScale(q: QuantityDescription, forecast: Forecast | undefined): Scale {
  const largest = Math.max(0, ...(forecast?.values ?? [1]).map(Math.abs));
  return scaleFor(q.units ?? forecast?.units, largest || Math.abs(q.threshold ?? 0));
}

export function forecastSpec(base: Base, q: QuantityDescription): ChartSpec {
  const { theme } = base;
  const line = base.lines[base.lines.length - 1];
  const latest = line?.forecast[q.name];
  const scale = forecastScale(q, latest);
  const format = (v: number): string =>
    `${worthDigits(line, v * scale.factor, (latest?.std ?? NaN) * scale.factor, modelShift(line))} ${scale.units}`;
  const series = quantileSeries(
    base,
    latest?.levels ?? [],
    (l, level) => l.forecast[q.name]?.values[level],
    theme.orange,
    format,
  );
  const horizontal = thresholdMarks(q, scale, theme);
  return {
    name: `forecast ${q.name}`,
    times: base.line.rows.map((r) => r.time),
    series,
    xLabel: timeLabel,
    yLabel: axisLabel(quantityName(q), scale.units),
    factor: scale.factor,
    horizontal,
    vertical: horizonMarks(base, q),
    gaps: base.line.gaps,
    height: 250,
  };
}

/** A probability is drawn on a logarithmic axis; smaller ones, which its draws cannot tell apart, at its foot. */
const smallestShown = 1e-4;

export function probabilitySpec(base: Base, q: QuantityDescription): ChartSpec {
  const { theme } = base;
  return {
    name: `probability ${q.name}`,
    times: base.line.rows.map((r) => r.time),
    xLabel: timeLabel,
    yLabel: "P(failure) [%]",
    factor: 100,
    logarithmic: true,
    range: [100 * smallestShown, 130],
    ticks: decade,
    series: [
      {
        label: "P(failure) = P(q > threshold)",
        values: column(base.line.rows, (l) => {
          const p = l.forecast[q.name]?.probability_above_threshold;
          return p === undefined ? undefined : Math.max(p, smallestShown);
        }),
        said: column(base.line.rows, (l) => l.forecast[q.name]?.probability_above_threshold),
        colour: theme.red,
        points: true,
        format: probability,
      },
    ],
    vertical: horizonMarks(base, q).map((m) => ({ ...m, label: "" })),
    gaps: base.line.gaps,
    height: 150,
  };
}

function horizonMarks(base: Base, q: QuantityDescription): Mark[] {
  const last = base.lines[base.lines.length - 1]?.time ?? -Infinity;
  return q.horizon !== undefined && q.horizon < last
    ? [{ at: q.horizon, label: `horizon ${horizonWords(q)}`, colour: base.theme.green, dash: [2, 3] }]
    : [];
}

/** "load to 0.124 mm". */
export function actionWords({ action, time, load, units }: Decision): string {
  if (action !== "load") return action;
  return `load to ${load === undefined ? `time ${given(time)}` : imposed(load, units ?? "")}`;
}

export function quantityWords(q: QuantityDescription): string {
  return q.horizon === undefined ? quantityName(q) : `${quantityName(q)} at ${horizonWords(q)}`;
}

/** In units of the loading where they are known: "0.12 mm", "t = 0.3". */
function horizonWords({ horizon, loading, time_units }: QuantityDescription): string {
  if (!loading) return timeWords(horizon ?? NaN, time_units);
  return imposed(loading.value, loading.units);
}

function quantityName(q: QuantityDescription): string {
  return words(q.quantity && q.quantity !== "output" ? q.quantity : q.name);
}

export function evidenceSpec(base: Base): ChartSpec {
  const { theme } = base;
  return {
    name: "evidence",
    times: base.line.rows.map((r) => r.time),
    xLabel: timeLabel,
    yLabel: "ln evidence / value [–]",
    gaps: base.line.gaps,
    height: 190,
    series: [
      {
        label: "log-evidence increment per value used",
        values: column(base.line.rows, (l) => l.log_evidence_increment / l.used),
        colour: theme.purple,
        width: 1.5,
        points: true,
        format: (v) => significant(v, 4),
      },
    ],
  };
}

/** Stacked bars, the tallest drawn first. Steps without any datum have a bar all the same: their sensors are missing. */
export function dataSpec(base: Base): ChartSpec {
  const { lines, theme } = base;
  const count = (value: (l: StepLine) => number): number[] => lines.map(value);
  return {
    name: "data",
    times: count((l) => l.time),
    xLabel: timeLabel,
    yLabel: "sensors [–]",
    height: 150,
    range: [0, Math.max(1, ...count(total)) * 1.05],
    series: [
      {
        label: "missing",
        values: count(total),
        said: count((l) => l.missing),
        format: String,
        colour: theme.dark ? "#55626f" : "#b9c2cc",
        bars: true,
      },
      {
        label: "rejected",
        values: count((l) => l.used + l.rejected),
        said: count((l) => l.rejected),
        format: String,
        colour: theme.red,
        bars: true,
      },
      { label: "used", values: count((l) => l.used), format: String, colour: theme.blue, bars: true },
    ],
    gaps: timeline(lines).gaps.filter((g) => g.cause === "no step"),
  };
}

export function timingSpec(base: Base, budget: number | undefined): ChartSpec {
  const { lines, theme } = base;
  const phases = phasesOf(lines[lines.length - 1]?.elapsed_us ?? {}).filter((name) =>
    lines.some((l) => (l.elapsed_us[name] ?? 0) > 0),
  );
  const dashes = [[], [8, 3], [2, 3], [8, 3, 2, 3], [12, 4]];
  const names = [...phases, "total"];
  const rows = lines.map((line) => ({ time: line.time, line }));
  const drawn = lines.flatMap((l) => names.map((name) => l.elapsed_us[name] ?? 0)).filter((us) => us > 0);
  const isNarrow = Math.max(...drawn) < 100 * Math.min(...drawn);
  return {
    name: "timing",
    times: lines.map((l) => l.time),
    xLabel: timeLabel,
    yLabel: "time per update [ms]",
    factor: 1e-3,
    logarithmic: true,
    ticks: isNarrow ? halfDecade : decade,
    height: 380,
    series: names.map((name, k) => ({
      label: words(name),
      values: column(rows, (l) => l.elapsed_us[name] || undefined),
      colour: name === "total" ? theme.text : theme.series[k % theme.series.length]!,
      width: name === "total" ? 2 : 1.2,
      ...(name === "total" ? {} : { dash: dashes[k % dashes.length]! }),
      format: microseconds,
    })),
    horizontal:
      budget === undefined
        ? []
        : [{ at: budget, label: `budget ${microseconds(budget)}`, colour: theme.red, dash: [8, 4], include: true }],
    gaps: timeline(lines).gaps.filter((g) => g.cause === "no step"),
  };
}

/** Without `/v1/model` the lines still say how many parameters and which forecasts there are. */
export function parameterNames(model: Model | undefined, line: StepLine | undefined): string[] {
  return (line?.mean ?? model?.parameters ?? []).map((_, k) => model?.parameters[k]?.name ?? `p${k}`);
}

/** The first forecast that has not passed: what has never leads. */
export function firstOpen(all: readonly QuantityDescription[], line: StepLine | undefined): number {
  const open = all.findIndex((q) => !line?.forecast[q.name]?.past);
  return Math.max(0, open);
}

export function quantitiesIn(model: Model | undefined, line: StepLine | undefined): QuantityDescription[] {
  const described = model?.quantities ?? [];
  const more = Object.entries(line?.forecast ?? {}).filter(([name]) => !described.some((q) => q.name === name));
  return [...described, ...more.map(([name, f]) => ({ name, ...(f.units === undefined ? {} : { units: f.units }) }))];
}
