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

/**
 * The density of draws at `count` points over the interval: a Gaussian kernel with Silverman's bandwidth, 0.9 times the smaller of
 * standard deviation and quartile range / 1.34, over the fifth root of their number. Draws beyond an end are cut; what the kernel
 * carries over an end is reflected, for an end is where a prior has one.
 */
export function smoothDensity(draws: readonly number[], axis: Interval, count: number): number[] {
  const { low, high } = axis;
  const values = draws.filter((v) => v >= low && v <= high);
  const step = (high - low) / (count - 1);
  const mean = values.reduce((a, v) => a + v, 0) / (values.length || 1);
  const std = Math.sqrt(values.reduce((a, v) => a + (v - mean) ** 2, 0) / (values.length || 1));
  const quartiles = ((quantile(values, 0.75) ?? 0) - (quantile(values, 0.25) ?? 0)) / 1.34;
  const spread = quartiles > 0 ? Math.min(std, quartiles) : std;
  const width = Math.max((0.9 * spread) / (values.length || 1) ** 0.2, step / 2);
  const heights = new Array<number>(count).fill(0);
  const add = (v: number): void => {
    const first = Math.max(0, Math.ceil((v - 5 * width - low) / step));
    const end = Math.min(count - 1, Math.floor((v + 5 * width - low) / step));
    for (let i = first; i <= end; i += 1) heights[i]! += Math.exp(-0.5 * ((low + i * step - v) / width) ** 2);
  };
  for (const v of values) {
    add(v);
    if (v - low < 5 * width) add(2 * low - v);
    if (high - v < 5 * width) add(2 * high - v);
  }
  const scale = 1 / ((draws.length || 1) * width * Math.sqrt(2 * Math.PI));
  return heights.map((h) => h * scale);
}

/** Multiples of 1, 2 or 5 times a power of ten, about `count` of them. */
export function ticks({ low, high }: Interval, count: number): number[] {
  const rough = (high - low) / count;
  const decade = 10 ** Math.floor(Math.log10(rough));
  const step = decade * ([1, 2, 5, 10].find((m) => m * decade >= rough) ?? 10);
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => (first + k) * step);
}
