/** Figures of the reports that are not of an assimilation. Pure. */
import type { ChartSpec, LegendEntry } from "../chart";
import type { Theme } from "../colour";
import { decade, halfDecade, prettyUnits, scaleFor, significant } from "../format";
import { banded } from "../signal";
import type { StepLine } from "../types";
import { charts, mostPairs, pairWords, type Content } from "./content";
import { joined, withinTwo } from "./curves";
import { besideSpec, smoothed } from "./densities";
import type { Compared, Comparison, Density, Inference, InferenceContent, Plain, Selection } from "./record";

/** Methods whose densities are those of draws. */
const isDrawn = (c: Compared): boolean => c.method === "smc" || c.method === "mcmc";

const posteriorOf = (c: Compared, k: number): Density =>
  isDrawn(c) ? smoothed(c.figures.posterior[k]!) : c.figures.posterior[k]!;

/** An inference as a line of the live page, for its pairs. */
function lineOf(c: InferenceContent): StepLine {
  return {
    mean: c.mean,
    covariance: c.covariance,
    maximum_a_posteriori: c.maximum_a_posteriori,
    quantiles: c.quantiles,
    step: 0,
  } as unknown as StepLine;
}

/** From a parameter's numbers to its unit: of a model that states none, as of a server, there is no unit to write. */
export function meaning(c: Compared, k: number): { factor: number; units: string } {
  const physical = c.physical?.[c.parameters[k] ?? ""];
  const std = Math.sqrt(c.covariance[k]?.[k] ?? 0);
  if (!physical?.units || !(std > 0)) return { factor: 1, units: "" };
  const reference = physical.std / std;
  const scale = scaleFor(physical.units, Math.abs(physical.mean));
  return { factor: reference * scale.factor, units: prettyUnits(scale.units) || "–" };
}

const transposed = (columns: readonly (readonly number[])[]): number[][] =>
  (columns[0] ?? []).map((_, i) => columns.map((c) => c[i]!));

function orders(c: InferenceContent, of: string, theme: Theme): Content | undefined {
  const diagnostic = c.figures.diagnostic_by_order ?? [];
  const times = diagnostic.map((_, i) => i + 1);
  const shared = { times, xLabel: "order of the map", height: 230, sync: "", counts: true };
  if (of === "objective") {
    const objective = c.figures.objective_by_order?.slice(0, times.length);
    if (!objective) return undefined;
    return charts({
      ...shared,
      name: "objective",
      times: times.slice(0, objective.length),
      yLabel: "Kullback–Leibler objective [nats]",
      series: [{ label: "objective (training)", values: objective, colour: theme.green, points: true }],
      horizontal: [{ at: -c.log_evidence, label: "−log evidence", colour: theme.red, dash: [6, 4], include: true }],
    });
  }
  return charts({
    ...shared,
    name: "diagnostic",
    yLabel: "variance diagnostic [–]",
    logarithmic: true,
    ticks: decade,
    series: [
      {
        label: "on the training rule",
        values: diagnostic.map((v) => Math.max(v, 1e-16)),
        colour: theme.blue,
        points: true,
      },
      {
        label: "verified on other points",
        values: times.map((t) => (t === c.map_order ? Math.max(c.variance_diagnostic, 1e-16) : null)),
        colour: theme.orange,
        dots: true,
      },
    ],
    horizontal:
      c.tolerance === undefined
        ? []
        : [{ at: c.tolerance, label: "tolerance", colour: theme.red, dash: [6, 4], include: true }],
  });
}

/** What was observed, beside what the most probable parameters predict; and the residuals, which have no unit. */
function observations(c: InferenceContent, theme: Theme): Content | undefined {
  const { residual, measured, predicted, std } = c.figures.observations ?? {};
  if (!residual) return undefined;
  const times = residual.map((_, i) => i);
  const shared = { times, xLabel: "number of the observation", counts: true, sync: "" };
  const edge = (by: number): number[] => predicted!.map((v, i) => v + by * std![i]!);
  const values: ChartSpec | undefined = measured &&
    predicted &&
    std && {
      ...shared,
      name: "observations",
      yLabel: "value [unit of the project file]",
      series: [
        ...banded(theme.blue, edge(-1.96), edge(1.96), predicted, ["95 % of the noise", "predicted"], significant),
        { label: "measured", values: measured, colour: theme.orange, dots: true },
      ],
      height: 200,
    };
  return charts(values, {
    ...shared,
    name: "residuals",
    yLabel: values ? "residual [σ]" : "standardised residual [σ]",
    series: [{ label: "measured − predicted", values: residual, colour: theme.orange, dots: true }],
    horizontal: withinTwo(theme),
    height: values ? 130 : 280,
  });
}

