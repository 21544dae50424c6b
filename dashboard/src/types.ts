/** What the service sends: interfaces.md, sections 4 and 7, and docs/service.md. All numbers are SI. */

export interface Forecast {
  mean: number;
  std: number;
  maximum_a_posteriori: number;
  probability_above_threshold?: number;
  levels: number[];
  values: number[];
  units?: string;
}

/** One assimilated step. `quantiles.values` is parameter × level. */
export interface StepLine {
  step: number;
  time: number;
  mean: number[];
  covariance: number[][];
  maximum_a_posteriori: number[];
  quantiles: { levels: number[]; values: number[][] };
  map_order: number;
  variance_diagnostic: number;
  ess: number;
  trusted: boolean;
  log_evidence: number;
  log_evidence_increment: number;
  bias_correction: string;
  used: number;
  rejected: number;
  missing: number;
  elapsed_us: Record<string, number>;
  forecast: Record<string, Forecast>;
  /** Why the step is not trusted. */
  remark?: string;
}

export interface ParameterDescription {
  name: string;
  prior?: string;
  lower?: number;
  upper?: number;
  units?: string;
  /** Quantiles of the prior. */
  levels?: number[];
  values?: number[];
}

export interface QuantityDescription {
  name: string;
  quantity?: string;
  units?: string;
  horizon?: number;
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

/** `GET /v1/model`: what the page needs to know once. */
export interface Model {
  site?: string;
  parameters: ParameterDescription[];
  time?: number[];
  quantities: QuantityDescription[];
  sensors?: Sensors;
  mesh?: Mesh;
  method?: Record<string, unknown>;
  model_sha256?: string;
  configuration_sha256?: string;
}

export const stateWords = ["OK", "DEGRADED", "STALE", "BIASED", "DIVERGED", "WAITING"] as const;
export type StateWord = (typeof stateWords)[number];

/** `GET /v1/status`. */
export interface Status {
  site?: string;
  state: StateWord;
  cause?: string;
  step?: number;
  time?: number;
  age_s?: number;
  period_s?: number;
  budget_us?: number;
  pending?: number;
  behind?: number;
  accepted?: number;
  quarantined?: number;
  deadline_misses?: number;
  read_only?: boolean;
  alarm?: { statistic: number; values: number; probability: number };
  version?: string;
}

/** `GET /v1/fields`: one row per mesh point, m. */
export interface FieldsAnswer {
  step: number;
  units?: string;
  displacement: number[][];
  sensitivity: Record<string, number[][]>;
  /** Correction of the model's bias, where the service has one. */
  bias?: number[][];
}

/** `GET /v1/sensors`: `status` has one word per sensor, the arrays run over the sensors in `index`. */
export interface SensorsAnswer {
  step: number;
  status: string[];
  index: number[];
  measured: number[];
  predicted: number[];
  normalised: number[];
  /** Correction of the model's bias, m, where the service has one. */
  bias?: number[];
}

/** `GET /v1/samples`: points are draw × parameter. */
export interface SamplesAnswer {
  step: number;
  points: number[][];
}

export type Severity = "info" | "warning" | "alarm";

/** Something that happened, with its cause. */
export interface Event {
  step: number;
  severity: Severity;
  kind: string;
  message: string;
}
