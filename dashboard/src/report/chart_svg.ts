/** A plot as a drawing that stays sharp on paper: what `Chart` draws, from the same description. Pure. */
import {
  horizontalRange,
  labelSize,
  legendOf,
  verticalRange,
  wordsAtTop,
  type ChartSpec,
  type LegendEntry,
  type Mark,
  type Series,
} from "../chart";
import type { Theme } from "../colour";
import { given } from "../format";
import { ticks } from "../pair";

export function escaped(text: string): string {
  return text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;").replace(/"/g, "&quot;");
}

/** A tag with its attributes; numbers to a hundredth of a pixel. */
export function tag(name: string, attributes: Record<string, string | number | undefined>, content = ""): string {
  const list = Object.entries(attributes)
    .filter(([, v]) => v !== undefined)
    .map(([k, v]) => ` ${k}="${typeof v === "number" ? Number(v.toFixed(2)) : escaped(v!)}"`);
  return `<${name}${list.join("")}${content ? `>${content}</${name}>` : "/>"}`;
}

export function text(
  x: number,
  y: number,
  words: string,
  colour: string,
  more: Record<string, string | number> = {},
): string {
  return tag("text", { x, y, fill: colour, ...more }, escaped(words));
}

/** The document around a drawing. */
export function svg(width: number, height: number, theme: Theme, title: string, content: string): string {
  const ground = tag("rect", { width, height, fill: theme.panel });
  return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" font-family="system-ui, sans-serif" font-size="12" role="img">${tag("title", {}, escaped(title))}${ground}${content}</svg>`;
}

interface Frame {
  left: number;
  top: number;
  width: number;
  height: number;
  x: (value: number) => number;
  y: (value: number) => number;
  low: number;
  high: number;
}

/** Letters are taken to be so wide on average, px. */
const letter = 6.4;

function legendRows(legend: readonly LegendEntry[], width: number): { entry: LegendEntry; x: number; row: number }[] {
  let x = 8;
  let row = 0;
  return legend.map((entry) => {
    const wide = 30 + letter * entry.label.length;
    if (x > 8 && x + wide > width) {
      x = 8;
      row += 1;
    }
    const place = { entry, x, row };
    x += wide;
    return place;
  });
}

function legendSvg(places: ReturnType<typeof legendRows>, theme: Theme): string {
  return places
    .map(({ entry, x, row }) => {
      const y = 14 + 17 * row;
      const area = entry.look === "band" || entry.look === "bar";
      const key = area
        ? tag("rect", {
            x,
            y: y - 9,
            width: entry.look === "bar" ? 10 : 16,
            height: 10,
            fill: entry.colour,
            "fill-opacity": entry.look === "band" ? (entry.opacity ?? 0.3) : 1,
          })
        : tag("path", {
            d: `M${x} ${y - 4}h16`,
            stroke: entry.colour,
            "stroke-width": 2,
            "stroke-dasharray": entry.look === "dash" ? "4 3" : undefined,
          });
      return key + text(x + 21, y, entry.label, theme.text);
    })
    .join("");
}

type Value = number | null | undefined;

/** Lines broken at gaps; what is another series' alone is passed over. */
function path(frame: Frame, times: readonly number[], values: readonly Value[], factor: number): string {
  let pen = "M";
  let d = "";
  times.forEach((t, i) => {
    const v = values[i];
    if (v === undefined) return;
    if (v === null) {
      pen = "M";
      return;
    }
    d += `${pen}${frame.x(t).toFixed(1)} ${frame.y(v * factor).toFixed(1)}`;
    pen = "L";
  });
  return d;
}

function bandPath(frame: Frame, times: readonly number[], low: Series, high: Series, factor: number): string {
  const there = times
    .map((_, i) => i)
    .filter((i) => typeof low.values[i] === "number" && typeof high.values[i] === "number");
  const at = (i: number, s: Series): string =>
    `${frame.x(times[i]!).toFixed(1)} ${frame.y((s.values[i] as number) * factor).toFixed(1)}`;
  return there.length === 0
    ? ""
    : `M${there.map((i) => at(i, high)).join("L")}L${[...there]
        .reverse()
        .map((i) => at(i, low))
        .join("L")}Z`;
}

