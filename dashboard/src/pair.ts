/** Geometry of the pair plot. Pure. */
import { quantile } from "./history";
import type { ParameterDescription, StepLine } from "./types";

export interface Interval {
  low: number;
  high: number;
}

/** Around the posterior, 4.5 standard deviations each way, inside the allowed range; or all of that range. */
export function axisOf(
  k: number,
  line: StepLine,
  parameter: ParameterDescription | undefined,
  whole: boolean,
): Interval {
  const std = Math.sqrt(line.covariance[k]?.[k] ?? 0) || Math.abs(line.mean[k] ?? 1) * 0.1 || 1;
  const prior = parameter?.values ?? [];
  const lower = parameter?.lower ?? Math.min(...prior, line.mean[k]! - 4.5 * std);
  const upper = parameter?.upper ?? Math.max(...prior, line.mean[k]! + 4.5 * std);
  if (whole) return { low: lower, high: upper };
  return { low: Math.max(lower, line.mean[k]! - 4.5 * std), high: Math.min(upper, line.mean[k]! + 4.5 * std) };
}

/** A posterior much narrower than that range is seen only close up. */
export function isNarrow(line: StepLine, parameters: readonly ParameterDescription[]): boolean {
  return line.mean.some((_, k) => {
    const p = parameters[k];
    return (
      p?.lower !== undefined &&
      p.upper !== undefined &&
      9 * Math.sqrt(line.covariance[k]?.[k] ?? 0) < 0.45 * (p.upper - p.lower)
    );
  });
}

/** Points of the ellipse that holds `mass` of a Gaussian with this mean and covariance of parameters i and j: radius² = −2 ln(1 − mass). */
export function ellipse(line: StepLine, i: number, j: number, mass: number, count = 64): [number, number][] {
  const c = (a: number, b: number): number => line.covariance[a]?.[b] ?? 0;
  const l11 = Math.sqrt(Math.max(0, c(i, i)));
  const l21 = l11 > 0 ? c(i, j) / l11 : 0;
  const l22 = Math.sqrt(Math.max(0, c(j, j) - l21 * l21));
  const radius = Math.sqrt(-2 * Math.log(1 - mass));
  return Array.from({ length: count + 1 }, (_, k) => {
    const [a, b] = [radius * Math.cos((2 * Math.PI * k) / count), radius * Math.sin((2 * Math.PI * k) / count)];
    return [line.mean[i]! + l11 * a, line.mean[j]! + l21 * a + l22 * b];
  });
}

export function correlation(line: StepLine, i: number, j: number): number {
  const c = line.covariance;
  return (c[i]?.[j] ?? 0) / Math.sqrt((c[i]?.[i] ?? 0) * (c[j]?.[j] ?? 0));
}

/** Heights of bins as a density over the interval. */
export function histogram(values: readonly number[], axis: Interval, bins: number): number[] {
  const width = (axis.high - axis.low) / bins;
  const counts = new Array<number>(bins).fill(0);
  for (const v of values) {
    const at = Math.floor((v - axis.low) / width);
    if (at >= 0 && at < bins) counts[at]! += 1;
  }
  return counts.map((n) => n / (values.length * width || 1));
}

/** Bins by Freedman and Diaconis, 5 to 30. */
export function binsFor(values: readonly number[], axis: Interval): number {
  const spread = (quantile(values, 0.75) ?? 0) - (quantile(values, 0.25) ?? 0);
  const width = (2 * spread) / Math.cbrt(values.length || 1);
  const bins = width > 0 ? Math.round((axis.high - axis.low) / width) : 10;
  return Math.min(30, Math.max(5, bins));
}

/** Multiples of 1, 2 or 5 times a power of ten, about `count` of them. */
export function ticks({ low, high }: Interval, count: number): number[] {
  const rough = (high - low) / count;
  const decade = 10 ** Math.floor(Math.log10(rough));
  const step = decade * ([1, 2, 5, 10].find((m) => m * decade >= rough) ?? 10);
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => (first + k) * step);
}
