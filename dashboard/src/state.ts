/** The state in words. Pure: time is given. */
import { duration, microseconds } from "./format";
import type { Model, QuietWord, StateWord, Status, StepLine, Verdict, VerdictLevel } from "./types";

export interface Knowledge {
  /** Now, and when things were seen, in ms of one clock. */
  now: number;
  connected: boolean;
  lostAt?: number | undefined;
  lastDatumAt?: number | undefined;
  status?: Status | undefined;
  latest?: StepLine | undefined;
  model?: Model | undefined;
}

export interface Banner {
  /** STALE only where nothing worse is known: `quiet` then says which of the three it is. */
  state: StateWord;
  /** Why nothing new is seen, beside the state: it never replaces a worse one. */
  quiet?: QuietWord;
  reason: string;
  /** Age of the last datum in s; NaN before the first. */
  age: number;
}

/** Shorter interruptions are a hiccup of the network: nobody needs to look up. */
const contactGrace = 2000;
/** As the service itself: `[serve] stale_after`. */
const stalePeriods = 5;

export function banner(k: Knowledge): Banner {
  const age = k.lastDatumAt === undefined ? NaN : Math.max(0, (k.now - k.lastDatumAt) / 1000);
  const said = k.status ?? derived(k.latest);
  const reason = said.reason ? sentence(said.reason) : usual[said.state];
  const silence = noContact(k) ?? noData(k, said, age);
  if (!silence) return { state: said.state, reason, age };
  const { quiet } = silence;
  if (said.state === "OK" || said.state === "STALE") return { state: "STALE", quiet, reason: silence.reason, age };
  return { state: said.state, quiet, reason: `${reason} ${silence.reason}`, age };
}

/** The words at the top of the page, the worst first. */
export function bannerWords({ state, quiet }: Banner): (StateWord | QuietWord)[] {
  return quiet === undefined ? [state] : state === "STALE" ? [quiet] : [state, quiet];
}

interface Silence {
  quiet: QuietWord;
  reason: string;
}

function noContact(k: Knowledge): Silence | undefined {
  if (k.connected || (k.lostAt !== undefined && k.now - k.lostAt <= contactGrace)) return undefined;
  if (k.lostAt === undefined) return { quiet: "NO CONTACT", reason: "Connecting to the service." };
  const since = duration((k.now - k.lostAt) / 1000);
  const shown = k.latest ? "; shown is what was known then" : "";
  return { quiet: "NO CONTACT", reason: `No contact with the service for ${since}${shown}. Trying again.` };
}

function noData(k: Knowledge, said: Status, age: number): Silence | undefined {
  const period = k.status?.period_s ?? k.model?.period_s ?? NaN;
  const late = age > (k.model?.stale_after_s ?? Math.max(stalePeriods * period, 1));
  if (said.state === "FINISHED" || !(late || said.state === "STALE" || said.data_flow === "silent")) return undefined;
  if (Number.isFinite(age)) {
    const expected =
      period > 0 ? ` (one is expected every ${period < 0.1 ? microseconds(1e6 * period) : duration(period)})` : "";
    const last = k.model?.steps;
    const done =
      last !== undefined && k.latest && k.latest.step >= last - 1 ? "; it was the last step of the model" : "";
    return { quiet: "NO DATA", reason: `No datum for ${duration(age)}${expected}${done}.` };
  }
  const why = said.state === "STALE" && said.reason;
  if (k.latest) return { quiet: "NO DATA", reason: why ? sentence(why) : "No datum since the service was started." };
  return { quiet: "WAITING", reason: why ? sentence(why) : "No datum yet." };
}

export interface Structure {
  level: VerdictLevel;
  reason: string;
}

/** What the verdict on the latest step says of the result; nothing where there is no verdict. */
export function structure(status: Status | undefined, latest: StepLine | undefined): Structure | undefined {
  const level = latest?.verdict?.level ?? status?.structure;
  return level && { level, reason: sentence(firstReason(latest?.verdict) ?? usualLevel[level]) };
}

/** The first reason of the verdict's own level. */
export function firstReason(verdict: Verdict | undefined): string | undefined {
  return verdict?.reasons.find((reason) => reason.level === verdict.level)?.message;
}

/** What the levels mean; the help says it too. */
export const usualLevel: Record<VerdictLevel, string> = {
  ok: "No problem found: the data fit the model and its noise.",
  caution: "Usable, with the caveats given.",
  reject: "Do not use the result.",
};

/** The verdict as the page shows it. */
export const levelWords: Record<VerdictLevel, string> = {
  ok: "Result: usable",
  caution: "Result: usable with caveats",
  reject: "Result: do not use",
};

function sentence(text: string): string {
  const start = text.replace(/^[a-z]/, (c) => c.toUpperCase());
  return /[.!?]$/.test(start) ? start : `${start}.`;
}

/** What the states mean; the help says it too. */
export const usual: Record<StateWord, string> = {
  OK: "Data arrive in time, and the last update passed its checks.",
  DEGRADED: "Updates are late or could not be verified: shown is the last state that passed its checks.",
  STALE: "Data have stopped.",
  BIASED: "The last data do not fit the model, whatever its parameters: treat its numbers with caution.",
  DIVERGED: "The last update failed: shown is the last state that was verified.",
  FINISHED: "The test is finished: no more data are taken.",
};

/** What the three kinds of silence mean; the help says it too. */
export const usualQuiet: Record<QuietWord, string> = {
  WAITING: "No datum of this test has arrived yet.",
  "NO DATA": "Data have stopped. What is shown is of the last datum.",
  "NO CONTACT": "This page does not reach the service. What is shown is what was known then.",
};

/** Without `/v1/status`, what the line itself tells. */
export function derived(line: StepLine | undefined): Status {
  if (!line) return { state: "STALE", reason: "no datum yet" };
  if (!line.trusted) return { state: "DEGRADED", reason: whyNotTrusted(line) };
  if (line.bias_correction !== "off") return { state: "BIASED", reason: "the correction of the model's bias is on" };
  return { state: "OK" };
}

/** The limits are those of docs/reference/formats.md. */
export function whyNotTrusted(line: StepLine): string {
  if (line.remark) return line.remark;
  const reasons: string[] = [];
  if (line.variance_diagnostic > 0.05)
    reasons.push(`variance diagnostic ${line.variance_diagnostic.toPrecision(2)} is above 0.05`);
  if (line.ess < 0.9) reasons.push(`effective sample size ${(100 * line.ess).toFixed(0)} % is below 90 %`);
  return `step ${line.step} is not trusted: ${reasons.join(", ") || "a second mode may be there"}`;
}
