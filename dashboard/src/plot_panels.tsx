/** Panels whose content are plots over time. */
import type { ComponentChildren } from "preact";
import { useMemo, useRef } from "preact/hooks";
import { Chart, type ChartHandle, type ChartSpec, type Note } from "./chart";
import type { Theme } from "./colour";
import { csv } from "./csv";
import { microseconds, probability, significant, timeWords } from "./format";
import { quantile, timeline } from "./history";
import { Panel } from "./panel";
import {
  dataSpec,
  evidenceSpec,
  forecastSpec,
  inTimeUnits,
  parameterNames,
  parameterSpec,
  probabilitySpec,
  quantitiesIn,
  quantityWords,
  stepAndClock,
  timingSpec,
} from "./specs";
import { stackPng } from "./png";
import { levelWords } from "./state";
import type { Model, Status, StepLine } from "./types";

export interface PlotProps {
  lines: readonly StepLine[];
  version: number;
  model: Model | undefined;
  status: Status | undefined;
  line: StepLine | undefined;
  /** Time of the step looked at, where it is not the latest. */
  selected: number | undefined;
  theme: Theme;
  /** What people wrote. */
  notes: readonly Note[];
  onSelect: (time: number) => void;
}

function useBase({ lines, version, theme }: PlotProps) {
  return useMemo(() => ({ lines, line: timeline(lines), theme }), [lines, version, theme]);
}

/** The table of plots that share their times: SI, one column per series. */
export function specsTable(specs: readonly ChartSpec[]): string {
  const times = specs[0]?.times ?? [];
  const header = [
    specs[0]?.xLabel.startsWith("model time") === false ? specs[0].xLabel : "time",
    ...specs.flatMap((s) => s.series.map((x) => `${s.name}: ${x.label}`)),
  ];
  return csv(
    header,
    times.map((t, i) => [t, ...specs.flatMap((s) => s.series.map((x) => (x.said ?? x.values)[i]))]),
  );
}

interface ChartsProps {
  specs: ChartSpec[];
  props: PlotProps;
  handles: ChartHandle[];
  overTime: boolean;
}

function Charts({ specs, props, handles, overTime }: ChartsProps) {
  handles.length = specs.length;
  const above = useMemo(() => stepAndClock(props.lines), [props.lines, props.version]);
  const { notes } = props;
  const shown = useMemo(
    () =>
      overTime
        ? specs.map((spec, k) => ({ ...spec, notes, briefNotes: k > 0, ...(k === 0 && above ? { above } : {}) }))
        : specs,
    [specs, notes, above, overTime],
  );
  return (
    <>
      {shown.map((spec, k) => (
        <Chart
          key={spec.name}
          spec={spec}
          theme={props.theme}
          selected={overTime ? (props.selected ?? props.line?.time) : undefined}
          onSelect={overTime ? props.onSelect : ignored}
          handle={(h) => (handles[k] = h)}
        />
      ))}
    </>
  );
}

const ignored = (): void => {};

interface ChartsPanelProps {
  id: string;
  title: string;
  note?: string;
  specs: ChartSpec[];
  props: PlotProps;
  controls?: ComponentChildren;
  /** Whether the axis is the model's time. */
  overTime?: boolean;
}

export function ChartsPanel({ id, title, note, specs: plain, props, controls, overTime = true }: ChartsPanelProps) {
  const units = props.model?.time?.units;
  const specs = useMemo(() => plain.map((spec) => inTimeUnits(spec, units)), [plain, units]);
  const handles = useRef<ChartHandle[]>([]).current;
  const picture = async (): Promise<Blob> =>
    stackPng(
      await Promise.all(handles.map((h, k) => h.png(k === 0 ? `${title}${stepWords(props)}` : ""))),
      props.theme,
    );
  return (
    <Panel id={id} title={title} controls={controls} png={picture} csv={() => specsTable(specs)}>
      <Charts specs={specs} props={props} handles={handles} overTime={overTime} />
      {note && <p class="note">{note}</p>}
    </Panel>
  );
}

function stepWords({ line, model }: PlotProps): string {
  const level = line?.verdict?.level ?? "ok";
  return line
    ? ` · ${model?.site ? `${model.site}, ` : ""}step ${line.step}, ${timeWords(line.time, model?.time?.units)}${level === "ok" ? "" : ` · ${levelWords[level]}`}`
    : "";
}

export function ParametersPanel(props: PlotProps) {
  const base = useBase(props);
  const specs = useMemo(
    () =>
      parameterNames(props.model, props.line).map((name, k) =>
        parameterSpec(base, k, props.model?.parameters[k], name),
      ),
    [base, props.model],
  );
  return <ChartsPanel id="parameters" title="Parameters: posterior at each step" specs={specs} props={props} />;
}

export function ForecastPanel(props: PlotProps & { quantity: number; setQuantity: (k: number) => void }) {
  const base = useBase(props);
  const all = quantitiesIn(props.model, props.line);
  const q = all[props.quantity];
  const specs = useMemo(
    () => (q ? [forecastSpec(base, q), ...(q.threshold === undefined ? [] : [probabilitySpec(base, q)])] : []),
    [base, q?.name, props.model],
  );
  const title = q ? `Forecast: ${quantityWords(q)}` : "Forecast";
  const passed = q?.horizon !== undefined && props.line !== undefined && props.line.time > q.horizon;
  const note = passed
    ? "Beyond the horizon line: estimates, not forecasts."
    : "Each point: the forecast made at that time.";
  return (
    <ChartsPanel
      id="forecast"
      title={title}
      note={q ? note : props.model || props.line ? "The project file asks for no forecast." : ""}
      specs={specs}
      props={props}
      controls={
        all.length > 1 && (
          <select
            aria-label="Forecast shown"
            value={String(props.quantity)}
            onChange={(e) => props.setQuantity(Number(e.currentTarget.value))}
          >
            {all.map((x, k) => (
              <option key={x.name} value={String(k)}>
                {x.name}
              </option>
            ))}
          </select>
        )
      }
    />
  );
}

export function EvidencePanel(props: PlotProps) {
  const base = useBase(props);
  const specs = useMemo(() => [evidenceSpec(base), dataSpec(base)], [base]);
  const alarm = props.status?.misfit;
  const latest =
    alarm &&
    `Last datum: χ² ${significant(alarm.statistic)} of ${alarm.values} residuals, by chance as large: ${probability(alarm.probability)}.`;
  return (
    <ChartsPanel
      id="evidence"
      title="Evidence and data"
      specs={specs}
      props={props}
      note={`How well each datum was predicted: a drop means that the model does not explain it. ${latest ?? ""}`}
    />
  );
}

export function TimingPanel(props: PlotProps) {
  const base = useBase(props);
  const budget = props.status?.budget_us ?? props.model?.budget_us;
  const specs = useMemo(() => [timingSpec(base, budget)], [base, budget]);
  const totals = useMemo(
    () => props.lines.map((l) => l.elapsed_us.total).filter((t): t is number => t !== undefined),
    [props.lines, props.version],
  );
  const at = (level: number): string => microseconds(quantile(totals, level) ?? NaN);
  const late = props.status?.deadline_misses;
  const note =
    totals.length === 0
      ? ""
      : `Median ${at(0.5)}, 99 % of the updates within ${at(0.99)}${budget ? `; the budget is ${microseconds(budget)}` : ""}${late === undefined ? "" : `, missed ${late === 1 ? "once" : `${late} times`}`}.`;
  return <ChartsPanel id="timing" title="Time of an update, by phase" note={note} specs={specs} props={props} />;
}
