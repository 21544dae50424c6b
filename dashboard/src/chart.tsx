/** A plot over time with uPlot: bands, gaps, thresholds, the step looked at. */
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import uPlot from "uplot";
import { through, type Theme } from "./colour";
import { given, significant } from "./format";
import type { Gap } from "./history";
import { composePng } from "./png";

export interface Series {
  label: string;
  /** `null` is a gap, `undefined` is none: the time is another series' alone. */
  values: (number | null | undefined)[];
  colour: string;
  width?: number;
  dash?: number[];
  /** Bars from 0 instead of a line. */
  bars?: boolean;
  /** Index of the series that this one is the upper edge of a band with; the band's opacity. */
  bandTo?: number;
  /** Index of the series that is the other edge of an interval drawn as two lines: the legend says both. */
  edgeOf?: number;
  opacity?: number;
  /** Edges of bands have no entry of their own in the legend. */
  hidden?: boolean;
  format?: (value: number) => string;
  points?: boolean;
  /** A line without an entry of its own in the legend. */
  bare?: boolean;
  /** Points alone, no line. */
  dots?: boolean;
  /** What the legend and a table say, where it is not what is drawn (stacked bars). */
  said?: (number | null | undefined)[];
  /** Measured or given: as certain under any verdict. */
  fact?: boolean;
}

export interface Mark {
  at: number;
  label: string;
  colour: string;
  dash?: number[];
  /** The axis is stretched to show it. */
  include?: boolean;
}

/** What somebody wrote at a time. */
export interface Note {
  at: number;
  by: string;
  text: string;
}

export interface ChartSpec {
  name: string;
  times: number[];
  series: Series[];
  xLabel: string;
  yLabel: string;
  /** Factor from SI to the axis. */
  factor?: number;
  logarithmic?: boolean;
  range?: [number, number];
  ticks?: (value: number) => string;
  horizontal?: Mark[];
  vertical?: Mark[];
  gaps?: Gap[];
  height?: number;
  /** What stands above a time: its step and the time of day. */
  above?: (time: number) => string;
  /** The plot above has the same bands: its legend says what they are. */
  brief?: boolean;
  notes?: readonly Note[];
  /** Their lines alone: the plot above has their words. */
  briefNotes?: boolean;
  /** What else the legend says. */
  legend?: LegendEntry[];
  /** The horizontal axis counts. */
  counts?: boolean;
  /** Plots over the same numbers share their cursor; "" is none. */
  sync?: string;
}

export interface LegendEntry {
  label: string;
  colour: string;
  look: "line" | "dash" | "band" | "bar";
  opacity?: number;
  value?: string;
  /** As of a series. */
  fact?: boolean;
  /** Not said again below a plot that says it. */
  once?: boolean;
}

export function legendOf(spec: ChartSpec, index: number | undefined, theme: Theme): LegendEntry[] {
  const own = spec.series.flatMap((s): LegendEntry[] => {
    if (s.hidden || s.bare || (spec.brief && s.bandTo !== undefined)) return [];
    const said = (of: Series): string => {
      const value = index === undefined ? null : (of.said ?? of.values)[index];
      return value === null || value === undefined ? "–" : (of.format ?? significant)(value);
    };
    const lower = spec.series[s.bandTo ?? s.edgeOf ?? -1];
    const text = lower ? `${said(lower)} … ${said(s)}` : said(s);
    const look = s.bandTo !== undefined ? "band" : s.bars || s.dots ? "bar" : s.dash?.length ? "dash" : "line";
    return [
      {
        label: s.label,
        colour: s.colour,
        look,
        ...(s.opacity === undefined ? {} : { opacity: s.opacity }),
        ...(s.fact ? { fact: true } : {}),
        // An edge that is not of this time is not worth a dash.
        ...(text.includes("–") && (lower || spec.sync === "") ? {} : { value: text }),
      },
    ];
  });
  const gaps: LegendEntry[] = spec.gaps?.length ? [{ label: "no data", colour: theme.gap, look: "bar" }] : [];
  const more = (spec.legend ?? []).filter((e) => !(e.once && spec.brief));
  return [...own, ...more, ...gaps, ...notesAt(spec, index, theme)];
}

