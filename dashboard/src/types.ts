/** What the service sends: docs/reference/formats.md and docs/reference/dashboard.md. All numbers are SI. */
import type { StepFields } from "./step_fields";

export interface Forecast {
  mean: number;
  std: number;
  maximum_a_posteriori: number;
  probability_above_threshold?: number;
  probability_below_threshold?: number;
  past?: boolean; // the horizon is before this step
  levels: number[];
  values: number[];
  units?: string;
}

type Shown =
  | "step"
  | "time"
  | "mean"
  | "covariance"
  | "maximum_a_posteriori"
  | "map_order"
  | "variance_diagnostic"
  | "ess"
  | "trusted"
  | "log_evidence"
  | "log_evidence_increment"
  | "bias_correction"
  | "used"
  | "rejected"
  | "missing";

/** One assimilated step, what the page shows of it. `quantiles.values` is parameter × level. */
export interface StepLine extends Pick<StepFields, Shown> {
  quantiles: { levels: number[]; values: number[][] };
  elapsed_us: Record<string, number>;
  forecast: Record<string, Forecast>;
  /** Why the step is not trusted. */
  remark?: string;
  /** When its last datum came, Unix time, s. */
  received_at?: number;
  verdict?: Verdict;
  decision?: Decision;
}

export const actions = ["load", "hold", "stop"] as const;

/** What to do next with the specimen, of a project that asks: load to `time`, where `load` is imposed. */
export interface Decision {
  action: (typeof actions)[number];
  time: number;
  message: string;
  load?: number;
  units?: string;
}

export const verdictLevels = ["ok", "caution", "reject"] as const;
export type VerdictLevel = (typeof verdictLevels)[number];

/** Can the result be used, and why not. */
export interface Verdict {
  level: VerdictLevel;
  reasons: { level: VerdictLevel; message: string }[];
  /** How far the reduced model's own error moves each mean, in standard deviations; where it is known. */
  model_shift_std?: number[];
}

export interface ParameterDescription {
  name: string;
  prior?: string;
  lower?: number;
  upper?: number;
  units?: string;
  /** Physical value of 1.0, and its units. */
  reference?: { value: number; units?: string };
  /** Quantiles of the prior. */
  levels?: number[];
  values?: number[];
}

export interface QuantityDescription {
  name: string;
  quantity?: string;
  /** Of a quantity that is an output of the model: its name. */
  output?: string;
  units?: string;
  horizon?: number;
  /** Of the horizon, where the solver states one. */
  time_units?: string;
  /** What is imposed at the horizon. */
  loading?: { value: number; units: string };
  threshold?: number;
}

export interface Sensors {
  points: number[][];
  components: string[];
  std: number[];
}

export interface Mesh {
  type: string;
  points: number[][];
  cells: number[][];
}

/** What the page needs to know once: `/v1/description` and `/v1/mesh`. */
export interface Model {
  /** Another one makes the page forget what it has. */
  run?: string;
  /** The journal's number, which the stream of events carries too. */
  journal?: string;
  /** Name of the test; empty: it has none. */
  test?: string;
  version?: string;
  site?: string;
  sites?: string[];
  /** Number of model times. */
  steps?: number;
  /** What a measurement holds: so many displacements, then these series. */
  displacements?: number;
  scalars?: string[];
  /** The signal to show first, by index or name. */
  signal?: string;
  time?: { units?: string };
  period_s?: number;
  budget_us?: number;
  stale_after_s?: number;
  fields?: string[];
  parameters: ParameterDescription[];
  quantities: QuantityDescription[];
  /** Where the pictures lie that data are measured in: model places of the corners top left, top right, bottom left. */
  picture?: { corners: number[][] };
  mesh?: Mesh;
  sensors?: Sensors;
}

export const stateWords = ["OK", "DEGRADED", "STALE", "BIASED", "DIVERGED", "FINISHED"] as const;
export type StateWord = (typeof stateWords)[number];
/** What STALE may be: waiting for the first datum, no data for a time, no contact (which only the page knows). */
export const quietWords = ["WAITING", "NO DATA", "NO CONTACT"] as const;
export type QuietWord = (typeof quietWords)[number];

/** `/v1/status`. */
export interface Status {
  state: StateWord;
  reason?: string;
  /** Whether data arrive, whatever the state; absent of older services. */
  data_flow?: "waiting" | "arriving" | "silent" | "finished";
  /** Of the latest step's verdict: the structure's state, beside the service's. */
  structure?: VerdictLevel;
  step?: number;
  data_age_s?: number;
  period_s?: number;
  budget_us?: number;
  deadline_misses?: number;
  journal?: string;
  /** Number of data in quarantine. */
  quarantined?: number;
  /** Indices of the sensors that are switched off. */
  switched_off?: number[];
  misfit?: { statistic: number; values: number; probability: number };
  version?: string;
}

/** Fields of a step, one row per mesh point, m. Sensitivities by parameter: those that have been asked for. */
export interface FieldsAnswer {
  step: number;
  displacement: number[][];
  sensitivity: Record<string, number[][]>;
  bias?: number[][];
}

/** One entry per sensor; `undefined` where it has none. */
export interface SensorsAnswer {
  step: number;
  status: string[];
  reason: Record<string, string>;
  /** Measured minus predicted, m. */
  residual?: (number | undefined)[];
  bias?: (number | undefined)[];
}

/** Points are draw × parameter. */
export interface SamplesAnswer {
  step: number;
  points: number[][];
}

/** What a sensor measured, and what the posterior of `step` (at `time`) predicts of it at all times of the model. */
export interface SignalAnswer {
  name: string;
  units: string;
  step: number;
  time: number;
  times: number[];
  predicted: { mean: number[]; low?: number[]; high?: number[] };
  measured?: { time: number[]; value: number[] };
  /** What is imposed at the times. */
  loading?: { name: string; units: string; values: number[] };
}

export type Severity = "info" | "warning" | "alarm";

/** A datum that is stored and not assimilated, and why. */
export interface Held {
  source: string;
  session: string;
  seq: number;
  step: number;
  reason: string;
}

export interface Acknowledgement {
  by: string;
  comment: string;
  /** Unix time, s. */
  at?: number;
}

/** Of the logbook: what people did and said. */
export interface Entry {
  number: number;
  kind: string;
  /** Model time that it speaks of. */
  time: number;
  by: string;
  text: string;
  /** Unix time, s. */
  written_at?: number;
  sensor?: number;
}

/** A test of this structure, with a journal of its own. */
export interface TestRecord {
  name: string;
  current: boolean;
  /** Number of data in its journal. */
  records?: number;
  finished?: boolean;
  /** Unix time, s; of a test that was begun while the service ran. */
  begun_at?: number;
  followed_by?: string;
  /** Why nothing more is known of it. */
  problem?: string;
}

/** Something that happened, with its cause. */
export interface Event {
  /** Of the service's own alarms. */
  id?: number;
  /** Unix time, s. */
  raised_at?: number;
  acknowledged?: Acknowledgement;
  step: number;
  severity: Severity;
  kind: string;
  message: string;
}
