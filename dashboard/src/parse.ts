/** Texts of the service to values. Pure. */
import {
  actions,
  verdictLevels,
  type Decision,
  type Forecast,
  type StepLine,
  type Verdict,
  type VerdictLevel,
} from "./types";

export function isObject(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

export function isNumber(value: unknown): value is number {
  return typeof value === "number" && Number.isFinite(value);
}

export function isNumbers(value: unknown): value is number[] {
  return Array.isArray(value) && value.every(isNumber);
}

function number(value: unknown, otherwise: number): number {
  return isNumber(value) ? value : otherwise;
}

/** A line of section 4, or nothing if it is not one. Densities are left out: the page does not show them, and days of steps must fit. */
export function asStepLine(value: unknown): StepLine | undefined {
  if (!isObject(value) || !Number.isInteger(value.step) || typeof value.time !== "number" || !isNumbers(value.mean))
    return undefined;
  const quantiles = value.quantiles;
  if (!isObject(quantiles) || !isNumbers(quantiles.levels) || !Array.isArray(quantiles.values)) return undefined;
  const forecast: Record<string, Forecast> = {};
  for (const [name, entry] of Object.entries(isObject(value.forecast) ? value.forecast : {})) {
    if (!isObject(entry) || !isNumbers(entry.levels) || !isNumbers(entry.values)) continue;
    const { density: _density, published: _published, ...rest } = entry;
    forecast[name] = rest as unknown as Forecast;
  }
  const elapsed: Record<string, number> = {};
  for (const [name, entry] of Object.entries(isObject(value.elapsed_us) ? value.elapsed_us : {}))
    if (typeof entry === "number" && Number.isFinite(entry)) elapsed[name] = entry;
  const { marginals: _marginals, verdict: said, decision: decided, ...rest } = value;
  const verdict = asVerdict(said);
  const decision = asDecision(decided);
  return {
    ...(rest as unknown as StepLine),
    covariance: Array.isArray(value.covariance) ? (value.covariance as number[][]) : [],
    maximum_a_posteriori: isNumbers(value.maximum_a_posteriori) ? value.maximum_a_posteriori : value.mean,
    used: number(value.used, 0),
    rejected: number(value.rejected, 0),
    missing: number(value.missing, 0),
    trusted: value.trusted !== false,
    bias_correction: String(value.bias_correction ?? "off"),
    log_evidence_increment: number(value.log_evidence_increment, NaN),
    elapsed_us: elapsed,
    forecast,
    ...(verdict ? { verdict } : {}),
    ...(decision ? { decision } : {}),
  };
}

function asDecision(value: unknown): Decision | undefined {
  if (!isObject(value) || !isNumber(value.time) || typeof value.message !== "string") return undefined;
  const action = actions.find((one) => one === value.action);
  if (!action) return undefined;
  const load = isNumber(value.load) && typeof value.units === "string" ? { load: value.load, units: value.units } : {};
  return { action, time: value.time, message: value.message, ...load };
}

export function asVerdictLevel(value: unknown): VerdictLevel | undefined {
  return verdictLevels.find((level) => level === value);
}

/** Its words, and how sure the model lets the numbers be. */
function asVerdict(value: unknown): Verdict | undefined {
  const level = isObject(value) ? asVerdictLevel(value.level) : undefined;
  if (!isObject(value) || !level) return undefined;
  const reasons: Verdict["reasons"] = [];
  for (const reason of Array.isArray(value.reasons) ? value.reasons.filter(isObject) : []) {
    const of = asVerdictLevel(reason.level);
    if (of && typeof reason.message === "string") reasons.push({ level: of, message: reason.message });
  }
  return { level, reasons, ...(isNumbers(value.model_shift_std) ? { model_shift_std: value.model_shift_std } : {}) };
}

/** `/v1/states`: one JSON line per step, or one array, or an object that holds it; what is not a step is passed over. */
export function parseStates(text: string): StepLine[] {
  const trimmed = text.trim();
  if (!trimmed) return [];
  let entries: unknown[];
  const whole = tryJson(trimmed);
  if (Array.isArray(whole)) entries = whole;
  else if (isObject(whole) && Array.isArray(whole.states)) entries = whole.states;
  else if (whole !== undefined) entries = [whole];
  else entries = trimmed.split("\n").map(tryJson);
  return entries.map(asStepLine).filter((line): line is StepLine => line !== undefined);
}

export function tryJson(text: string): unknown {
  try {
    return JSON.parse(text) as unknown;
  } catch {
    return undefined;
  }
}

export interface ServerEvent {
  event: string;
  data: string;
  id?: string;
}

/**
 * Server-sent events from pieces of text, cut anywhere (WHATWG HTML, section 9.2.6). A block without data is no event, but its id counts;
 * `retry:` is passed over: the page has its own pace.
 */
export class EventParser {
  private rest = "";
  private data: string[] = [];
  private event = "";
  private id: string | undefined;
  /** Comments seen, which show that the service is there. */
  comments = 0;

  push(piece: string): ServerEvent[] {
    const found: ServerEvent[] = [];
    const text = this.rest + piece;
    // A carriage return at the end may be the first half of a line's end.
    const lines = text.split(/\r\n|\n|\r(?!$)/);
    this.rest = lines.pop() ?? "";
    for (const line of lines) {
      const event = this.line(line);
      if (event) found.push(event);
    }
    return found;
  }

  private line(line: string): ServerEvent | undefined {
    if (line === "") {
      const data = this.data;
      const event: ServerEvent = { event: this.event || "message", data: data.join("\n") };
      if (this.id !== undefined) event.id = this.id;
      this.data = [];
      this.event = "";
      return data.length > 0 ? event : undefined;
    }
    const colon = line.indexOf(":");
    if (colon === 0) {
      this.comments += 1;
      return undefined;
    }
    const name = colon < 0 ? line : line.slice(0, colon);
    const value = colon < 0 ? "" : line.slice(colon + 1).replace(/^ /, "");
    if (name === "data") this.data.push(value);
    else if (name === "event") this.event = value;
    else if (name === "id" && !value.includes("\0")) this.id = value;
    return undefined;
  }
}
