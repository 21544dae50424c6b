import type { StepLine } from "../src/types";

/** A line as the service sends it, with what a test cares about put in. */
export function stepLine(step: number, more: Partial<StepLine> = {}): StepLine {
  return {
    step,
    time: (step + 1) / 100,
    mean: [1, 2],
    covariance: [
      [0.04, 0.006],
      [0.006, 0.01],
    ],
    maximum_a_posteriori: [1.1, 2.1],
    quantiles: {
      levels: [0.025, 0.5, 0.975],
      values: [
        [0.6, 1, 1.4],
        [1.8, 2, 2.2],
      ],
    },
    map_order: 2,
    variance_diagnostic: 1e-4,
    ess: 0.99,
    trusted: true,
    log_evidence: 10,
    log_evidence_increment: 5,
    bias_correction: "off",
    used: 10,
    rejected: 0,
    missing: 0,
    elapsed_us: { projection: 10, map: 200, correction: 50, update: 260, forecast: 1000, total: 1260 },
    forecast: {
      crack: {
        mean: 0.02,
        std: 0.003,
        maximum_a_posteriori: 0.02,
        probability_above_threshold: 0.3,
        levels: [0.025, 0.5, 0.975],
        values: [0.014, 0.02, 0.026],
        units: "m",
      },
    },
    ...more,
  };
}

export function withProbability(step: number, p: number): StepLine {
  const line = stepLine(step);
  return { ...line, forecast: { crack: { ...line.forecast.crack!, probability_above_threshold: p } } };
}
