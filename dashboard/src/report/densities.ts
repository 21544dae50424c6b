/** Densities: successive ones of one number, and several side by side. Pure. */
import type { ChartSpec, Series } from "../chart";
import { colourAt, type Theme } from "../colour";
import { axisLabel, decade, scaleFor, significant } from "../format";
import { parameterScale, quantityWords } from "../specs";
import type { QuantityDescription } from "../types";
import { modelOf, parameterMeaning, pretty, type Assimilation, type Density } from "./record";

const shownDensities = 30;
const gridPoints = 200;
/** A density over fewer steps of the grid has points of its own. */
const narrowSteps = 20;

export function hex([r, g, b]: readonly number[]): string {
  return `#${[r, g, b].map((v) => v!.toString(16).padStart(2, "0")).join("")}`;
}

/** Time as a colour: viridis, without the end that the paper swallows. */
export function timeColour(fraction: number, theme: Theme): string {
  return hex(colourAt("viridis", theme.dark ? 0.15 + 0.85 * fraction : 0.85 * (1 - fraction)));
}

export function at(density: Density, x: number): number {
  const { points } = density;
  const values = density.density ?? density.values ?? [];
  // The last point of a grid over the same axis may be beyond it by rounding.
  const rounding = 1e-9 * (points[points.length - 1]! - points[0]!);
  const k = points.findIndex((p) => p >= x - rounding);
  if (k < 0 || x < points[0]! - rounding) return 0;
  if (k === 0) return values[0]!;
  const along = (x - points[k - 1]!) / (points[k]! - points[k - 1]! || 1);
  return values[k - 1]! + along * (values[k]! - values[k - 1]!);
}

/** The part of the axis where a density is worth seeing: above a five-hundredth of its peak, and one point more. */
export function support(densities: readonly Density[]): [number, number] {
  let low = Infinity;
  let high = -Infinity;
  for (const d of densities) {
    const values = d.density ?? d.values ?? [];
    const peak = values.reduce((a, b) => Math.max(a, b), 0);
    d.points.forEach((p, i) => {
      if (values[i]! < 2e-3 * peak) return;
      low = Math.min(low, d.points[i - 1] ?? p);
      high = Math.max(high, d.points[i + 1] ?? p);
    });
  }
  return low < high ? [low, high] : Number.isFinite(low) ? [low - 0.5, low + 0.5] : [0, 1];
}

/** The unit of a density over an axis in this one. */
const per = (units: string): string => (/[/ ]/.test(units) ? `1/(${units})` : `1/${units}`);

/** Points in steps over the whole axis, and those of a density that is too narrow for them to meet. */
function gridOf(densities: readonly Density[], low: number, high: number): number[] {
  const grid = Array.from({ length: gridPoints + 1 }, (_, i) => low + ((high - low) * i) / gridPoints);
  const narrow = densities.filter((d) => {
    const [from, to] = support([d]);
    return to - from < (narrowSteps * (high - low)) / gridPoints;
  });
  // Beside its first and last point it is 0, here as in `at`.
  const own = narrow.flatMap(({ points }) => {
    const [first, end] = [points[0]!, points[points.length - 1]!];
    const beside = 1e-3 * (end - first);
    return [first - beside, ...points, end + beside];
  });
  return [...new Set([...grid, ...own.filter((x) => x >= low && x <= high)])].sort((a, b) => a - b);
}

/** Densities on one grid: `factor` from SI to the axis. */
function densitySeries(grid: readonly number[], factor: number, d: Density, look: Omit<Series, "values">): Series {
  return { ...look, values: grid.map((x) => at(d, x / factor) / factor) };
}

interface DensityPlot {
  name: string;
  xLabel: string;
  factor: number;
  units: string;
  /** Oldest first; the last is the one looked at. */
  steps: { step: number; density: Density }[];
  prior: Density | undefined;
}

/** Successive densities of one number: earlier ones faint, by colour, the one looked at in front. */
export function densitySpec(plot: DensityPlot, theme: Theme): ChartSpec {
  const { factor, steps } = plot;
  const stride = Math.ceil(steps.length / shownDensities);
  const shown = steps.filter((_, i) => (steps.length - 1 - i) % stride === 0);
  const all = [...shown.map((s) => s.density), ...(plot.prior && shown.length < 2 ? [plot.prior] : [])];
  const [low, high] = support(all);
  const grid = gridOf(all, low, high).map((x) => factor * x);
  const series: Series[] = shown.map((s, i) => {
    const isLast = i === shown.length - 1;
    return densitySeries(grid, factor, s.density, {
      label: isLast ? `step ${s.step}` : `of step ${s.step}`,
      colour: isLast ? theme.blue : timeColour(i / Math.max(1, shown.length - 1), theme),
      width: isLast ? 2.6 : 0.8,
      ...(isLast ? {} : { hidden: true }),
      format: (v) => significant(v),
    });
  });
  if (plot.prior)
    series.unshift(
      densitySeries(grid, factor, plot.prior, { label: "prior", colour: theme.prior, width: 1.6, dash: [6, 4] }),
    );
  const peaks = shown.map(
    (s) => (s.density.density ?? s.density.values ?? []).reduce((a, b) => Math.max(a, b), 0) / factor,
  );
  const [least, most] = [Math.min(...peaks), Math.max(...peaks)];
  // Where the last densities dwarf the first, an axis from 0 would hide these.
  const logarithmic = least > 0 && most > 20 * least;
  return {
    name: plot.name,
    times: grid,
    series,
    xLabel: plot.xLabel,
    yLabel: axisLabel(logarithmic ? "density, logarithmic" : "probability density", plot.units ? per(plot.units) : "–"),
    ...(logarithmic
      ? { logarithmic, ticks: decade, range: [least / 100, most * 1.5] as [number, number] }
      : { range: [0, 1.08 * most] as [number, number] }),
    legend:
      shown.length > 1
        ? [{ label: `earlier steps, from ${shown[0]!.step}`, colour: timeColour(0.3, theme), look: "line" }]
        : [],
    height: 250,
    sync: "",
  };
}