/** The notes of the time that is looked at, in full. */
function notesAt(spec: ChartSpec, index: number | undefined, theme: Theme): LegendEntry[] {
  const time = index === undefined || spec.briefNotes ? undefined : spec.times[index];
  return (spec.notes ?? [])
    .filter((note) => time !== undefined && nearestIndex(spec.times, note.at) === index)
    .map((note) => ({ label: `✎ ${note.by}: ${note.text}`, colour: theme.faint, look: "dash" as const }));
}

export function Legend({ entries, theme }: { entries: LegendEntry[]; theme: Theme }) {
  return (
    <ul class="legend">
      {entries.map((e) => (
        <li key={e.label}>
          <span
            class={`key ${e.look}`}
            style={{
              color:
                e.look === "band"
                  ? through(e.colour, Math.min(1, (e.opacity ?? 0.3) * (theme.dark ? 1.3 : 1.1)))
                  : e.colour,
            }}
          />
          {e.label}
          {e.value !== undefined && (
            <>
              {" "}
              <b {...(e.fact ? { class: "fact" } : {})}>{e.value}</b>
            </>
          )}
        </li>
      ))}
    </ul>
  );
}

export interface ChartHandle {
  png(title: string): Promise<Blob>;
}

/** px of the axis above a plot: two lines. */
const aboveHeight = 40;

interface Props {
  spec: ChartSpec;
  theme: Theme;
  selected: number | undefined;
  onSelect: (time: number) => void;
  handle?: (handle: ChartHandle) => void;
}

export function Chart({ spec, theme, selected, onSelect, handle }: Props) {
  const place = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | undefined>(undefined);
  const live = useRef({ spec, selected, onSelect, theme });
  live.current = { spec, selected, onSelect, theme };
  const [hovered, setHovered] = useState<number>();
  const height = (spec.height ?? 210) + (spec.above ? aboveHeight : 0);
  const structure = JSON.stringify([
    theme.dark,
    height,
    spec.name,
    spec.xLabel,
    spec.yLabel,
    spec.logarithmic,
    spec.above !== undefined,
    spec.series.map((s) => [s.label, s.colour, s.bandTo, s.dash]),
  ]);

  useLayoutEffect(() => {
    const element = place.current!;
    const width = (): number => Math.max(200, element.clientWidth);
    const made = new uPlot(options(live, width(), height, setHovered), data(live.current.spec), element);
    plot.current = made;
    const observer = new ResizeObserver(() => made.width !== width() && made.setSize({ width: width(), height }));
    observer.observe(element);
    return () => {
      observer.disconnect();
      made.destroy();
      plot.current = undefined;
    };
  }, [structure]);

  useEffect(() => {
    const made = plot.current;
    if (!made) return;
    const zoomed = made.data[0].length > 1 && made.scales.x!.min! > made.data[0][0]! + 1e-12;
    made.setData(data(spec), !zoomed);
    if (zoomed) made.redraw(true, false);
  }, [spec, structure]);
  useEffect(() => plot.current?.redraw(false, false), [selected]);

  const index = hovered ?? nearestIndex(spec.times, selected);
  const legend = legendOf(spec, index, theme);
  useEffect(() =>
    handle?.({
      png: (title) =>
        composePng({
          title,
          legend: legendOf(live.current.spec, nearestIndex(live.current.spec.times, live.current.selected), theme),
          picture: plot.current!.ctx.canvas,
          theme,
          ratio: devicePixelRatio,
        }),
    }),
  );
  return (
    <div class="chart">
      <Legend entries={legend} theme={theme} />
      <div
        ref={place}
        role="img"
        aria-label={`${spec.yLabel} over ${spec.xLabel}. ${legend
          .filter((e) => e.value)
          .map((e) => `${e.label} ${e.value}`)
          .join(", ")}`}
      />
    </div>
  );
}

function nearestIndex(times: readonly number[], time: number | undefined): number | undefined {
  if (time === undefined || times.length === 0) return undefined;
  let best = 0;
  times.forEach((t, i) => {
    if (Math.abs(t - time) < Math.abs(times[best]! - time)) best = i;
  });
  return best;
}

