/** From the record to plots that the live page does not have. Pure. */
import type { ChartSpec, Mark, Series } from "../chart";
import type { Theme } from "../colour";
import { axisLabel, decade, scaleFor, significant } from "../format";
import { timeline } from "../history";
import { banded, signalSpec } from "../signal";
import { timeLabel } from "../specs";
import type { SignalAnswer } from "../types";
import { modelOf, type Assimilation, type Curves, type Measured, type ReportLine } from "./record";

/** A signal: measured dots on what the posterior predicts. */
export function measuredSpec(record: Assimilation, m: Measured, theme: Theme): ChartSpec {
  const size = [...m.measured, ...m.mean].reduce<number>((a, b) => Math.max(a, Math.abs(b ?? 0)), 0);
  const scale = scaleFor(m.units, size);
  const scaled = (v: readonly (number | null)[]): (number | null)[] =>
    v.map((x) => (x === null ? null : x * scale.factor));
  const unit = scale.units ? ` ${scale.units}` : "";
  const format = (v: number): string => `${significant(v, 4)}${unit}`;
  const isRejected = record.lines[record.lines.length - 1]?.verdict?.level === "reject";
  const predicted = (v: number): string =>
    isRejected ? `${significant(Number(v.toPrecision(2)), 2)}${unit}` : format(v);
  return {
    name: `measured ${m.label}`,
    times: m.time,
    series: [
      ...banded(
        theme.blue,
        scaled(m.low),
        scaled(m.high),
        scaled(m.mean),
        ["95 % of the prediction", "predicted"],
        predicted,
      ),
      { label: "measured", values: scaled(m.measured), colour: theme.orange, dots: true, format, fact: true },
    ],
    xLabel: timeLabel,
    // Where a sensor is stands below the figure.
    yLabel: axisLabel(m.label.split(" at (")[0]!, scale.units || "–"),
    gaps: timeline(record.lines).gaps,
    height: 250,
  };
}

/** Load over displacement under the last posterior; what lies behind the last datum is a forecast. */
export function loadSpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  const { load } = record;
  if (!load) return undefined;
  const force = record.measured?.find((m) => m.label === "reaction_force");
  const known = force?.measured.flatMap((v, i) => (v === null ? [] : [[force.time[i]!, v] as const]));
  const signal: SignalAnswer = {
    name: "reaction_force",
    units: "N",
    step: record.lines[record.lines.length - 1]!.step,
    time: record.lines[record.lines.length - 1]!.time,
    times: load.time,
    predicted: load,
    ...(known ? { measured: { time: known.map(([t]) => t), value: known.map(([, v]) => v) } } : {}),
    loading: { name: "imposed_displacement", units: "m", values: load.displacement },
  };
  return { ...signalSpec(signal, modelOf(record).quantities, record.time_units, theme), name: "load" };
}

/** Of residuals in standard deviations. */
export const withinTwo = (theme: Theme): Mark[] =>
  [-2, 0, 2].map((v) => ({
    at: v,
    label: v > 0 ? "95 % within ±2" : "",
    colour: theme.faint,
    dash: v === 0 ? [1, 3] : [6, 4],
    include: true,
  }));

/** Residuals in standard deviations of their predictions: 95 % lie within ±2 where only noise is left. */
export function residualSpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  const r = record.residuals;
  if (!r || r.time.length === 0) return undefined;
  return {
    name: "residuals",
    times: r.time,
    series: [{ label: "measured − predicted", values: r.value, colour: theme.blue, dots: true }],
    xLabel: timeLabel,
    yLabel: "standardised residual [σ]",
    horizontal: withinTwo(theme),
    height: 250,
  };
}

