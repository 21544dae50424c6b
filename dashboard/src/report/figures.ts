/** Which drawing a place on the page is for: the names that the program writes into `data-figure`. Pure. */
import type { ChartSpec } from "../chart";
import type { Theme } from "../colour";
import { significant, timeWords } from "../format";
import { timeline } from "../history";
import {
  evidenceSpec,
  forecastSpec,
  inTimeUnits,
  parameterScale,
  parameterSpec,
  probabilitySpec,
  quantitiesIn,
  timingSpec,
} from "../specs";
import { charts, mostPairs, pairWords, type Content } from "./content";
import {
  curvesSpec,
  diagnosticSpec,
  discrepancySpec,
  informationSpec,
  loadSpec,
  measuredSpec,
  modelsSpec,
  monitorSpec,
  noiseSpec,
  orderSpec,
  qqSpec,
  residualSpec,
} from "./curves";
import { decisionsSpec, riskSpec } from "./decisions";
import { forecastDensitySpec, marginalSpec } from "./densities";
import { firstProbe, mapsContent } from "./maps";
import type { MeshSensor } from "./mesh_svg";
import { comparison, inference, plain, selection } from "./other_figures";
import { modelOf, pretty, type Assimilation, type Field, type Probe, type Report, type Specimen } from "./record";
import { deformed, exaggeration, shape } from "./shapes";
import { study } from "./study";

/** Sensors move with what is drawn: each as the node nearest to it. */
function moved(sensors: MeshSensor[], s: Specimen, shift: { x: number[]; y: number[] }): MeshSensor[] {
  return sensors.map((sensor) => {
    let best = 0;
    let least = Infinity;
    s.points.forEach(([x, y], i) => {
      const distance = Math.hypot(x - sensor.x, y - sensor.y);
      if (distance < least) [best, least] = [i, distance];
    });
    return { ...sensor, shift: [shift.x[best] ?? 0, shift.y[best] ?? 0] };
  });
}

function sensorsOf(r: Assimilation, marks: (i: number) => Partial<MeshSensor>, component = ""): MeshSensor[] {
  const { sensors } = r;
  if (!sensors) return [];
  return sensors.x.flatMap((x, i) =>
    component === "" || sensors.component[i] === component
      ? [
          {
            x,
            y: sensors.y[i]!,
            words: `sensor ${i}, u_${sensors.component[i]}`,
            component: sensors.component[i]!,
            ...marks(i),
          },
        ]
      : [],
  );
}

/** The structure with its sensors, in the shape that the posterior mean gives it at the step looked at. */
function specimen(r: Assimilation, chosen: number): Content | undefined {
  const s = r.specimen;
  if (!s) {
    const sensors = sensorsOf(r, () => ({}));
    return sensors.length
      ? { mesh: { title: "Sensors", points: [], cells: [], label: "places of the sensors", units: "", sensors } }
      : undefined;
  }
  const time = r.lines[chosen]?.time ?? 0;
  const field = s.fields.reduce<Field | undefined>(
    (a, b) => (!a || Math.abs((b.time ?? 0) - time) < Math.abs((a.time ?? 0) - time) ? b : a),
    undefined,
  );
  const sensors = sensorsOf(r, () => ({}));
  if (!field) return { mesh: { title: "Specimen", points: s.points, cells: s.cells, label: "", units: "m", sensors } };
  const by = exaggeration(s, field);
  const value = field.x.map((x, i) => Math.hypot(x, field.y[i]!));
  const shift = deformed(s, field);
  return {
    mesh: {
      title: "Specimen and sensors",
      points: s.points,
      cells: s.cells,
      value,
      range: [0, value.reduce((a, b) => Math.max(a, b), 0) || 1],
      shift,
      label: `displacement${by > 1 ? `, drawn ${significant(by, 2)} × larger` : ""}, ${timeWords(field.time ?? time, r.time_units)}`,
      units: "m",
      sensors: moved(sensors, s, shift),
    },
  };
}

function residualMap(r: Assimilation, component: string): Content | undefined {
  const { sensors } = r;
  if (!sensors) return undefined;
  return {
    mesh: {
      title: `Residuals of u_${component}`,
      points: r.specimen?.points ?? [],
      cells: r.specimen?.cells ?? [],
      label: `u_${component}: mean residual of the last ${sensors.averaged} steps`,
      units: "m",
      signed: true,
      sensors: sensorsOf(r, (i) => ({ value: sensors.mean[i]! }), component),
    },
  };
}