function data(spec: ChartSpec): uPlot.AlignedData {
  const f = spec.factor ?? 1;
  const scaled = spec.series.map((s) =>
    f === 1 ? s.values : s.values.map((v) => (v === null || v === undefined ? v : v * f)),
  );
  return [spec.times, ...scaled];
}

/** A label along an axis of this length: smaller where it would be cut. */
export function labelSize(label: string, length: number): number {
  return Math.max(8, Math.min(12, (12 * length) / (letterWidth * label.length)));
}
/** px of an average letter of 12 px. */
const letterWidth = 6;

/** What the horizontal axis shows of these times: dots and bars at its ends are whole. */
export function horizontalRange(spec: ChartSpec, low: number, high: number): [number, number] {
  if (!(high > low)) return [low - 0.5, low + 0.5];
  const bars = spec.series.some((s) => s.bars);
  if (!bars && !spec.series.some((s) => s.dots)) return [low, high];
  const margin = bars && spec.times.length > 1 ? 0.5 / (spec.times.length - 1) : 0.02;
  return [low - margin * (high - low), high + margin * (high - low)];
}

/** Words of vertical marks stand at the foot of a plot, or at its top where a horizontal mark is in their way. */
export function wordsAtTop(horizontals: readonly number[], top: number, bottom: number): boolean {
  const near = (from: number, to: number): boolean => horizontals.some((y) => y >= from && y <= to);
  return near(bottom - 26, bottom) && !near(top, top + 26);
}

type Live = {
  current: { spec: ChartSpec; selected: number | undefined; onSelect: (time: number) => void; theme: Theme };
};

function options(live: Live, width: number, height: number, hover: (index: number | undefined) => void): uPlot.Options {
  const { spec, theme } = live.current;
  const font = "12px system-ui, sans-serif";
  const axis = {
    stroke: theme.faint,
    font,
    labelFont: font,
    grid: { stroke: theme.grid, width: 1 },
    ticks: { stroke: theme.grid, width: 1, size: 4 },
  };
  const labelled = (_u: uPlot, places: number[]): (number | null)[] =>
    places.map((v) => (live.current.spec.ticks?.(v) === "" ? null : v));
  const bands = spec.series.flatMap((s, i): uPlot.Band[] =>
    s.bandTo === undefined ? [] : [{ series: [i + 1, s.bandTo + 1], fill: through(s.colour, s.opacity ?? 0.25) }],
  );
  return {
    width,
    height,
    // Room for half of a time of day above the last step.
    ...(spec.above ? { padding: [null, 30, null, null] as uPlot.Padding } : {}),
    legend: { show: false },
    cursor: {
      ...(spec.sync === "" ? {} : { sync: { key: spec.sync ?? "knothe" } }),
      drag: { x: true, y: false, dist: 8 },
      points: { size: 6 },
    },
    scales: {
      x: { time: false, range: (_u, low, high) => horizontalRange(live.current.spec, low, high) },
      y: yScale(live),
    },
    axes: [
      {
        ...axis,
        label: spec.xLabel,
        labelSize: 18,
        size: 30,
        space: 60,
        values: (_u, ticks) => ticks.map((v) => (v === null ? "" : given(v))),
        ...(spec.counts ? { incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000] } : {}),
      },
      ...(spec.above
        ? [
            {
              ...axis,
              scale: "x",
              side: 0 as const,
              size: aboveHeight,
              gap: 20, // of two lines, the lower one above the plot
              space: 90,
              grid: { show: false },
              values: (_u: uPlot, ticks: number[]) => ticks.map((t) => live.current.spec.above?.(t) ?? ""),
            },
          ]
        : []),
      {
        ...axis,
        // Of a logarithmic axis only the lines that are labelled: those between would merge into bands.
        grid: { ...axis.grid, filter: labelled },
        ticks: { ...axis.ticks, filter: labelled },
        scale: "y",
        label: spec.yLabel,
        labelFont: `${labelSize(spec.yLabel, height - (spec.above ? aboveHeight : 0) - 32)}px system-ui, sans-serif`,
        labelSize: 20,
        // As wide as its longest number.
        size: (_u, ticks) => Math.max(52, 20 + 7 * Math.max(0, ...(ticks ?? []).map((t) => t.length))),
        space: 32,
        values: (_u, ticks) => ticks.map((v) => (v === null ? "" : (live.current.spec.ticks ?? given)(v))),
      },
    ],
    series: [
      {},
      ...spec.series.map((s): uPlot.Series => ({
        label: s.label,
        stroke: s.bandTo !== undefined || s.hidden ? through(s.colour, s.bars ? 1 : 0.35) : s.colour,
        width: s.bars ? 0 : (s.width ?? (s.bandTo !== undefined || s.hidden ? 0.5 : 2)),
        ...(s.dash ? { dash: s.dash } : {}),
        ...(s.bars ? { fill: s.colour, paths: uPlot.paths.bars!({ size: [1, 100], gap: 0 }) } : {}),
        ...(s.dots ? { paths: () => null } : {}),
        points: (s.points || s.dots) && !s.bars ? { show: true, size: 5, fill: s.colour } : { show: false },
        spanGaps: false,
      })),
    ],
    bands,
    hooks: {
      drawClear: [(u) => drawGaps(u, live.current)],
      draw: [(u) => drawMarks(u, live.current)],
      setCursor: [
        (u) => hover(u.cursor.left !== undefined && u.cursor.left >= 0 ? (u.cursor.idx ?? undefined) : undefined),
      ],
      ready: [
        (u) =>
          u.over.addEventListener("click", () => {
            if (u.select.width < 2 && u.cursor.left !== undefined)
              live.current.onSelect(u.posToVal(u.cursor.left, "x"));
          }),
      ],
    },
  };
}