/** Quantile function of the standard normal (Acklam's rational approximation, 1e-9). */
export function normalQuantile(p: number): number {
  const a = [
    -39.69683028665376, 220.9460984245205, -275.9285104469687, 138.357751867269, -30.66479806614716, 2.506628277459239,
  ];
  const b = [-54.47609879822406, 161.5858368580409, -155.6989798598866, 66.80131188771972, -13.28068155288572];
  const c = [
    -0.007784894002430293, -0.3223964580411365, -2.400758277161838, -2.549732539343734, 4.374664141464968,
    2.938163982698783,
  ];
  const d = [0.007784695709041462, 0.3224671290700398, 2.445134137142996, 3.754408661907416];
  const poly = (k: readonly number[], x: number): number => k.reduce((sum, v) => sum * x + v, 0);
  if (p < 0.02425) {
    const q = Math.sqrt(-2 * Math.log(p));
    return poly(c, q) / (poly(d, q) * q + 1);
  }
  if (p > 1 - 0.02425) return -normalQuantile(1 - p);
  const q = p - 0.5;
  return (q * poly(a, q * q)) / (poly(b, q * q) * q * q + 1);
}

/** Sorted residuals over the quantiles that a standard normal would give. */
export function qqSpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  const values = [...(record.residuals?.value ?? [])].sort((x, y) => x - y);
  if (values.length < 3) return undefined;
  const n = values.length;
  const stride = Math.ceil(n / 1200);
  const kept = values
    .map((v, i) => [normalQuantile((i + 0.5) / n), v] as const)
    .filter((_, i) => i % stride === 0 || i < 20 || i >= n - 20);
  const times = kept.map(([x]) => x);
  return {
    name: "quantiles",
    times,
    series: [
      { label: "standard normal", values: times, colour: theme.prior, dash: [6, 4], width: 1.5 },
      { label: "residuals", values: kept.map(([, y]) => y), colour: theme.blue, dots: true },
    ],
    xLabel: "quantile of a standard normal [σ]",
    yLabel: "residual quantile [σ]",
    height: 250,
    sync: "",
  };
}

function overSteps(
  record: Assimilation,
  more: Pick<ChartSpec, "name" | "yLabel" | "series"> & Partial<ChartSpec>,
): ChartSpec {
  return { times: record.lines.map((l) => l.time), xLabel: timeLabel, height: 210, ...more };
}

/** Steps at which the alarm goes off: at the one before it was silent. */
export function alarmsOf(lines: readonly ReportLine[]): number[] {
  return lines.flatMap((l, i) => (l.monitor?.alarm && !lines[i - 1]?.monitor?.alarm ? [i] : []));
}

export function monitorSpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  const { lines } = record;
  const threshold = lines[lines.length - 1]?.monitor?.threshold;
  if (threshold === undefined) return undefined;
  return overSteps(record, {
    name: "monitor",
    yLabel: "misfit statistic [–]",
    series: [
      { label: "misfit statistic", values: lines.map((l) => l.monitor?.cumulative_sum ?? null), colour: theme.blue },
    ],
    horizontal: [{ at: threshold, label: "alarm", colour: theme.red, dash: [8, 4], include: true }],
    vertical: alarmsOf(lines).map((i) => ({
      at: lines[i]!.time,
      label: `alarm, step ${lines[i]!.step}`,
      colour: theme.red,
    })),
  });
}

export function discrepancySpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  const values = record.lines.map((l) => l.monitor?.discrepancy ?? 0);
  if (!values.some((v) => v > 0)) return undefined;
  return overSteps(record, {
    name: "discrepancy",
    yLabel: "size of the model discrepancy κ [–]",
    series: [{ label: "posterior mean of κ", values, colour: theme.purple }],
  });
}

export function modelsSpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  const names = Object.keys(record.lines[record.lines.length - 1]?.models ?? {});
  if (names.length === 0) return undefined;
  return overSteps(record, {
    name: "models",
    yLabel: "probability of the model [–]",
    range: [0, 1.03],
    series: names.map((name, k) => ({
      label: name,
      values: record.lines.map((l) => l.models?.[name]?.probability ?? null),
      colour: theme.series[k % theme.series.length]!,
    })),
  });
}