export function inference(r: Inference, name: string, of: string, theme: Theme): Content | undefined {
  const c = r.content;
  const f = c.figures;
  const k = Number(of);
  const one = (
    density: NonNullable<typeof f.prior>[number] | undefined,
    label: string,
    colour: string,
    dash?: number[],
  ) => (density ? [{ label, density, colour, ...(dash ? { dash } : {}) }] : []);
  switch (name) {
    case "marginal":
      return charts(
        besideSpec(
          `marginal ${c.parameters[k]}`,
          c.parameters[k] ?? "",
          [
            ...one(f.prior?.[k], "prior", theme.prior, [6, 4]),
            ...one(f.map?.[k], "map, not corrected", theme.orange, [4, 3]),
            ...one(posteriorOf(c, k), isDrawn(c) ? "posterior, draws smoothed" : "posterior", theme.blue),
          ],
          [{ at: c.maximum_a_posteriori[k]!, label: "most probable", colour: theme.red, dash: [2, 3] }],
          meaning(c, k),
        ),
      );
    case "observations":
      return observations(c, theme);
    case "pairs": {
      const others: LegendEntry[] = f.map_draws
        ? [{ label: "map, not corrected", colour: theme.orange, look: "bar" }]
        : [];
      return {
        pairs: {
          count: Math.min(mostPairs, c.parameters.length),
          line: lineOf(c),
          lines: [],
          names: c.parameters,
          scales: c.parameters.map((_, i) => meaning(c, i)),
          points: transposed(f.draws),
          ...(f.map_draws ? { others: transposed(f.map_draws) } : {}),
          model: undefined,
          whole: false,
        },
        legend: pairWords(theme, others),
      };
    }
    case "pull_back":
      return charts(
        besideSpec(`pulled back ${k}`, `x${k + 1}`, [
          ...one(f.reference?.[k], "standard normal", theme.text, [5, 4]),
          ...one(f.pull_back?.[k], "posterior, pulled back", theme.blue),
        ]),
      );
    case "orders":
      return orders(c, of, theme);
  }
  return undefined;
}

export function comparison(r: Comparison, name: string, of: string, theme: Theme): Content | undefined {
  const k = Number(of);
  if (name !== "marginal") return undefined;
  const [a, b] = r.contents;
  return charts(
    besideSpec(
      `marginal ${a.parameters[k]}`,
      a.parameters[k] ?? "",
      [
        { label: a.method, density: posteriorOf(a, k), colour: theme.blue },
        { label: b.method, density: posteriorOf(b, k), colour: theme.orange, dash: [7, 4] },
      ],
      [],
      meaning(a, k),
    ),
  );
}

export function selection(r: Selection, name: string, of: string, theme: Theme): Content | undefined {
  const k = Number(of);
  if (name === "curve") {
    const x = r.curves.map((c) => [0, ...c.std.map((_, i) => i + 1)]);
    const y = r.curves.map((c) => [r.prior_std[k]!, ...c.std.map((row) => row[k]!)]);
    const look = r.curves.map((c, i) => ({ label: c.name, colour: theme.series[i % theme.series.length]! }));
    const all = [...y.flat(), r.all_std[k]!];
    return charts({
      ...joined(x, y, look),
      name: `selection ${r.parameters[k]}`,
      xLabel: "number of dofs",
      counts: true,
      yLabel: `posterior std of ${r.parameters[k]} [–]`,
      logarithmic: true,
      ticks: Math.max(...all) < 100 * Math.min(...all) ? halfDecade : decade,
      horizontal: [
        // Its words are in the legend: the curves come down to it, where words at its end would stand.
        { at: r.all_std[k]!, label: "", colour: theme.red, dash: [6, 4], include: true },
      ],
      legend: [{ label: `all ${r.candidates} dofs`, colour: theme.red, look: "dash" }],
      height: 240,
      sync: "",
    });
  }
  const field = r.fields?.[k];
  if (name !== "field" || !field || !r.specimen) return undefined;
  return {
    mesh: {
      title: field.title,
      points: r.specimen.points,
      cells: r.specimen.cells,
      value: field.value,
      label: "root of the sum over time, per prior std",
      units: field.units,
      sensors: field.chosen.x.map((x, i) => ({ x, y: field.chosen.y[i]!, words: "chosen" })),
    },
  };
}

export function plain(r: Plain, of: string, theme: Theme): Content | undefined {
  const f = r.figures[Number(of)];
  if (!f) return undefined;
  const look = f.labels.map((label, i) => ({ label, colour: theme.series[i % theme.series.length]! }));
  return charts({
    ...joined(f.x, f.y, look),
    name: `curves ${of}`,
    xLabel: f.xLabel,
    yLabel: f.yLabel,
    height: 260,
    sync: "",
  });
}
