/** The page's routes (docs/reference/dashboard.md) to what the page works with. Pure. */
import { asVerdictLevel, isNumber, isNumbers, isObject } from "./parse";
import {
  stateWords,
  type Acknowledgement,
  type Entry,
  type FieldsAnswer,
  type Event,
  type Held,
  type Mesh,
  type Model,
  type SamplesAnswer,
  type Sensors,
  type SensorsAnswer,
  type Severity,
  type Status,
  type TestRecord,
} from "./types";

/** `/v1/description`. Names of parameters are needed; the rest may be absent. */
export function asModel(value: unknown): Model | undefined {
  if (!isObject(value)) return undefined;
  const list = (entry: unknown): Record<string, unknown>[] => (Array.isArray(entry) ? entry.filter(isObject) : []);
  const parameters = list(value.parameters).map((p) => {
    const prior = isObject(p.quantiles) ? p.quantiles : {};
    const known =
      isNumbers(prior.levels) && isNumbers(prior.values) ? { levels: prior.levels, values: prior.values } : {};
    return { ...(p as { name: string }), name: String(p.name), ...known };
  });
  const time = isObject(value.time) && typeof value.time.units === "string" ? { time_units: value.time.units } : {};
  const quantities = list(value.forecasts).map((f) => ({ ...f, name: String(f.name), ...time }));
  return { ...(value as Partial<Model>), parameters, quantities };
}

/** `/v1/mesh`: the first block of cells is drawn, and all of the same type. */
export function asMesh(value: unknown): { mesh?: Mesh; sensors?: Sensors } {
  if (!isObject(value) || !Array.isArray(value.points) || !Array.isArray(value.cells)) return {};
  const blocks = value.cells as { type: string; connectivity: number[][] }[];
  const type = blocks[0]?.type ?? "";
  const mesh: Mesh = {
    type,
    points: value.points as number[][],
    cells: blocks.filter((b) => b.type === type).flatMap((b) => b.connectivity),
  };
  if (!Array.isArray(value.sensors)) return { mesh };
  const sensors = value.sensors as { x: number; y: number; z: number; component: number; std?: number }[];
  return {
    mesh,
    sensors: {
      points: sensors.map((s) => [s.x, s.y, s.z]),
      components: sensors.map((s) => "xyz"[s.component] ?? "x"),
      std: sensors.map((s) => s.std ?? NaN),
    },
  };
}

export function asStatus(value: unknown): Status | undefined {
  if (!isObject(value)) return undefined;
  const state = stateWords.find((word) => word === value.state);
  if (!state) return undefined;
  const { structure: said, ...rest } = value;
  const structure = asVerdictLevel(said);
  return { ...(rest as unknown as Status), state, ...(structure ? { structure } : {}) };
}

/** `/v1/tests`. */
export function asTests(value: unknown): TestRecord[] {
  const list = isObject(value) && Array.isArray(value.tests) ? value.tests.filter(isObject) : [];
  return list.flatMap((test) =>
    typeof test.name === "string" ? [{ ...(test as unknown as TestRecord), current: test.current === true }] : [],
  );
}

export function asAlarm(value: unknown): Event | undefined {
  if (!isObject(value) || typeof value.message !== "string") return undefined;
  const severity: Severity = value.severity === "info" || value.severity === "alarm" ? value.severity : "warning";
  return {
    ...(isNumber(value.id) ? { id: value.id } : {}),
    step: isNumber(value.step) ? value.step : 0,
    severity,
    kind: String(value.kind ?? ""),
    message: value.message.replace(/^[a-z]/, (c) => c.toUpperCase()),
    ...(isNumber(value.raised_at) ? { raised_at: value.raised_at } : {}),
    ...(isObject(value.acknowledged) ? { acknowledged: asAcknowledgement(value.acknowledged) } : {}),
  };
}

function asAcknowledgement(value: Record<string, unknown>): Acknowledgement {
  return {
    by: String(value.by ?? ""),
    comment: String(value.comment ?? ""),
    ...(isNumber(value.at) ? { at: value.at } : {}),
  };
}

/** An entry of `/v1/logbook`. */
export function asEntry(value: unknown): Entry | undefined {
  if (!isObject(value) || !isNumber(value.number) || !isNumber(value.time)) return undefined;
  return {
    number: value.number,
    kind: String(value.kind),
    time: value.time,
    by: String(value.by ?? ""),
    text: String(value.text ?? ""),
    ...(isNumber(value.written_at) ? { written_at: value.written_at } : {}),
    ...(isNumber(value.sensor) ? { sensor: value.sensor } : {}),
  };
}

/** `/v1/quarantine`. */
export function asQuarantine(value: unknown): Held[] {
  const list = isObject(value) && Array.isArray(value.quarantined) ? value.quarantined.filter(isObject) : [];
  return list.map((held) => ({
    source: String(held.source),
    session: String(held.session),
    seq: Number(held.seq),
    step: Number(held.step),
    reason: String(held.reason ?? ""),
  }));
}

interface FieldAnswer {
  step: number;
  location: "nodes" | "sensors";
  values: unknown[];
  missing?: number[];
}

/** Answers of `/v1/field`: the displacement, and the field looked at if it is another. */
export function asFields(displacement: unknown, name: string, other: unknown): FieldsAnswer {
  const u = displacement as FieldAnswer;
  const fields: FieldsAnswer = { step: u.step, displacement: u.values as number[][], sensitivity: {} };
  if (!isObject(other)) return fields;
  const field = other as unknown as FieldAnswer;
  const [kind, parameter] = name.split(":");
  if (kind === "sensitivity" && parameter !== undefined) fields.sensitivity[parameter] = field.values as number[][];
  if (kind === "bias" && field.location === "nodes") fields.bias = field.values as number[][];
  return fields;
}

/** `/v1/observations`, the residual of `/v1/field`, and the bias if it is at the sensors. */
export function asSensors(observations: unknown, residual: unknown, bias: unknown): SensorsAnswer {
  const o = observations as { step: number; status: string[]; reason?: Record<string, string> };
  const answer: SensorsAnswer = { step: o.step, status: o.status, reason: o.reason ?? {} };
  if (isObject(residual)) answer.residual = present(residual as unknown as FieldAnswer);
  if (isObject(bias) && bias.location === "sensors") answer.bias = present(bias as unknown as FieldAnswer);
  return answer;
}

function present(field: FieldAnswer): (number | undefined)[] {
  const missing = new Set(field.missing);
  return (field.values as number[]).map((v, i) => (missing.has(i) ? undefined : v));
}

export function asSamples(value: unknown): SamplesAnswer {
  const answer = value as { step: number; samples: number[][] };
  return { step: answer.step, points: answer.samples };
}