function logDeterminant(covariance: readonly (readonly number[])[]): number {
  const n = covariance.length;
  const l = covariance.map((row) => [...row]);
  let sum = 0;
  for (let i = 0; i < n; i += 1) {
    for (let k = 0; k < i; k += 1) l[i]![i]! -= l[i]![k]! ** 2;
    const pivot = Math.sqrt(Math.max(l[i]![i]!, 1e-300));
    l[i]![i] = pivot;
    sum += 2 * Math.log(pivot);
    for (let j = i + 1; j < n; j += 1) {
      for (let k = 0; k < i; k += 1) l[j]![i]! -= l[j]![k]! * l[i]![k]!;
      l[j]![i]! /= pivot;
    }
  }
  return sum;
}

/** Fall of the entropy of the Gaussian with the posterior's covariance, nats. */
export function informationSpec(record: Assimilation, theme: Theme): ChartSpec {
  const entropy = record.lines.map((l) => 0.5 * logDeterminant(l.covariance));
  return overSteps(record, {
    name: "information",
    yLabel: "information gained [nats]",
    series: [
      {
        label: "fall of the entropy",
        values: entropy.map((h, i) => (i === 0 ? null : entropy[i - 1]! - h)),
        colour: theme.green,
        bars: true,
      },
    ],
  });
}

export function noiseSpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  const r = record.summary.residuals;
  if (!r?.step_rms?.length || !r.step) return undefined;
  const times = r.step.map((step) => record.lines.find((l) => l.step === step)?.time ?? step);
  const scale = scaleFor("m", Math.max(...r.step_rms));
  const scaled = (v: readonly number[]): number[] => v.map((x) => x * scale.factor);
  return {
    name: "residual size",
    times,
    series: [
      { label: "residuals of all sensors", values: scaled(r.step_rms), colour: theme.blue },
      ...(r.noise_rms
        ? [{ label: "noise of the sensors", values: scaled(r.noise_rms), colour: theme.orange, dash: [6, 4] }]
        : []),
    ],
    xLabel: timeLabel,
    yLabel: axisLabel("RMS", scale.units),
    height: 210,
  };
}

export function diagnosticSpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  if (!record.lines.some((l) => l.map_order > 0)) return undefined;
  return overSteps(record, {
    name: "diagnostic",
    yLabel: "variance diagnostic [–]",
    logarithmic: true,
    ticks: decade,
    // Below a millionth the map is exact for every purpose; a logarithmic axis must end somewhere.
    series: [
      {
        label: "on points not used to train the map",
        values: record.lines.map((l) => Math.max(l.variance_diagnostic, 1e-6)),
        colour: theme.blue,
      },
    ],
    horizontal: [{ at: 0.05, label: "limit for “trusted”", colour: theme.faint, dash: [6, 4], include: true }],
  });
}

export function orderSpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  if (!record.lines.some((l) => l.map_order > 0)) return undefined;
  return overSteps(record, {
    name: "order",
    yLabel: "order of the map [–]",
    range: [0, Math.max(...record.lines.map((l) => l.map_order)) + 0.5],
    series: [
      { label: "order of the map", values: record.lines.map((l) => l.map_order), colour: theme.purple, bars: true },
    ],
  });
}

export function curvesSpec(c: Curves, name: string, theme: Theme): ChartSpec {
  return {
    name,
    times: c.x,
    series: c.curves.map((one, k) => ({
      label: one.label,
      values: one.y,
      colour: theme.series[k % theme.series.length]!,
      width: 1.8,
    })),
    xLabel: c.xLabel,
    yLabel: c.yLabel,
    height: 230,
    sync: "",
  };
}

/** Curves, each over numbers of its own. */
export function joined(
  x: readonly (readonly number[])[],
  y: readonly (readonly (number | null)[])[],
  look: readonly Omit<Series, "values">[],
): Pick<ChartSpec, "times" | "series"> {
  const times = [...new Set(x.flat())].sort((a, b) => a - b);
  return {
    times,
    series: look.map((one, k) => {
      const value = new Map(x[k]!.map((v, i) => [v, y[k]![i]!]));
      return { ...one, values: times.map((t) => value.get(t)) };
    }),
  };
}