function seriesSvg(frame: Frame, spec: ChartSpec, s: Series): string {
  const factor = spec.factor ?? 1;
  const lower = s.bandTo === undefined ? undefined : spec.series[s.bandTo];
  if (lower)
    return tag("path", {
      class: "band",
      d: bandPath(frame, spec.times, lower, s, factor),
      fill: s.colour,
      "fill-opacity": s.opacity ?? 0.25,
    });
  // Edges of a band are the band's; other lines without words of their own are faint.
  if (s.hidden && spec.series.some((other) => spec.series[other.bandTo ?? -1] === s)) return "";
  if (s.bars) {
    const wide = Math.max(1, (0.8 * frame.width) / Math.max(1, spec.times.length));
    const foot = frame.y(Math.max(0, frame.low));
    return spec.times
      .map((t, i) => {
        const v = s.values[i];
        if (typeof v !== "number") return "";
        const top = frame.y(v * factor);
        return tag("rect", {
          x: frame.x(t) - wide / 2,
          y: Math.min(top, foot),
          width: wide,
          height: Math.abs(foot - top),
          fill: s.colour,
        });
      })
      .join("");
  }
  const dots =
    (s.dots ?? s.points)
      ? spec.times
          .map((t, i) => {
            const v = s.values[i];
            return typeof v === "number"
              ? tag("circle", { cx: frame.x(t), cy: frame.y(v * factor), r: s.dots ? 2 : 1.8, fill: s.colour })
              : "";
          })
          .join("")
      : "";
  if (s.dots) return dots;
  const line = tag("path", {
    class: "line",
    d: path(frame, spec.times, s.values, factor),
    fill: "none",
    stroke: s.colour,
    "stroke-width": s.width ?? 2,
    "stroke-opacity": s.hidden ? 0.35 : undefined,
    "stroke-dasharray": s.dash?.length ? s.dash.join(" ") : undefined,
  });
  return line + dots;
}

function marksSvg(frame: Frame, spec: ChartSpec, theme: Theme): string {
  const right = frame.left + frame.width;
  const level = (m: Mark): number => frame.y(m.at * (spec.factor ?? 1));
  const atTop = wordsAtTop((spec.horizontal ?? []).map(level), frame.top, frame.top + frame.height);
  const line = (d: string, m: Mark): string =>
    tag("path", { class: "mark", d, stroke: m.colour, "stroke-width": 1.2, "stroke-dasharray": m.dash?.join(" ") });
  const across = (spec.horizontal ?? []).map((m) => {
    const y = level(m);
    if (y < frame.top || y > frame.top + frame.height) return "";
    return (
      line(`M${frame.left} ${y.toFixed(1)}H${right}`, m) +
      text(right - 6, y > frame.top + 16 ? y - 5 : y + 14, m.label, m.colour, {
        "text-anchor": "end",
        "font-weight": 600,
      })
    );
  });
  const up = (spec.vertical ?? []).map((m) => {
    const x = frame.x(m.at);
    if (x < frame.left || x > right) return "";
    const flip = x + letter * m.label.length > right;
    const words = text(x + (flip ? -5 : 5), atTop ? frame.top + 13 : frame.top + frame.height - 7, m.label, m.colour, {
      "text-anchor": flip ? "end" : "start",
      "font-weight": 600,
    });
    return line(`M${x.toFixed(1)} ${frame.top}V${frame.top + frame.height}`, m) + words;
  });
  const gaps = (spec.gaps ?? []).map((g) =>
    tag("rect", {
      x: frame.x(g.from),
      y: frame.top,
      width: frame.x(g.to) - frame.x(g.from),
      height: frame.height,
      fill: theme.gap,
    }),
  );
  return gaps.join("") + across.join("") + up.join("");
}

