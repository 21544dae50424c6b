/** What a sensor measured beside its prediction, over what is imposed: up to the last datum, then the forecast. Pure. */
import type { ChartSpec, Mark, Series } from "./chart";
import type { Theme } from "./colour";
import { axisLabel, given, imposed, imposedScale, scaleFor, significant, timeWords, words, type Scale } from "./format";
import { timeLabel } from "./specs";
import type { QuantityDescription, SignalAnswer } from "./types";

/** A mean with its band. */
export function banded(
  colour: string,
  low: (number | null)[],
  high: (number | null)[],
  mean: (number | null)[],
  labels: [string, string],
  format: (v: number) => string,
): Series[] {
  return [
    { label: "low", values: low, colour, hidden: true, format },
    { label: labels[0], values: high, colour, bandTo: 0, opacity: 0.28, format },
    { label: labels[1], values: mean, colour, width: 2, format },
  ];
}

/** Where the loading rises it is the axis; plots need increasing numbers, so a test that unloads is drawn over time. */
export interface LoadingAxis {
  label: string;
  at: (time: number) => number;
  /** A model time in words: "at 0.12 mm", "at t = 0.3". */
  words: (time: number) => string;
}

type Loaded = Pick<SignalAnswer, "times" | "loading">;

function rises(values: readonly number[]): boolean {
  return values.every((u, i) => i === 0 || u > values[i - 1]!);
}

export function loadingAxis({ times, loading }: Loaded, timeUnits: string | undefined): LoadingAxis {
  const overTime = { label: timeLabel, at: (t: number) => t, words: (t: number) => `at ${timeWords(t, timeUnits)}` };
  if (!loading || !rises(loading.values)) return overTime;
  const scale = imposedScale(loading.units, size(loading.values));
  const value = (time: number): number => interpolated(times, loading.values, time);
  return {
    label: axisLabel(words(loading.name), scale.units),
    at: (t) => scale.factor * value(t),
    words: (t) => `at ${imposed(value(t), loading.units)}`,
  };
}

/** What is imposed at a model time, where it rises. */
export function loadingAt({ times, loading }: Loaded, time: number): QuantityDescription["loading"] {
  if (!loading || !rises(loading.values) || !(time >= times[0]! && time <= times[times.length - 1]!)) return undefined;
  return { value: interpolated(times, loading.values, time), units: loading.units };
}

/** Linear between the times, held at the ends. */
function interpolated(times: readonly number[], values: readonly number[], time: number): number {
  const after = times.findIndex((t) => t >= time);
  if (after <= 0) return after === 0 ? values[0]! : values[values.length - 1]!;
  const part = (time - times[after - 1]!) / (times[after]! - times[after - 1]!);
  return values[after - 1]! + part * (values[after]! - values[after - 1]!);
}

function size(values: readonly (number | null)[]): number {
  return values.reduce<number>((a, b) => Math.max(a, Math.abs(b ?? 0)), 0);
}

/** Thresholds and horizons of the forecasts of this signal. */
function limits(
  s: SignalAnswer,
  quantities: readonly QuantityDescription[],
  axis: LoadingAxis,
  up: Scale,
  theme: Theme,
) {
  const own = quantities.filter((q) => q.output === s.name);
  const horizontal = own.flatMap((q): Mark[] =>
    q.threshold === undefined
      ? []
      : [
          {
            at: q.threshold * up.factor,
            label: `threshold ${given(q.threshold * up.factor)} ${up.units}`,
            colour: theme.threshold,
            dash: [8, 4],
            include: true,
          },
        ],
  );
  const vertical = own.flatMap((q): Mark[] =>
    q.horizon === undefined
      ? []
      : [{ at: axis.at(q.horizon), label: `horizon ${axis.words(q.horizon)}`, colour: theme.green, dash: [2, 3] }],
  );
  return { horizontal, vertical };
}

export function signalSpec(
  s: SignalAnswer,
  quantities: readonly QuantityDescription[],
  timeUnits: string | undefined,
  theme: Theme,
): ChartSpec {
  const { predicted, measured, times } = s;
  const axis = loadingAxis(s, timeUnits);
  const up = scaleFor(s.units, size(predicted.mean));
  const format = (v: number): string => `${significant(v, 4)}${up.units ? ` ${up.units}` : ""}`;
  const scaled = (v: readonly number[]): number[] => v.map((x) => x * up.factor);
  const end = times.findIndex((t) => t >= s.time * (1 - 1e-9));
  const isForecast = end >= 0 && end < times.length - 1;
  const cut = isForecast ? end : times.length - 1;
  const part = (from: number, to: number): (number | null)[] =>
    scaled(predicted.mean).map((v, i) => (i >= from && i <= to ? v : null));
  const { low, high } = predicted;
  const band: Series[] =
    low && high
      ? banded(
          theme.blue,
          scaled(low),
          scaled(high),
          part(0, cut),
          ["95 % of the probability", "posterior mean"],
          format,
        )
      : [{ label: "posterior mean", values: part(0, cut), colour: theme.blue, format }];
  const forecast: Series[] = isForecast
    ? [{ label: "forecast", values: part(cut, times.length), colour: theme.orange, dash: [7, 4], format }]
    : [];
  const dots = nearest(times, measured);
  const { horizontal, vertical } = limits(s, quantities, axis, up, theme);
  const now: Mark[] = isForecast
    ? [{ at: axis.at(times[end]!), label: "last datum", colour: theme.faint, dash: [2, 3] }]
    : [];
  return {
    name: `signal ${s.name}`,
    times: times.map(axis.at),
    series: [
      ...band,
      ...forecast,
      ...(dots
        ? [
            {
              label: "measured",
              values: dots.map((v) => (v === null ? null : v * up.factor)),
              colour: theme.text,
              dots: true,
              format,
            },
          ]
        : []),
    ],
    xLabel: axis.label,
    // "y3": a displacement without a name of its own.
    yLabel: axisLabel(words(s.name).replace(/^([xyz])(\d+)$/, "u_$1 of sensor $2"), up.units || "–"),
    horizontal,
    vertical: [...now, ...vertical],
    height: 250,
    sync: "",
  };
}

/** What was measured, at the model time nearest to each datum's. */
function nearest(times: readonly number[], measured: SignalAnswer["measured"]): (number | null)[] | undefined {
  if (!measured || measured.time.length === 0) return undefined;
  const values: (number | null)[] = times.map(() => null);
  let k = 0;
  measured.time.forEach((time, i) => {
    while (k + 1 < times.length && Math.abs(times[k + 1]! - time) <= Math.abs(times[k]! - time)) k += 1;
    values[k] = measured.value[i]!;
  });
  return values;
}