export function marginalSpec(record: Assimilation, k: number, chosen: number, theme: Theme): ChartSpec | undefined {
  const p = record.summary.parameters?.[k];
  const steps = record.lines
    .slice(0, chosen + 1)
    .flatMap((l) => (p && l.marginals?.[p.name] ? [{ step: l.step, density: l.marginals[p.name]! }] : []));
  if (!p || steps.length === 0) return undefined;
  const scale = parameterScale(modelOf(record).parameters[k]);
  const spec = densitySpec(
    {
      name: `marginal ${p.name}`,
      xLabel: axisLabel(pretty(p.name), scale.units || parameterMeaning(p) || "–"),
      factor: scale.factor,
      units: scale.units,
      steps,
      prior: record.summary.prior_marginals?.[p.name],
    },
    theme,
  );
  return p.truth === undefined
    ? spec
    : { ...spec, vertical: [{ at: p.truth * scale.factor, label: "true value", colour: theme.red, dash: [6, 4] }] };
}

export function forecastDensitySpec(
  record: Assimilation,
  q: QuantityDescription,
  chosen: number,
  theme: Theme,
): ChartSpec | undefined {
  const steps = record.lines.slice(0, chosen + 1).flatMap((l) => {
    const density = (l.forecast[q.name] as { density?: Density } | undefined)?.density;
    return density && density.points.length > 1 ? [{ step: l.step, density }] : [];
  });
  if (steps.length === 0) return undefined;
  const scale = scaleFor(q.units, support(steps.map((s) => s.density))[1]);
  const spec = densitySpec(
    {
      name: `density of ${q.name}`,
      xLabel: axisLabel(quantityWords(q), scale.units),
      factor: scale.factor,
      units: scale.units,
      steps,
      prior: undefined,
    },
    theme,
  );
  return q.threshold === undefined
    ? spec
    : {
        ...spec,
        vertical: [{ at: q.threshold * scale.factor, label: "threshold", colour: theme.threshold, dash: [8, 4] }],
      };
}

/** The length of the axis on which a density is above half of its peak: 2.4 std of a normal one, of several modes their sum. */
function widthOf(points: readonly number[], values: readonly number[]): number {
  const half = 0.5 * values.reduce((a, b) => Math.max(a, b), 0);
  return values.reduce((sum, v, i) => {
    const [before, after] = [points[Math.max(0, i - 1)]!, points[Math.min(points.length - 1, i + 1)]!];
    return v > half ? sum + 0.5 * (after - before) : sum;
  }, 0);
}

/**
 * The density of draws without the waves of single draws: averaged with a normal kernel, a tenth as wide as the density at half of
 * its peak (a quarter of a normal one's std, which widens it by 3 %). At a bound nothing leaks out.
 */
export function smoothed(density: Density): Density {
  const { points } = density;
  const values = density.density ?? density.values ?? [];
  const width = 0.1 * widthOf(points, values);
  if (!(width > 0)) return density;
  const average = points.map((x) => {
    let [sum, weights] = [0, 0];
    points.forEach((y, i) => {
      const weight = Math.exp(-0.5 * ((y - x) / width) ** 2);
      sum += weight * values[i]!;
      weights += weight;
    });
    return sum / weights;
  });
  return { points, density: average };
}

/** Densities side by side: prior and posterior, or two methods; `scale` to the unit, "" where none is known. */
export function besideSpec(
  name: string,
  xLabel: string,
  densities: readonly { label: string; density: Density; dash?: number[]; colour: string }[],
  marks: ChartSpec["vertical"] = [],
  scale: { factor: number; units: string } = { factor: 1, units: "–" },
): ChartSpec {
  const { factor, units } = scale;
  const [low, high] = support(densities.map((d) => d.density));
  const grid = gridOf(
    densities.map((d) => d.density),
    low,
    high,
  ).map((x) => factor * x);
  return {
    name,
    times: grid,
    series: densities.map((d) =>
      densitySeries(grid, factor, d.density, {
        label: d.label,
        colour: d.colour,
        width: d.dash ? 1.6 : 2.2,
        ...(d.dash ? { dash: d.dash } : {}),
      }),
    ),
    xLabel: axisLabel(xLabel, units || "unit of the project file"),
    yLabel: axisLabel("probability density", units === "–" ? units : per(units || "unit")),
    vertical: marks.map((m) => ({ ...m, at: factor * m.at })),
    height: 230,
    sync: "",
  };
}
