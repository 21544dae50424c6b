import assert from "node:assert/strict";
import { test } from "node:test";
import { csv, sensorsTable, stepsTable } from "../src/csv";
import { clock, duration, given, microseconds, probability, scaleFor, significant, withSpread } from "../src/format";
import { banner, bannerWords, derived, structure } from "../src/state";
import { eventsOf, grouped, merged, stateEvent } from "../src/events";
import { firstOpen, modelShift, stepAndClock, worthClass, worthDigits } from "../src/specs";
import type { Event, StepLine } from "../src/types";
import { unbroken } from "../src/unbroken";
import { stepLine, withProbability } from "./support";

test("numbers", () => {
  assert.deepEqual(
    [0, 1.2345, -0.0123456, 12345.6, 1e5, 2.5e-7].map((v) => significant(v)),
    ["0", "1.23", "−0.0123", "12346", "1.00·10⁵", "2.50·10⁻⁷"],
  );
  assert.equal(withSpread(1.0174321, 0.0131), "1.017");
  assert.equal(withSpread(-28.2934, 0.82), "−28.29");
  assert.equal(withSpread(1384.7, 12.2), "1385");
  assert.equal(given(0.3), "0.3");
  assert.equal(given(0.1 + 0.2), "0.3");
});

test("a probability is never said to be 0 or 1", () => {
  assert.deepEqual([0, 0.0005, 0.042, 0.5, 0.957, 0.9999, 1].map(probability), [
    "< 0.1 %",
    "< 0.1 %",
    "4.2 %",
    "50 %",
    "95.7 %",
    "> 99.9 %",
    "> 99.9 %",
  ]);
});

test("no line ends between a number and its unit, nor behind a sign", () => {
  const all = "P(> 40 mm) > 99.9 %, 0.4 σ away; 28.22 ± 0.28 mm at step 3 of 5 models, 1 m per m, 210 J/m³, 4 Moves";
  assert.equal(
    unbroken(all).replace(/\u00a0/g, "_"),
    "P(>_40_mm) >_99.9_%, 0.4_σ away; 28.22_±_0.28_mm at step 3 of 5 models, 1_m per m, 210_J/m³, 4 Moves",
  );
});

test("numbers have the digits that the whole uncertainty leaves, and of what is rejected two", () => {
  const judged = (level: "caution" | "reject") => {
    const line = stepLine(3);
    line.verdict = { level, reasons: [], model_shift_std: [0, 2.4] };
    return line;
  };
  const caution = judged("caution");
  assert.equal(worthDigits(caution, 1.00123, 0.0034, modelShift(caution, 0)), "1.0012");
  assert.equal(worthDigits(caution, 1.00123, 0.0048, modelShift(caution)), "1.001"); // of a forecast the worst
  assert.equal(worthDigits(judged("reject"), 836.913, 0.014, 0), "840");
  assert.deepEqual([stepLine(3), caution, judged("reject")].map(worthClass), ["", "demoted", "demoted rejected"]);
});

test("units take a prefix by size; what has none stays", () => {
  assert.deepEqual(scaleFor("m", 0.028), { factor: 1000, units: "mm" });
  assert.deepEqual(scaleFor("m", 1e-3), { factor: 1000, units: "mm" });
  assert.deepEqual(scaleFor("N", 1390), { factor: 1e-3, units: "kN" });
  assert.deepEqual(scaleFor("1", 5), { factor: 1, units: "" });
  assert.deepEqual(scaleFor("J/m³", 5e4), { factor: 1, units: "J/m³" });
  assert.deepEqual(scaleFor("m", 0), { factor: 1, units: "m" });
});

test("times", () => {
  assert.deepEqual([0.04, 12.4, 300, 7300, 260000].map(duration), ["0.0 s", "12 s", "5 min", "2 h", "3 days"]);
  assert.deepEqual([32.4, 1320, 2.5e6].map(microseconds), ["32 µs", "1.32 ms", "2.50 s"]);
});

