/** A made-up assimilation as a report holds it: 40 steps, two parameters, a forecast whose horizon is over and one that is not. */
import type { Assimilation, Field, ReportLine } from "../src/report/record";
import { stepLine } from "./support";

const steps = 40;

function bell(mean: number, std: number): { points: number[]; density: number[] } {
  const points = Array.from({ length: 101 }, (_, i) => mean + std * (-5 + i / 10));
  return {
    points,
    density: points.map((x) => Math.exp(-0.5 * ((x - mean) / std) ** 2) / (std * Math.sqrt(2 * Math.PI))),
  };
}

export function line(i: number): ReportLine {
  const std = 0.3 / Math.sqrt(i + 1);
  const mean = 1 + 0.1 * Math.sin(i);
  const base = stepLine(i);
  return {
    ...base,
    mean: [mean, 2],
    covariance: [
      [std * std, 0],
      [0, 0.01],
    ],
    quantiles: {
      levels: [0.025, 0.5, 0.975],
      values: [
        [mean - 1.96 * std, mean, mean + 1.96 * std],
        [1.8, 2, 2.2],
      ],
    },
    marginals: { Y0: bell(mean, std), b: bell(2, 0.1) },
    monitor: { cumulative_sum: 0.3 * i, threshold: 9.5, alarm: i >= 32, smoothed_increment: 1 },
    models: { "a.h5": { probability: 0.75 }, "b.h5": { probability: 0.25 } },
    decision: {
      action: i < 30 ? "load" : "hold",
      time: i < 30 ? base.time + 0.01 : base.time,
      furthest: 0.5,
      failure_probability: 1e-3 * i,
      allowed_probability: 0.05,
      message: "why",
    },
    forecast: {
      crack: { ...base.forecast.crack!, density: { points: [0.01, 0.02, 0.03], values: [0, 100, 0] } } as never,
    },
  };
}

function field(title: string, time?: number): Field {
  // Four nodes of a square of 0.1 m.
  return { title, x: [0, 1e-4, 1e-4, 0], y: [0, 0, 2e-4, 2e-4], ...(time === undefined ? {} : { time }) };
}

export function record(more: Partial<Assimilation> = {}): Assimilation {
  const lines = Array.from({ length: steps }, (_, i) => line(i));
  const time = lines.map((l) => l.time);
  return {
    kind: "assimilation",
    lines,
    summary: {
      parameters: [
        { name: "Y0", lower: 0.5, upper: 1.5, reference: 216, units: "J/m3", truth: 1.05 },
        { name: "b", units: "N/m" },
      ],
      prior_marginals: { Y0: bell(0.9, 0.4), b: bell(2, 0.5) },
      draws: { Y0: [0.9, 1, 1.1], b: [1.9, 2, 2.1] },
      forecasts: { crack: { quantity: "crack_length", horizon: 0.3, threshold: 0.025, unit: "m" } },
      residuals: { step: [0, 1], step_rms: [1e-6, 2e-6], noise_rms: [1e-6, 1e-6] },
    },
    measured: [
      {
        label: "u_y at (12.0, 30.0) mm",
        units: "m",
        time,
        measured: time.map((t, i) => (i === 5 ? null : -1e-4 * t)),
        mean: time.map((t) => -1e-4 * t),
        low: time.map((t) => -1e-4 * t - 2e-6),
        high: time.map((t) => -1e-4 * t + 2e-6),
      },
    ],
    residuals: {
      time: time.flatMap((t) => [t, t]),
      value: time.flatMap((_, i) => [Math.sin(7 * i), Math.cos(11 * i)]),
    },
    sensors: { x: [0.02, 0.08], y: [0.05, 0.05], component: "xy", mean: [1e-6, -2e-6], averaged: 10 },
    specimen: {
      points: [
        [0, 0],
        [0.1, 0],
        [0.1, 0.1],
        [0, 0.1],
      ],
      cells: [[0, 1, 2, 3]],
      fields: [field("Displacement", 0), field("Displacement", 0.2), field("Displacement", 1)],
      modes: [field("Space mode 1")],
      crack: [field("Elastic beam, crack of 25 mm")],
    },
    load: {
      time: [0, 0.2, 0.4, 0.6, 0.8, 1],
      displacement: [0, 1e-4, 2e-4, 3e-4, 4e-4, 5e-4],
      mean: [0, 1e3, 2e3, 1500, 1e3, 500],
      low: [0, 900, 1800, 1200, 700, 300],
      high: [0, 1100, 2200, 1800, 1300, 700],
    },
    functions: [
      {
        x: [0, 1],
        curves: [{ label: "mode 1", y: [0, 2] }],
        xLabel: "model time t [–]",
        yLabel: "largest value of the mode [–]",
      },
    ],
    ...more,
  };
}
