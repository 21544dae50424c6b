/** What happened, with its cause, from the lines alone: so the list is complete for whoever opens the page late. Pure. */
import { given, microseconds, probability, scaleFor, significant, words } from "./format";
import { medianPeriod } from "./history";
import { firstReason, usualLevel, whyNotTrusted } from "./state";
import type { Event, QuantityDescription, Severity, StateWord, Status, StepLine } from "./types";

/** A forecast is worth a line when its probability passes one of these, upward or downward. */
export const probabilityLevels = [0.05, 0.5, 0.95];

export interface EventContext {
  quantities: readonly QuantityDescription[];
  budget_us?: number | undefined;
}

/** What the service told and what the lines tell, newest first; what both tell about a step, once. */
export function merged(told: readonly Event[], found: readonly Event[]): Event[] {
  const known = new Set(told.map((e) => `${e.step} ${e.kind}`));
  return [...told, ...found.filter((e) => !known.has(`${e.step} ${e.kind}`))].sort((a, b) => b.step - a.step);
}

/** The service raises alarms of these kinds itself: what both say is listed once. */
const stateKind: Record<StateWord, string> = {
  OK: "state",
  STALE: "gap",
  DEGRADED: "deadline",
  BIASED: "bias",
  DIVERGED: "trust",
  FINISHED: "state",
};
const stateSeverity: Record<StateWord, Severity> = {
  OK: "info",
  STALE: "warning",
  DEGRADED: "warning",
  BIASED: "alarm",
  DIVERGED: "alarm",
  FINISHED: "info",
};

/** A change of the service's state, which the lines do not tell: known only to a page that was there. */
export function stateEvent(before: Status | undefined, now: Status): Event | undefined {
  if (before ? before.state === now.state : now.state === "OK") return undefined;
  const why = now.reason ? `: ${now.reason}` : "";
  if (now.state === "STALE") return silenceEvent(now, why);
  return {
    step: now.step ?? 0,
    severity: stateSeverity[now.state],
    kind: stateKind[now.state],
    message: `The service ${before ? "became" : "is"} ${now.state}${why}`,
  };
}

/** Waiting for the first datum is no trouble; data that have stopped are. */
function silenceEvent(now: Status, why: string): Event {
  const waits = now.data_flow === "waiting" || (now.data_flow === undefined && now.step === undefined);
  return {
    step: now.step ?? 0,
    severity: waits ? "info" : "warning",
    kind: stateKind.STALE,
    message: `${waits ? "The service waits for the first datum" : "Data have stopped"}${why}`,
  };
}

/** Newest first. */
export function eventsOf(lines: readonly StepLine[], context: EventContext): Event[] {
  const events: Event[] = [];
  const limit = 1.5 * medianPeriod(lines);
  lines.forEach((line, i) => {
    const add = (severity: Severity, kind: string, message: string): void =>
      void events.push({ step: line.step, severity, kind, message });
    const before = lines[i - 1];
    trust(line, before, add);
    verdict(line, before, add);
    data(line, before, limit, add);
    bias(line, before, add);
    deadline(line, before, context.budget_us, add);
  });
  for (const quantity of context.quantities) thresholds(lines, quantity, events);
  events.sort((a, b) => a.step - b.step);
  return events.reverse();
}

type Add = (severity: Severity, kind: string, message: string) => void;

function trust(line: StepLine, before: StepLine | undefined, add: Add): void {
  if (!line.trusted && before?.trusted !== false)
    add("warning", "trust", `Posterior not trusted: ${whyNotTrusted(line)}`);
  if (line.trusted && before?.trusted === false)
    add("info", "trust", `Posterior trusted again since step ${line.step}`);
}

function verdict(line: StepLine, before: StepLine | undefined, add: Add): void {
  const level = line.verdict?.level ?? "ok";
  if (level === (before?.verdict?.level ?? "ok")) return;
  const severity = level === "reject" ? "alarm" : level === "caution" ? "warning" : "info";
  const reason = firstReason(line.verdict) ?? usualLevel[level];
  add(
    severity,
    "verdict",
    reason.replace(/^[a-z]/, (c) => c.toUpperCase()),
  );
}

