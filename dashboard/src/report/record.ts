/** What a report holds as JSON: the record that the program left, and what its pictures need of the model. All numbers are SI. */
import { prettyUnits } from "../format";
import { loadingAt } from "../signal";
import type { Decision, Model, ParameterDescription, QuantityDescription, StepLine } from "../types";

/** A density of one number on increasing points. */
export interface Density {
  points: number[];
  density?: number[];
  values?: number[];
}

export interface ReportDecision extends Decision {
  /** None where the answer does not tell (a verdict of `reject`). */
  failure_probability?: number;
  allowed_probability?: number;
  /** Model time beyond which the risk allows no load. */
  furthest: number;
}

export interface ReportLine extends StepLine {
  decision?: ReportDecision;
  marginals?: Record<string, Density>;
  monitor?: {
    cumulative_sum: number;
    threshold: number;
    alarm: boolean;
    smoothed_increment: number;
    discrepancy?: number;
  };
  models?: Record<string, { probability: number }>;
}

export interface ParameterSummary {
  name: string;
  lower?: number;
  upper?: number;
  reference?: number;
  units?: string;
  truth?: number;
}

export interface Summary {
  parameters?: ParameterSummary[];
  prior_marginals?: Record<string, Density>;
  draws?: Record<string, number[]>;
  forecasts?: Record<
    string,
    { quantity?: string; output?: string; horizon?: number; threshold?: number; unit?: string }
  >;
  residuals?: { step?: number[]; step_rms?: number[]; noise_rms?: number[] };
}

/** A signal as it was measured, and what the posterior predicts for it with its noise: mean and 95 %. */
export interface Measured {
  label: string;
  units?: string;
  time: number[];
  measured: (number | null)[];
  mean: (number | null)[];
  low: (number | null)[];
  high: (number | null)[];
}

/** Displacements (m) at the nodes of a face. */
export interface Field {
  title: string;
  time?: number;
  x: number[];
  y: number[];
}

/** The face of the structure that is drawn, and its sensors; m. */
export interface Specimen {
  points: [number, number][];
  cells: number[][];
  /** At the last posterior mean, at some times. */
  fields: Field[];
  modes?: Field[];
  crack?: Field[];
}

export interface Sensors {
  x: number[];
  y: number[];
  component: string;
  /** Mean residual of the last steps, m. */
  mean: number[];
  averaged: number;
}

/** Curves over one axis. */
export interface Curves {
  x: number[];
  curves: { label: string; y: number[] }[];
  xLabel: string;
  yLabel: string;
}

export interface Assimilation {
  kind: "assimilation";
  lines: ReportLine[];
  summary: Summary;
  /** Of the model's time, where the solver states one. */
  time_units?: string;
  measured?: Measured[];
  /** Measured minus predicted, in standard deviations of the prediction, of all sensors. */
  residuals?: { time: number[]; value: number[] };
  sensors?: Sensors;
  specimen?: Specimen;
  /** Load over displacement at draws of the last posterior. */
  load?: { time: number[]; displacement: number[]; mean: number[]; low?: number[]; high?: number[] };
  /** Time and parameter functions of the reduced model. */
  functions?: Curves[];
}

/** inference.json. */
export interface InferenceContent {
  method: string;
  parameters: string[];
  mean: number[];
  covariance: number[][];
  maximum_a_posteriori: number[];
  /** In physical units, where the model states any. */
  physical?: Record<string, { mean: number; std: number; units?: string }>;
  quantiles: { levels: number[]; values: number[][] };
  log_evidence: number;
  map_order: number;
  variance_diagnostic: number;
  tolerance?: number;
  figures: {
    posterior: Density[];
    prior?: Density[];
    /** Beside their prediction at the most probable parameters; the residuals in standard deviations of the noise. */
    observations?: { residual: number[]; measured?: number[]; predicted?: number[]; std?: number[] };
    draws: number[][];
    map?: Density[];
    map_draws?: number[][];
    pull_back?: Density[];
    reference?: Density[];
    pull_back_draws?: number[][];
    diagnostic_by_order?: number[];
    objective_by_order?: number[];
  };
}

export interface Inference {
  kind: "inference";
  content: InferenceContent;
}

/** What a comparison holds of each of its inferences. */
export type Compared = Pick<InferenceContent, "method" | "parameters" | "covariance" | "physical"> & {
  figures: Pick<InferenceContent["figures"], "posterior">;
};

export interface Comparison {
  kind: "comparison";
  contents: [Compared, Compared];
}

/** A field of numbers on a face, with places marked on it. */
export interface Sensitivity {
  title: string;
  value: number[];
  units: string;
  chosen: { x: number[]; y: number[] };
}

export interface Selection {
  kind: "selection";
  parameters: string[];
  prior_std: number[];
  all_std: number[];
  candidates: number;
  curves: { name: string; std: number[][] }[];
  specimen?: { points: [number, number][]; cells: number[][] };
  fields?: Sensitivity[];
}

/** Curves that need nothing but themselves. */
export interface Plain {
  kind: "curves";
  figures: { x: number[][]; y: number[][]; labels: string[]; xLabel: string; yLabel: string }[];
}

/** Of the theme: a name, or a number of its series. */
export type StudyColour = number | "blue" | "orange" | "green" | "red" | "purple" | "faint" | "prior" | "text";

export interface StudyCurve {
  label: string;
  x: number[];
  y: (number | null)[];
  colour?: StudyColour;
  width?: number;
  dashed?: boolean;
  /** A line with its points. */
  points?: boolean;
  look?: "points" | "bars";
}