test("the time of day stands beside the step, with the date where it is another day's", () => {
  const noon = new Date(2026, 10, 23, 12, 0, 5).getTime() / 1000;
  assert.equal(clock(noon, noon + 60), "12:00:05");
  assert.equal(clock(noon, noon + 86400), "2026-11-23 12:00:05");
  assert.equal(stepAndClock([stepLine(1)]), undefined);
  const above = stepAndClock([stepLine(1), { ...stepLine(2), received_at: noon }])!;
  assert.match(above(stepLine(2).time), /^2\n12:00:05$/);
  assert.equal(above(-1), "1");
});

const known = { now: 100000, connected: true, latest: stepLine(5), lastDatumAt: 99900 };

test("the banner says what the service says, and why", () => {
  assert.deepEqual(banner({ ...known, status: { state: "BIASED", reason: "χ² is 200", period_s: 0.1 } }), {
    state: "BIASED",
    reason: "χ² is 200.",
    age: 0.1,
  });
  assert.equal(banner({ ...known, status: { state: "OK", period_s: 0.1 } }).state, "OK");
});

test("silence is never OK: no datum for five periods, or no contact", () => {
  const late = banner({ ...known, lastDatumAt: 97000, status: { state: "OK", period_s: 0.1 } });
  assert.equal(late.state, "STALE");
  assert.match(late.reason, /No datum for 3\.0 s \(one is expected every 0\.1 s\)/);
  const fast = banner({ ...known, lastDatumAt: 97000, status: { state: "STALE", period_s: 0.004 } });
  assert.match(fast.reason, /\(one is expected every 4\.00 ms\)/);
  const lost = banner({ ...known, connected: false, lostAt: 90000, status: { state: "OK" } });
  assert.equal(lost.state, "STALE");
  assert.match(lost.reason, /No contact with the service for 10 s; shown is what was known then/);
  assert.equal(banner({ now: 0, connected: false }).reason, "Connecting to the service.");
  assert.equal(
    banner({ ...known, connected: false, lostAt: 99500, status: { state: "OK" } }).state,
    "OK",
    "a hiccup is none",
  );
  assert.equal(
    banner({ ...known, lastDatumAt: 0, status: { state: "DIVERGED", period_s: 0.1 } }).state,
    "DIVERGED",
    "the worse word stays",
  );
});

test("silence says which it is: waiting for the first datum, no data, no contact", () => {
  const shown = (more: object) => bannerWords(banner({ ...known, ...more }));
  const silent = { state: "STALE" as const, data_flow: "silent" as const, reason: "no measurement for more than 5 s" };
  const waiting = { state: "STALE" as const, data_flow: "waiting" as const, reason: "no measurement yet" };
  const first = { latest: undefined, lastDatumAt: undefined };
  assert.deepEqual(shown({ ...first, status: waiting }), ["WAITING"]);
  assert.equal(banner({ ...known, ...first, status: waiting }).reason, "No measurement yet.");
  assert.deepEqual(shown({ status: silent }), ["NO DATA"]);
  assert.deepEqual(shown({ lastDatumAt: undefined, status: silent }), ["NO DATA"], "since the service was started");
  assert.deepEqual(shown({ connected: false, lostAt: 90000, status: { state: "OK" } }), ["NO CONTACT"]);
  assert.deepEqual(shown({ ...first, connected: false }), ["NO CONTACT"]);
  assert.deepEqual(shown({ status: { state: "FINISHED", data_flow: "finished" }, lastDatumAt: 0 }), ["FINISHED"]);
});

test("silence never covers what is worse: neither BIASED nor a result that must not be used", () => {
  const biased = { state: "BIASED" as const, reason: "χ² is 200", period_s: 0.1 };
  const late = banner({ ...known, lastDatumAt: 97000, status: biased });
  assert.deepEqual(bannerWords(late), ["BIASED", "NO DATA"]);
  assert.equal(late.reason, "χ² is 200. No datum for 3.0 s (one is expected every 0.1 s).");
  const after = { ...biased, data_flow: "silent" as const };
  const restarted = banner({ ...known, lastDatumAt: undefined, status: after });
  assert.equal(restarted.reason, "χ² is 200. No datum since the service was started.");
  for (const state of ["BIASED", "DIVERGED", "DEGRADED", "FINISHED"] as const)
    assert.deepEqual(bannerWords(banner({ ...known, connected: false, lostAt: 90000, status: { state } })), [
      state,
      "NO CONTACT",
    ]);
  const rejected = stepLine(1, { verdict: { level: "reject", reasons: [reject] } });
  assert.equal(structure({ state: "STALE", data_flow: "silent" }, rejected)?.level, "reject");
});