function data(line: StepLine, before: StepLine | undefined, limit: number, add: Add): void {
  if (before && (line.step > before.step + 1 || line.time - before.time > limit)) {
    const lost = line.step - before.step - 1;
    const what =
      lost === 1
        ? `Step ${before.step + 1} has no datum`
        : `Steps ${before.step + 1} to ${line.step - 1} have no datum`;
    add(
      "warning",
      "gap",
      lost > 0 ? what : `No step between times ${significant(before.time)} and ${significant(line.time)}`,
    );
  }
  if (line.used === 0 && (!before || before.used > 0))
    add("warning", "gap", "No usable value from any sensor: the posterior is unchanged");
  if (line.used > 0 && before?.used === 0) add("info", "gap", "Sensors are back");
  if (line.rejected > (before?.rejected ?? 0))
    add("warning", "sensors", `${line.rejected} of ${total(line)} values rejected: they do not fit the others`);
  if (line.used > 0 && line.missing > 0.1 * total(line) && (!before || before.missing <= 0.1 * total(before)))
    add("warning", "sensors", `${line.missing} of ${total(line)} sensors are missing`);
}

export function total(line: StepLine): number {
  return line.used + line.rejected + line.missing;
}

function bias(line: StepLine, before: StepLine | undefined, add: Add): void {
  const on = line.bias_correction !== "off";
  const was = before !== undefined && before.bias_correction !== "off";
  if (on && !was)
    add(
      "warning",
      "bias",
      "Correction of the model's bias switched on: the evidence says that the model does not explain the data",
    );
  if (!on && was) add("info", "bias", "Correction of the model's bias switched off");
}

function deadline(line: StepLine, before: StepLine | undefined, budget: number | undefined, add: Add): void {
  const late = (l: StepLine | undefined): boolean =>
    budget !== undefined && l !== undefined && (l.elapsed_us.total ?? 0) > budget;
  if (late(line) && !late(before))
    add(
      "warning",
      "deadline",
      `Update took ${microseconds(line.elapsed_us.total ?? NaN)}, the budget is ${microseconds(budget ?? NaN)}`,
    );
}

/** A level that was passed counts as left only this part of the way to the nearer end below it: a probability that hovers there is no alarm each step. */
const hysteresis = 0.4;

function thresholds(lines: readonly StepLine[], q: QuantityDescription, events: Event[]): void {
  if (q.threshold === undefined) return;
  const above = new Map<number, boolean>();
  for (const line of lines) {
    const p = line.forecast[q.name]?.probability_above_threshold;
    if (p === undefined) continue;
    const rose: number[] = [];
    const fell: number[] = [];
    for (const level of probabilityLevels) {
      const was = above.get(level);
      const slack = hysteresis * Math.min(level, 1 - level);
      const is = p > (was ? level - slack : level);
      if (was !== undefined && is && !was) rose.push(level);
      if (was !== undefined && !is && was) fell.push(level);
      above.set(level, is);
    }
    const scale = scaleFor(q.units ?? line.forecast[q.name]?.units, Math.abs(q.threshold));
    const name = `P(${words(q.name)} > ${[given(q.threshold * scale.factor), scale.units].filter(Boolean).join(" ")})`;
    const add = (severity: Severity, message: string): void =>
      void events.push({ step: line.step, severity, kind: "threshold", message: `${name} ${message}` });
    const highest = rose.pop();
    if (highest !== undefined)
      add(highest >= 0.5 ? "alarm" : "warning", `rose above ${100 * highest} %: now ${probability(p)}`);
    if (fell[0] !== undefined) add("info", `fell below ${100 * fell[0]} %: now ${probability(p)}`);
  }
}

/** Alarms of one kind and one source: the newest, all of them (newest first), and those that wait for an answer. */
export interface EventGroup {
  latest: Event;
  all: Event[];
  open: Event[];
}

/** What an alarm is about: its words without numbers; of a threshold, the quantity. */
function sourceOf({ kind, message }: Event): string {
  const about = kind === "threshold" ? message.slice(0, message.indexOf(")") + 1) : message;
  return about.replace(/[−-]?\d+([.,]\d+)*(·10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?/g, "#").replace(/# [kMGmµn](?=\w)/g, "# ");
}

/** An alarm or warning of the service that nobody has acknowledged. */
export function isOpen(event: Event): boolean {
  return event.id !== undefined && event.severity !== "info" && !event.acknowledged;
}

/** By kind and source, the groups in the order of their newest. */
export function grouped(events: readonly Event[]): EventGroup[] {
  const groups = new Map<string, EventGroup>();
  for (const event of events) {
    const key = `${event.kind} ${sourceOf(event)}`;
    const group = groups.get(key) ?? { latest: event, all: [], open: [] };
    groups.set(key, group);
    group.all.push(event);
    if (isOpen(event)) group.open.push(event);
  }
  return [...groups.values()];
}