function yScale(live: Live): uPlot.Scale {
  const { spec } = live.current;
  const range = (_u: uPlot, low: number | null, high: number | null): [number, number] =>
    verticalRange(live.current.spec, low ?? Infinity, high ?? -Infinity);
  return spec.logarithmic ? { distr: 3, range } : { range };
}

/** The next 1, 2 or 5 of a decade, down. */
function roundedDown(value: number): number {
  const decade = 10 ** Math.floor(Math.log10(value) + 1e-9);
  return decade * [5, 2, 1].find((m) => m * decade <= value * (1 + 1e-9))!;
}

/** What the vertical axis shows of data between these numbers, which are in its units. */
export function verticalRange(spec: ChartSpec, dataLow: number, dataHigh: number): [number, number] {
  if (spec.range) return spec.range;
  const marks = (spec.horizontal ?? []).filter((m) => m.include).map((m) => m.at * (spec.factor ?? 1));
  const low = Math.min(...marks, dataLow);
  const high = Math.max(...marks, dataHigh);
  if (!Number.isFinite(low) || !Number.isFinite(high)) return spec.logarithmic ? [1, 10] : [0, 1];
  if (spec.logarithmic) return [roundedDown(low), 1 / roundedDown(1 / high)];
  const margin = 0.06 * (high - low) || Math.abs(high) * 0.1 || 1;
  return [low - margin, high + margin];
}

function drawGaps(u: uPlot, { spec, theme }: Live["current"]): void {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  for (const gap of spec.gaps ?? []) {
    const from = u.valToPos(gap.from, "x", true);
    const to = u.valToPos(gap.to, "x", true);
    ctx.fillStyle = theme.gap;
    ctx.fillRect(from, bbox.top, to - from, bbox.height);
    ctx.fillStyle = theme.faint;
    ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    if (to - from > ctx.measureText(gap.cause).width + 6) {
      ctx.textAlign = "center";
      ctx.fillText(gap.cause, (from + to) / 2, bbox.top + bbox.height - 6 * devicePixelRatio);
    }
  }
  ctx.restore();
}