test("without a status the line itself tells", () => {
  assert.equal(derived(undefined).state, "STALE");
  assert.equal(derived(stepLine(1)).state, "OK");
  assert.equal(derived(stepLine(1, { bias_correction: "on" })).state, "BIASED");
  const untrusted = derived(stepLine(4, { trusted: false, ess: 0.7, variance_diagnostic: 0.2 }));
  assert.equal(
    untrusted.reason,
    "step 4 is not trusted: variance diagnostic 0.20 is above 0.05, effective sample size 70 % is below 90 %",
  );
  assert.equal(derived(stepLine(4, { trusted: false, remark: "second mode" })).reason, "second mode");
});

const caution = { level: "caution" as const, message: "the posterior is at the edge" };
const reject = { level: "reject" as const, message: "the data do not fit" };

test("the structure's state is the verdict's, with the first reason of its level", () => {
  assert.equal(structure({ state: "OK" }, stepLine(1)), undefined);
  assert.equal(structure({ state: "OK", structure: "caution" }, undefined)?.reason, "Usable, with the caveats given.");
  const line = stepLine(1, { verdict: { level: "reject", reasons: [caution, reject] } });
  assert.deepEqual(structure({ state: "STALE" }, line), { level: "reject", reason: "The data do not fit." });
});

test("a verdict that changes its level is told", () => {
  const lines = [
    stepLine(0, { verdict: { level: "ok", reasons: [] } }),
    stepLine(1, { verdict: { level: "caution", reasons: [caution] } }),
    stepLine(2, { verdict: { level: "caution", reasons: [caution] } }),
    stepLine(3, { verdict: { level: "reject", reasons: [caution, reject] } }),
    stepLine(4, { verdict: { level: "ok", reasons: [] } }),
  ];
  assert.deepEqual(
    eventsOf(lines, { quantities: [] }).map((e) => `${e.step} ${e.severity} ${e.kind}`),
    ["4 info verdict", "3 alarm verdict", "1 warning verdict"],
  );
});

const quantities = [{ name: "crack", threshold: 0.028, units: "m" }];

test("a probability that rises is an alarm once, not at each step that it hovers", () => {
  const course = [0.1, 0.6, 0.52, 0.55, 0.49, 0.51, 0.9, 0.2, 0.75];
  const found = eventsOf(
    course.map((p, k) => withProbability(k, p)),
    { quantities },
  ).reverse();
  assert.deepEqual(
    found.map((e) => [e.step, e.severity, e.message]),
    [
      [1, "alarm", "P(crack > 28 mm) rose above 50 %: now 60 %"],
      [7, "info", "P(crack > 28 mm) fell below 50 %: now 20 %"],
      [8, "alarm", "P(crack > 28 mm) rose above 50 %: now 75 %"],
    ],
  );
});

test("what happened is told with its cause, newest first", () => {
  const lines = [
    stepLine(0),
    stepLine(1, { trusted: false, ess: 0.5 }),
    stepLine(2, { used: 0, missing: 10 }),
    stepLine(3, { used: 8, rejected: 2 }),
    stepLine(6, { bias_correction: "on", elapsed_us: { total: 9000 } }),
  ];
  const found = eventsOf(lines, { quantities: [], budget_us: 5000 });
  assert.deepEqual(
    found.map((e) => `${e.step} ${e.kind}`),
    ["6 deadline", "6 bias", "6 gap", "3 sensors", "3 gap", "2 gap", "2 trust", "1 trust"],
  );
  assert.match(found[0]!.message, /Update took 9\.00 ms, the budget is 5\.00 ms/);
  assert.match(found[2]!.message, /Steps 4 to 5 have no datum/);
  assert.match(found[3]!.message, /2 of 10 values rejected/);
});

test("what the service and the lines both tell is listed once", () => {
  const told = [{ step: 4, severity: "alarm" as const, kind: "threshold", message: "told" }];
  const found = [
    { step: 5, severity: "info" as const, kind: "gap", message: "found" },
    { ...told[0]!, message: "found too" },
  ];
  assert.deepEqual(
    merged(told, found).map((e) => e.message),
    ["found", "told"],
  );
});

