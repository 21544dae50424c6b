/** What was decided after each step, of a project that asks. Pure. */
import type { ChartSpec, Series } from "../chart";
import type { Theme } from "../colour";
import { imposed, imposedScale, probability } from "../format";
import { timeLabel } from "../specs";
import { imposedAt, type Assimilation, type ReportDecision } from "./record";

type Decided = { time: number; decision: ReportDecision | undefined };

const decided = (record: Assimilation): Decided[] => record.lines.map(({ time, decision }) => ({ time, decision }));

/** Loads in the unit of what is imposed where all of them are known, else model times. */
export function decisionsSpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  const all = decided(record);
  const times = all.flatMap(({ time, decision: d }) => (d ? [time, d.time, d.furthest] : []));
  if (times.length === 0) return undefined;
  const loads = times.map((t) => imposedAt(record, t));
  const inLoads = loads.every((l) => l !== undefined);
  const units = inLoads ? loads[0]!.units : "";
  const scale = imposedScale(units, Math.max(...loads.map((l) => l?.value ?? 0)));
  const place = (t: number): number => (inLoads ? imposedAt(record, t)!.value * scale.factor : t);
  const format = inLoads ? (v: number): string => imposed(v / scale.factor, units) : undefined;
  const series = (label: string, of: (d: Decided) => number | null, look: Partial<Series>): Series => ({
    label,
    values: all.map((d) => (d.decision ? of(d) : null)),
    colour: theme.blue,
    ...(format ? { format } : {}),
    ...look,
  });
  const action = (name: ReportDecision["action"], label: string, colour: string): Series =>
    series(label, ({ decision: d }) => (d!.action === name ? place(d!.time) : null), { dots: true, colour });
  return {
    name: "decisions",
    times: all.map((d) => d.time),
    series: [
      series("furthest that the risk allows", ({ decision: d }) => place(d!.furthest), {
        colour: theme.red,
        dash: [6, 4],
        width: 1.6,
      }),
      series("where the specimen is", ({ time }) => place(time), { colour: theme.prior, width: 1.4 }),
      action("load", "load to", theme.blue),
      action("hold", "hold, measure again", theme.orange),
      action("stop", "stop", theme.text),
    ].filter((s) => s.values.some((v) => v !== null)),
    xLabel: timeLabel,
    yLabel: inLoads ? `imposed [${scale.units}]` : timeLabel,
    height: 250,
  };
}

export function riskSpec(record: Assimilation, theme: Theme): ChartSpec | undefined {
  const all = decided(record);
  if (!all.some((d) => d.decision)) return undefined;
  const series = (label: string, of: (d: ReportDecision) => number | undefined, look: Partial<Series>): Series => ({
    label,
    values: all.map(({ decision: d }) => (d && of(d)) ?? null),
    colour: theme.blue,
    format: probability,
    ...look,
  });
  return {
    name: "risk",
    times: all.map((d) => d.time),
    series: [
      series("allowed", (d) => d.allowed_probability, { colour: theme.red, dash: [6, 4], width: 1.6 }),
      series("probability of failure", (d) => d.failure_probability, { points: true }),
    ],
    xLabel: timeLabel,
    yLabel: "probability [%]",
    factor: 100,
    height: 250,
  };
}
