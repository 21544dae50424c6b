/** The published study's figures: plots, densities and maps, which its record holds as they are. Pure. */
import type { ChartSpec, Series } from "../chart";
import type { Theme } from "../colour";
import { axisLabel, decade, halfDecade, scaleFor } from "../format";
import { charts, type Content } from "./content";
import { joined } from "./curves";
import { densitySpec, support } from "./densities";
import type { Study, StudyChart, StudyColour, StudyCurve, StudyDensities, StudyMap } from "./record";
import { deformed } from "./shapes";

function colourOf(colour: StudyColour | undefined, place: number, theme: Theme): string {
  return typeof colour === "string" ? theme[colour] : theme.series[(colour ?? place) % theme.series.length]!;
}

function look(c: StudyCurve, k: number, theme: Theme): Omit<Series, "values"> {
  return {
    label: c.label,
    colour: colourOf(c.colour, k, theme),
    ...(c.width === undefined ? {} : { width: c.width }),
    ...(c.dashed ? { dash: [7, 4] } : {}),
    ...(c.points ? { points: true } : {}),
    ...(c.look === "points" ? { dots: true } : {}),
    ...(c.look === "bars" ? { bars: true } : {}),
  };
}

function chartSpec(c: StudyChart, name: string, theme: Theme): ChartSpec {
  // A band is its lower edge, hidden, and its upper one; what lies in front comes last.
  const edges = c.bands.flatMap((b, k) => {
    const colour = colourOf(b.colour, k, theme);
    return [
      { x: b.x, y: b.low, look: { label: `${b.label}, low`, colour, hidden: true } },
      { x: b.x, y: b.high, look: { label: b.label, colour, bandTo: 2 * k, opacity: 0.15 } },
    ];
  });
  const all = [...edges, ...c.curves.map((one, k) => ({ x: one.x, y: one.y, look: look(one, k, theme) }))];
  const numbers = all.flatMap((one) => one.y.filter((v): v is number => v !== null));
  const [low, high] = [
    numbers.reduce((a, b) => Math.min(a, b), Infinity),
    numbers.reduce((a, b) => Math.max(a, b), -Infinity),
  ];
  const mark = (m: StudyChart["marks"][number], at: number) => ({
    at,
    label: m.label,
    colour: colourOf(m.colour, 0, theme),
    dash: [6, 4],
  });
  return {
    ...joined(
      all.map((one) => one.x),
      all.map((one) => one.y),
      all.map((one) => one.look),
    ),
    name,
    xLabel: c.x,
    yLabel: c.y,
    ...(c.logarithmic ? { logarithmic: true, ticks: high < 100 * low ? halfDecade : decade } : {}),
    ...(c.least === undefined ? {} : { range: [c.least, high + 0.06 * (high - c.least)] as [number, number] }),
    ...(all.every((one) => one.x.every(Number.isInteger)) ? { counts: true } : {}),
    horizontal: c.marks.flatMap((m) => (m.y === undefined ? [] : [{ ...mark(m, m.y), include: true }])),
    vertical: c.marks.flatMap((m) => (m.x === undefined ? [] : [mark(m, m.x)])),
    height: 250,
    sync: "",
  };
}

function densities(d: StudyDensities, name: string, theme: Theme): ChartSpec {
  const steps = d.steps.map(({ step, ...density }) => ({ step, density }));
  const scale = scaleFor(d.units, support(steps.map((s) => s.density))[1]);
  const spec = densitySpec(
    {
      name,
      xLabel: axisLabel(d.label, scale.units || "–"),
      factor: scale.factor,
      units: scale.factor === 1 ? "" : scale.units,
      steps,
      prior: d.prior,
    },
    theme,
  );
  return d.truth === undefined
    ? spec
    : { ...spec, vertical: [{ at: d.truth * scale.factor, label: "true value", colour: theme.red, dash: [6, 4] }] };
}

function map(r: Study, m: StudyMap): Content | undefined {
  const face = r.faces[m.face];
  if (!face) return undefined;
  const { title, label, units, signed, sensors } = m;
  const value = m.value ?? m.field?.x;
  return {
    mesh: {
      title,
      ...face,
      label,
      units,
      signed,
      ...(value ? { value } : {}),
      ...(m.field ? { shift: deformed(face, m.field) } : {}),
      ...(sensors ? { sensors } : {}),
    },
  };
}

export function study(r: Study, of: string, theme: Theme): Content | undefined {
  const drawing = r.drawings[Number(of)];
  switch (drawing?.kind) {
    case "chart":
      return charts(chartSpec(drawing, `drawing ${of}`, theme));
    case "densities":
      return charts(densities(drawing, `drawing ${of}`, theme));
    case "map":
      return map(r, drawing);
  }
  return undefined;
}