test("a change of the service's state is told once, with its cause", () => {
  assert.equal(stateEvent(undefined, { state: "OK" }), undefined);
  assert.equal(stateEvent({ state: "OK" }, { state: "OK", reason: "x" }), undefined);
  assert.deepEqual(stateEvent({ state: "OK" }, { state: "BIASED", reason: "χ² 200", step: 4 }), {
    step: 4,
    severity: "alarm",
    kind: "bias",
    message: "The service became BIASED: χ² 200",
  });
  const waiting = { state: "STALE" as const, data_flow: "waiting" as const, reason: "no measurement yet" };
  assert.deepEqual(stateEvent(undefined, waiting), {
    step: 0,
    severity: "info",
    kind: "gap",
    message: "The service waits for the first datum: no measurement yet",
  });
  const silent = stateEvent({ state: "OK" }, { ...waiting, data_flow: "silent", reason: "none for 5 s", step: 3 });
  assert.deepEqual([silent?.severity, silent?.message], ["warning", "Data have stopped: none for 5 s"]);
});

test("tables: full precision, empty where there is nothing, quoted where needed", () => {
  assert.equal(
    csv(
      ["a", "b"],
      [
        [0.1 + 0.2, null],
        ["x,y", NaN],
      ],
    ),
    'a,b\r\n0.30000000000000004,\r\n"x,y",\r\n',
  );
  const [header, row] = stepsTable([stepLine(0)], ["Y0", "Ad"])
    .trim()
    .split("\r\n")
    .map((r) => r.split(","));
  const at = (name: string): string => row![header!.indexOf(name)]!;
  assert.equal(at("Y0_mean"), "1");
  assert.equal(at("Y0_std"), String(Math.sqrt(0.04)));
  assert.equal(at("Ad_q0.975"), "2.2");
  assert.equal(at("crack_probability_above_threshold"), "0.3");
  assert.equal(at("elapsed_us_total"), "1260");
  const sensors = sensorsTable(
    { step: 0, status: ["missing", "used"], reason: {}, residual: [undefined, -1] },
    {
      points: [
        [0, 0, 0],
        [1, 0, 0],
      ],
      components: ["x", "y"],
      std: [0.5, 0.5],
    },
  )
    .trim()
    .split("\r\n");
  assert.deepEqual(sensors.slice(1), ["0,0,0,0,x,0.5,missing,,,", "1,1,0,0,y,0.5,used,-1,-2,"]);
});

test("alarms of one kind and source are one group, and those that wait for an answer are known", () => {
  const alarm = (step: number, kind: string, message: string, more: Partial<Event> = {}): Event => ({
    id: step,
    step,
    severity: "warning",
    kind,
    message,
    ...more,
  });
  const groups = grouped([
    alarm(9, "threshold", "P(crack > 40 mm) is 60 %"),
    alarm(8, "sensors", "3 of 60 values rejected: they do not fit the others", {
      acknowledged: { by: "Ada", comment: "" },
    }),
    alarm(7, "threshold", "P(force > 1.2 kN) is 7 %"),
    alarm(6, "threshold", "P(crack > 40 mm) rose above 5 %: now 7 %"),
    alarm(5, "sensors", "12 of 60 values rejected: they do not fit the others"),
    alarm(4, "sensors", "Sensors are back", { severity: "info" }),
  ]);
  assert.deepEqual(
    groups.map(({ latest, all, open }) => [latest.step, all.map((e) => e.step), open.map((e) => e.step)]),
    [
      [9, [9, 6], [9, 6]],
      [8, [8, 5], [5]],
      [7, [7], [7]],
      [4, [4], []],
    ],
  );
});

test("a forecast whose horizon has passed does not lead", () => {
  const forecast = (past: boolean) => ({ past }) as StepLine["forecast"][string];
  const at = (a: boolean, b: boolean) => ({ forecast: { a: forecast(a), b: forecast(b) } }) as unknown as StepLine;
  const all = [{ name: "a" }, { name: "b" }];
  assert.equal(firstOpen(all, at(true, false)), 1);
  assert.equal(firstOpen(all, at(false, false)), 0);
  assert.equal(firstOpen(all, at(true, true)), 0);
  assert.equal(firstOpen(all, undefined), 0);
});
