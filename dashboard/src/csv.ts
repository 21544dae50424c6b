/** Tables as CSV (RFC 4180, SI units, full precision). Pure. */
import type { Mesh, Sensors, SensorsAnswer, StepLine } from "./types";

export type Cell = number | string | boolean | null | undefined;

export function csv(header: readonly string[], rows: readonly (readonly Cell[])[]): string {
  return [header, ...rows].map((row) => row.map(cell).join(",")).join("\r\n") + "\r\n";
}

function cell(value: Cell): string {
  if (value === null || value === undefined || (typeof value === "number" && !Number.isFinite(value))) return "";
  const text = String(value);
  return /[",\r\n]/.test(text) ? `"${text.replace(/"/g, '""')}"` : text;
}

/** Everything the lines hold, one row per step. */
export function stepsTable(lines: readonly StepLine[], parameters: readonly string[]): string {
  const first = lines[lines.length - 1];
  if (!first) return csv(["step"], []);
  const forecasts = Object.keys(first.forecast);
  const phases = Object.keys(first.elapsed_us);
  const header = [
    "step",
    "time",
    "used",
    "rejected",
    "missing",
    "trusted",
    "verdict",
    "bias_correction",
    "log_evidence",
    "log_evidence_increment",
    "map_order",
    "variance_diagnostic",
    "ess",
  ];
  parameters.forEach((name) => {
    header.push(`${name}_mean`, `${name}_std`, ...first.quantiles.levels.map((level) => `${name}_q${level}`));
  });
  forecasts.forEach((name) => {
    const f = first.forecast[name]!;
    header.push(
      `${name}_mean`,
      `${name}_std`,
      `${name}_probability_above_threshold`,
      ...f.levels.map((level) => `${name}_q${level}`),
    );
  });
  header.push(...phases.map((name) => `elapsed_us_${name}`));
  const rows = lines.map((line) => {
    const row: Cell[] = [
      line.step,
      line.time,
      line.used,
      line.rejected,
      line.missing,
      line.trusted,
      line.verdict?.level,
      line.bias_correction,
      line.log_evidence,
      line.log_evidence_increment,
      line.map_order,
      line.variance_diagnostic,
      line.ess,
    ];
    parameters.forEach((_, k) => {
      row.push(
        line.mean[k],
        Math.sqrt(line.covariance[k]?.[k] ?? NaN),
        ...first.quantiles.levels.map((__, l) => line.quantiles.values[k]?.[l]),
      );
    });
    forecasts.forEach((name) => {
      const f = line.forecast[name];
      row.push(
        f?.mean,
        f?.std,
        f?.probability_above_threshold,
        ...first.forecast[name]!.levels.map((_, l) => f?.values[l]),
      );
    });
    row.push(...phases.map((name) => line.elapsed_us[name]));
    return row;
  });
  return csv(header, rows);
}

/** A field of vectors, one row per mesh point. */
export function fieldTable(name: string, values: readonly number[][], mesh: Mesh): string {
  return csv(
    ["point", "x", "y", "z", `${name}_x`, `${name}_y`, `${name}_z`],
    values.map((v, i) => [i, ...(mesh.points[i] ?? []), ...v]),
  );
}

/** One row per sensor; what is missing is empty. */
export function sensorsTable(answer: SensorsAnswer, sensors: Sensors): string {
  const rows = answer.status.map((status, i): Cell[] => {
    const residual = answer.residual?.[i];
    const std = sensors.std[i] ?? NaN;
    return [
      i,
      ...(sensors.points[i] ?? []),
      sensors.components[i],
      std,
      status,
      residual,
      residual === undefined ? undefined : residual / std,
      answer.bias?.[i],
    ];
  });
  return csv(
    ["sensor", "x", "y", "z", "component", "noise_std", "status", "residual", "residual_in_std", "bias"],
    rows,
  );
}