function axesSvg(frame: Frame, spec: ChartSpec, theme: Theme, times: readonly number[]): string {
  const [first, last] = [times[0]!, times[times.length - 1]!];
  const foot = frame.top + frame.height;
  const within = (v: number): boolean => v >= frame.low * 0.999 && v <= frame.high * 1.001;
  const powers = Array.from({ length: 40 }, (_, k) => 10 ** (k - 20));
  const decades = powers.filter(within);
  const rows = spec.logarithmic
    ? decades.length > 2
      ? decades.filter((_, k) => k % Math.ceil(decades.length / Math.max(2, Math.floor(frame.height / 18))) === 0)
      : powers.flatMap((v) => [v, 2 * v, 5 * v]).filter(within)
    : ticks({ low: frame.low, high: frame.high }, 5);
  const columns = last > first ? ticks({ low: first, high: last }, frame.width / 70) : [first];
  const grid = (d: string): string => tag("path", { d, stroke: theme.grid });
  return [
    ...rows.map(
      (v) =>
        grid(`M${frame.left} ${frame.y(v).toFixed(1)}h${frame.width}`) +
        text(frame.left - 6, frame.y(v) + 4, (spec.ticks ?? given)(v), theme.faint, { "text-anchor": "end" }),
    ),
    ...columns.map(
      (v) =>
        grid(`M${frame.x(v).toFixed(1)} ${frame.top}v${frame.height}`) +
        text(frame.x(v), foot + 16, given(v), theme.faint, { "text-anchor": "middle" }),
    ),
    text(frame.left + frame.width / 2, foot + 34, spec.xLabel, theme.faint, { "text-anchor": "middle" }),
    tag(
      "g",
      { transform: `translate(14 ${(frame.top + frame.height / 2).toFixed(0)}) rotate(-90)` },
      text(0, 0, spec.yLabel, theme.faint, {
        "text-anchor": "middle",
        "font-size": labelSize(spec.yLabel, frame.height + 10),
      }),
    ),
  ].join("");
}

export function chartSvg(spec: ChartSpec, theme: Theme, width = 520): string {
  const legend = legendRows(legendOf(spec, undefined, theme), width);
  const top = 12 + 17 * ((legend[legend.length - 1]?.row ?? -1) + 1);
  const high = spec.height ?? 210;
  const factor = spec.factor ?? 1;
  const drawn = spec.series.flatMap((s) =>
    s.values.filter((v): v is number => typeof v === "number").map((v) => v * factor),
  );
  const [low, up] = verticalRange(
    spec,
    drawn.reduce((a, b) => Math.min(a, b), Infinity),
    drawn.reduce((a, b) => Math.max(a, b), -Infinity),
  );
  const times = spec.times.length ? spec.times : [0];
  const [first, last] = horizontalRange(spec, times[0]!, times[times.length - 1]!);
  const span = last - first;
  const scale = spec.logarithmic ? Math.log10 : (v: number) => v;
  const inside = Math.max(40, high - 50);
  const frame: Frame = {
    left: 66,
    top,
    width: width - 78,
    height: inside,
    low,
    high: up,
    x: (v) => 66 + ((v - first) / span) * (width - 78),
    y: (v) =>
      top +
      inside *
        (1 - (scale(Math.max(v, spec.logarithmic ? 1e-300 : -Infinity)) - scale(low)) / (scale(up) - scale(low))),
  };
  const cut = `c${spec.name.replace(/\W/g, "")}${width}`;
  const content =
    tag(
      "clipPath",
      { id: cut },
      tag("rect", { x: frame.left, y: frame.top, width: frame.width, height: frame.height }),
    ) +
    axesSvg(frame, spec, theme, times) +
    tag(
      "g",
      { "clip-path": `url(#${cut})` },
      marksSvg(frame, { ...spec, horizontal: [], vertical: [] }, theme) +
        spec.series.map((s) => seriesSvg(frame, spec, s)).join(""),
    ) +
    marksSvg(frame, { ...spec, gaps: [] }, theme) +
    legendSvg(legend, theme);
  return svg(width, top + high, theme, `${spec.yLabel} over ${spec.xLabel}`, content);
}