export interface StudyChart {
  kind: "chart";
  title: string;
  x: string;
  y: string;
  logarithmic?: boolean;
  /** Where the vertical axis begins. */
  least?: number;
  curves: StudyCurve[];
  bands: { label: string; x: number[]; low: (number | null)[]; high: (number | null)[]; colour?: StudyColour }[];
  marks: { label: string; colour?: StudyColour; x?: number; y?: number }[];
}

export interface StudyDensities {
  kind: "densities";
  title: string;
  label: string;
  units: string;
  steps: ({ step: number } & Density)[];
  prior?: Density;
  truth?: number;
}

/** `value` at the nodes, or a field that moves them, whose x is the value. */
export interface StudyMap {
  kind: "map";
  title: string;
  face: number;
  label: string;
  units: string;
  signed: boolean;
  value?: number[];
  field?: { x: number[]; y: number[] };
  sensors?: { x: number; y: number; words: string }[];
}

/** The published study: every drawing of its page, in order (studies/reproduction/record.py). */
export interface Study {
  kind: "study";
  faces: { points: [number, number][]; cells: number[][] }[];
  drawings: (StudyChart | StudyDensities | StudyMap)[];
}

/** Displacements from pictures, in `unit`. */
export interface Maps {
  kind: "maps";
  unit: string;
  /** What u and v are called. */
  labels: [string, string];
  /** 1: v is upwards; −1: down. */
  up: number;
  points: [number, number][];
  cells: number[][];
  /** `out`: elements without a measurement; u and v are empty where nothing was measured. */
  pictures: { name: string; time: number; u: number[]; v: number[]; out: number[]; noise: number }[];
}

/** A line that somebody drew on a map: from, to. */
export type Probe = [number, number, number, number];

export type Report = Assimilation | Inference | Comparison | Selection | Plain | Study | Maps;

/** What the slider moves through. */
export function framesOf(report: Report): { label: string; time: number }[] {
  if (report.kind === "assimilation") return report.lines.map((l) => ({ label: String(l.step), time: l.time }));
  return report.kind === "maps" ? report.pictures.map((p) => ({ label: p.name, time: p.time })) : [];
}

/** "Y0" → "Y₀". */
export function pretty(name: string): string {
  return name === "Y0" ? "Y₀" : name === "Ad" ? "A_d" : name;
}

/** The axis of a parameter: what 1 means, or its unit. */
export function parameterMeaning(p: ParameterSummary): string {
  const units = prettyUnits(p.units);
  return p.reference !== undefined && p.reference !== 1
    ? `1 = ${Number(p.reference.toPrecision(4))}${units ? ` ${units}` : ""}`
    : units;
}

/** Quantiles of a density, by the trapezoidal rule. */
export function quantilesOf(density: Density, levels: readonly number[]): number[] {
  const { points } = density;
  const values = density.density ?? density.values ?? [];
  const sums = [0];
  for (let i = 1; i < points.length; i += 1)
    sums.push(sums[i - 1]! + 0.5 * (values[i]! + values[i - 1]!) * (points[i]! - points[i - 1]!));
  const whole = sums[sums.length - 1]!;
  return levels.map((level) => {
    const at = Math.max(
      1,
      sums.findIndex((s) => s >= level * whole),
    );
    const step = sums[at]! - sums[at - 1]!;
    const along = step > 0 ? (level * whole - sums[at - 1]!) / step : 0;
    return points[at - 1]! + along * (points[at]! - points[at - 1]!);
  });
}

/** What is imposed at a time, where the record has it. */
export function imposedAt({ load }: Assimilation, time: number | undefined): QuantityDescription["loading"] {
  if (!load || time === undefined) return undefined;
  const loading = { name: "imposed_displacement", units: "m", values: load.displacement };
  return loadingAt({ times: load.time, loading }, time);
}

/** What the live page is told once, from what the summary says. */
export function modelOf(record: Assimilation): Model {
  const { summary } = record;
  const last = record.lines[record.lines.length - 1]!;
  const levels = last.quantiles.levels;
  const parameters = (summary.parameters ?? []).map((p): ParameterDescription => {
    const prior = summary.prior_marginals?.[p.name];
    return {
      name: pretty(p.name),
      ...(p.lower === undefined ? {} : { lower: p.lower }),
      ...(p.upper === undefined ? {} : { upper: p.upper }),
      units: parameterMeaning(p),
      reference: { value: p.reference ?? 1, ...(p.units === undefined ? {} : { units: p.units }) },
      ...(prior ? { levels, values: quantilesOf(prior, levels) } : {}),
    };
  });
  const loading = (time: number | undefined): Pick<QuantityDescription, "loading"> => {
    const found = imposedAt(record, time);
    return found ? { loading: found } : {};
  };
  const quantities = Object.entries(summary.forecasts ?? {}).map(([name, f]): QuantityDescription => ({
    name,
    ...loading(f.horizon),
    ...(record.time_units === undefined ? {} : { time_units: record.time_units }),
    ...(f.quantity === undefined ? {} : { quantity: f.quantity }),
    ...(f.output === undefined ? {} : { output: f.output }),
    ...(f.unit === undefined ? {} : { units: prettyUnits(f.unit) }),
    ...(f.horizon === undefined ? {} : { horizon: f.horizon }),
    ...(f.threshold === undefined ? {} : { threshold: f.threshold }),
  }));
  return { parameters, quantities };
}