/** The published approximation of a crack length (Eq. 33), where it agrees. */
function withPublished(spec: ChartSpec, r: Assimilation, name: string, theme: Theme): ChartSpec {
  type Published = { values: number[]; agrees?: boolean } | undefined;
  const published = r.lines.map((l) => (l.forecast[name] as { published?: Published } | undefined)?.published);
  if (!published.some((p) => p && p.agrees !== false)) return spec;
  const byTime = new Map(r.lines.map((l, i) => [l.time, published[i]]));
  const edge = (at: number): (number | null)[] =>
    spec.times.map((t) => {
      const p = byTime.get(t);
      return p && p.agrees !== false ? (p.values.at(at) ?? null) : null;
    });
  const look = {
    colour: theme.blue,
    width: 1.3,
    dash: [5, 3],
    ...(spec.series[0]?.format ? { format: spec.series[0].format } : {}),
  };
  const label = "95 %, Gaussian approximation (paper, Eq. 33)";
  return {
    ...spec,
    series: [
      ...spec.series,
      { ...look, label, values: edge(-1), edgeOf: spec.series.length + 1 },
      { ...look, label: `${label}, low`, values: edge(0), bare: true },
    ],
  };
}

function assimilation(r: Assimilation, name: string, of: string, theme: Theme, chosen: number): Content | undefined {
  const model = modelOf(r);
  const base = { lines: r.lines, line: timeline(r.lines), theme };
  const last = r.lines[r.lines.length - 1]!;
  const q = quantitiesIn(model, last).find((x) => x.name === of);
  const k = Number(of);
  switch (name) {
    case "specimen":
      return specimen(r, chosen);
    case "measured":
      return charts(r.measured?.[k] && measuredSpec(r, r.measured[k], theme));
    case "load":
      return charts(loadSpec(r, theme));
    case "residuals":
      return charts(residualSpec(r, theme));
    case "quantiles":
      return charts(qqSpec(r, theme));
    case "noise":
      return charts(noiseSpec(r, theme));
    case "residual_map":
      return residualMap(r, of);
    case "marginal":
      return charts(marginalSpec(r, k, chosen, theme));
    case "parameter": {
      const p = model.parameters[k];
      const truth = r.summary.parameters?.[k]?.truth;
      const spec = parameterSpec(base, k, p, p?.name ?? `p${k}`);
      if (truth !== undefined)
        spec.horizontal = [
          ...(spec.horizontal ?? []),
          { at: truth, label: "true value", colour: theme.red, dash: [6, 4], include: true },
        ];
      return charts({ ...spec, brief: false, height: 220 });
    }
    case "pairs": {
      const names = r.summary.parameters?.map((p) => p.name) ?? [];
      const draws = names.map((n) => r.summary.draws?.[n] ?? []);
      const count = Math.min(mostPairs, names.length);
      return count < 2 || !draws[0]!.length
        ? undefined
        : {
            pairs: {
              count,
              line: last,
              lines: r.lines,
              names: names.map(pretty),
              scales: names.map((_, i) => parameterScale(model.parameters[i])),
              points: draws[0]!.map((_, i) => draws.map((d) => d[i]!)),
              model,
              whole: false,
            },
            legend: pairWords(theme),
          };
    }
    case "forecast":
      return (
        q &&
        charts(
          withPublished(forecastSpec(base, q), r, q.name, theme),
          q.threshold === undefined ? undefined : probabilitySpec(base, q),
        )
      );
    case "forecast_density":
      return q && charts(forecastDensitySpec(r, q, chosen, theme));
    case "decisions":
      return charts(decisionsSpec(r, theme));
    case "risk":
      return charts(riskSpec(r, theme));
    case "information":
      return charts(informationSpec(r, theme));
    case "evidence":
      return charts(evidenceSpec(base));
    case "monitor":
      return charts(monitorSpec(r, theme));
    case "discrepancy":
      return charts(discrepancySpec(r, theme));
    case "models":
      return charts(modelsSpec(r, theme));
    case "timing":
      return charts({ ...timingSpec(base, undefined), height: 240 });
    case "diagnostic":
      return charts(diagnosticSpec(r, theme));
    case "order":
      return charts(orderSpec(r, theme));
    case "mode":
      return shape(r.specimen, r.specimen?.modes?.[k], "horizontal component, largest 1", "1");
    case "crack":
      return shape(r.specimen, r.specimen?.crack?.[k], "horizontal displacement, m per m imposed", "1");
    case "functions":
      return charts(r.functions?.[k] && curvesSpec(r.functions[k], `functions ${k}`, theme));
  }
  return undefined;
}

/** `chosen`: index of the step that is looked at. */
export function contentOf(
  report: Report,
  figure: string,
  theme: Theme,
  chosen: number,
  probe?: Probe,
): Content | undefined {
  const [name = "", of = ""] = figure.split(/:(.*)/s);
  switch (report.kind) {
    case "assimilation": {
      const drawn = assimilation(report, name, of, theme, chosen);
      return drawn && "charts" in drawn
        ? { charts: drawn.charts.map((spec) => inTimeUnits(spec, report.time_units)) }
        : drawn;
    }
    case "inference":
      return inference(report, name, of, theme);
    case "comparison":
      return comparison(report, name, of, theme);
    case "selection":
      return selection(report, name, of, theme);
    case "curves":
      return plain(report, of, theme);
    case "study":
      return study(report, of, theme);
    case "maps":
      return mapsContent(report, name, of, theme, chosen, probe ?? firstProbe(report));
  }
}
