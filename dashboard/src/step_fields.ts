// From docs/reference/lines.schema.json, by scripts/result_types.py: change knothe/record/fields.cpp, not this.

/** A step's line. */
export interface StepFields {
  /** Number of the step. */
  step: number;
  /** Model time. */
  time: number;
  /** When it was computed, UTC. */
  wall_clock: string;
  /** Names, in the order of all lists. */
  parameters: unknown[];
  /** Mean of each parameter. */
  mean: number[];
  /** Of the parameters, by rows. */
  covariance: number[][];
  /** Where the density of the parameters is largest. */
  maximum_a_posteriori: number[];
  /** Levels, and values by parameter. */
  quantiles: Record<string, unknown>;
  /** That made the weighted points. */
  method: string;
  /** Order of the map, 0 without one. */
  map_order: number;
  /** Verified variance diagnostic, 0 without a map. */
  variance_diagnostic: number;
  /** 1 if the tolerance was reached. */
  tolerance_reached: boolean;
  /** Effective sample size as a fraction of the weighted points. */
  ess: number;
  verdict: Record<string, unknown>;
  /** 1 if the computation is trusted. */
  trusted: boolean;
  /** Natural logarithm of the evidence of all data. */
  log_evidence: number;
  /** Natural logarithm of the predictive density of the step's datum. */
  log_evidence_increment: number;
  /** On or off. */
  bias_correction: string;
  /** Values that were used. */
  used: number;
  /** Values that were rejected. */
  rejected: number;
  /** Values that were not there. */
  missing: number;
  /** Time of each phase, µs. */
  elapsed_us: Record<string, unknown>;
  /** Forecasts by name. */
  forecast: Record<string, unknown>;
  /** Mean and std of each parameter in physical units. */
  physical: Record<string, unknown>;
  decision?: Record<string, unknown>;
}