function drawMarks(u: uPlot, { spec, theme, selected }: Live["current"]): void {
  const { ctx, bbox } = u;
  const px = devicePixelRatio;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.font = `600 ${11 * px}px system-ui, sans-serif`;
  const across = (spec.horizontal ?? []).map((m) => u.valToPos(m.at * (spec.factor ?? 1), "y", true) / px);
  const atTop = wordsAtTop(across, bbox.top / px, (bbox.top + bbox.height) / px);
  for (const mark of spec.horizontal ?? []) {
    const y = u.valToPos(mark.at * (spec.factor ?? 1), "y", true);
    line(ctx, bbox.left, y, bbox.left + bbox.width, y, mark, px);
    ctx.textAlign = "right";
    write(
      ctx,
      mark.label,
      bbox.left + bbox.width - 8 * px,
      y > bbox.top + 18 * px ? y - 6 * px : y + 15 * px,
      theme,
      px,
    );
  }
  for (const mark of spec.vertical ?? []) {
    const x = u.valToPos(mark.at, "x", true);
    line(ctx, x, bbox.top, x, bbox.top + bbox.height, mark, px);
    const right = x + ctx.measureText(mark.label).width + 8 * px > bbox.left + bbox.width;
    ctx.textAlign = right ? "right" : "left";
    const y = atTop ? bbox.top + 13 * px : bbox.top + bbox.height - 7 * px;
    write(ctx, mark.label, x + (right ? -5 : 5) * px, y, theme, px);
  }
  drawNotes(u, spec, theme);
  if (selected !== undefined) {
    const x = u.valToPos(selected, "x", true);
    line(ctx, x, bbox.top, x, bbox.top + bbox.height, { colour: theme.text }, px);
  }
  ctx.restore();
}

const noteRows = 3;
const longestNote = 26;

/** At the top, one below the other where they are close; words that find no room are in the legend of their time. */
function drawNotes(u: uPlot, spec: ChartSpec, theme: Theme): void {
  const { ctx, bbox } = u;
  const px = devicePixelRatio;
  const ends: number[] = Array.from({ length: noteRows }, () => -Infinity);
  ctx.font = `${11 * px}px system-ui, sans-serif`;
  for (const note of [...(spec.notes ?? [])].sort((a, b) => a.at - b.at)) {
    const x = u.valToPos(note.at, "x", true);
    if (x < bbox.left - 1 || x > bbox.left + bbox.width + 1) continue;
    line(ctx, x, bbox.top, x, bbox.top + bbox.height, { colour: theme.faint, dash: [1, 2] }, px);
    if (spec.briefNotes) continue;
    const words = `✎ ${note.text.length > longestNote ? `${note.text.slice(0, longestNote - 1)}…` : note.text}`;
    const width = ctx.measureText(words).width + 8 * px;
    const right = x + width > bbox.left + bbox.width;
    const begin = right ? x - width : x;
    const row = ends.findIndex((end) => end <= begin);
    if (row < 0) continue;
    ends[row] = begin + width;
    ctx.textAlign = right ? "right" : "left";
    ctx.fillStyle = theme.text;
    write(ctx, words, x + (right ? -4 : 4) * px, bbox.top + (12 + 14 * row) * px, theme, px);
  }
}

/** With a rim in the panel's colour: readable on lines and bands. */
function write(ctx: CanvasRenderingContext2D, text: string, x: number, y: number, theme: Theme, px: number): void {
  ctx.setLineDash([]);
  ctx.strokeStyle = theme.panel;
  ctx.lineWidth = 4 * px;
  ctx.lineJoin = "round";
  ctx.strokeText(text, x, y);
  ctx.fillText(text, x, y);
}

function line(
  ctx: CanvasRenderingContext2D,
  x0: number,
  y0: number,
  x1: number,
  y1: number,
  mark: { colour: string; dash?: number[] },
  px: number,
): void {
  ctx.strokeStyle = mark.colour;
  ctx.fillStyle = mark.colour;
  ctx.lineWidth = 1.2 * px;
  ctx.setLineDash((mark.dash ?? []).map((d) => d * px));
  ctx.beginPath();
  ctx.moveTo(x0, y0);
  ctx.lineTo(x1, y1);
  ctx.stroke();
}
