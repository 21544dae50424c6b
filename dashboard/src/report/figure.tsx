/** A figure of a report: drawn, explored with the cursor, taken away as SVG, PNG or CSV. */
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { Chart, Legend, type ChartSpec } from "../chart";
import type { Theme } from "../colour";
import { csv, type Cell } from "../csv";
import { drawPairs, pairsTable } from "../pair_panel";
import { blobOf, save, saveText } from "../png";
import { chartSvg, svg, text } from "./chart_svg";
import type { Content, Pairs } from "./content";
import { meshReadout, meshSvg, meshView, type MeshSpec } from "./mesh_svg";
import type { Probe } from "./record";
import { SvgContext } from "./svg_context";

const drawnWidth = 440;
/** Paper is dear: plots are that much lower on it. */
const paperHeight = 0.72;

/** Drawings one below the other. */
function stacked(drawings: readonly string[]): string {
  if (drawings.length === 1) return drawings[0]!;
  let top = 0;
  const inner = drawings.map((drawing) => {
    const height = Number(/viewBox="0 0 \S+ (\S+)"/.exec(drawing)![1]);
    const placed = drawing.replace("<svg ", `<svg y="${top}" width="${drawnWidth}" height="${height}" `);
    top += height;
    return placed;
  });
  return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${drawnWidth} ${top}">${inner.join("")}</svg>`;
}

/** What is taken away from a page whose result is not simply usable says so. */
function marked(drawing: string, words: string, theme: Theme): string {
  if (!words) return drawing;
  const [, width, height] = /viewBox="0 0 (\S+) (\S+)"/.exec(drawing)!;
  const top = 24;
  const all = Number(height) + top;
  const inner = drawing.replace("<svg ", `<svg y="${top}" width="${width}" height="${height}" `);
  const title = text(8, 16, words, theme.red, { "font-weight": 700, "font-size": 13 });
  return svg(Number(width), all, theme, words, title + inner);
}

/** The clip paths of one document need names of their own. */
let drawings = 0;

export function contentSvg(content: Content, theme: Theme): string {
  if ("charts" in content) {
    drawings += 1;
    return stacked(
      content.charts.map((spec) => chartSvg({ ...spec, name: `${spec.name} ${drawings}` }, theme, drawnWidth)),
    );
  }
  if ("mesh" in content) return meshSvg(content.mesh, theme, drawnWidth);
  return pairsSvg(content.pairs, theme);
}

function pairsSvg(pairs: Pairs, theme: Theme): string {
  drawings += 1;
  const context = new SvgContext(`pairs${drawings}_`);
  drawPairs(context as unknown as CanvasRenderingContext2D, { ...pairs, theme, width: drawnWidth, height: 400 });
  return context.document(drawnWidth, 400, theme, "Parameters, pair by pair");
}

/** The numbers of a figure, in the units of its axes. */
export function contentTable(content: Content): string {
  if ("charts" in content) return chartsTable(content.charts);
  if ("pairs" in content) return pairsTable(content.pairs.names, content.pairs.scales, content.pairs.points);
  const { points, value, sensors, units } = content.mesh;
  const rows: Cell[][] = points.map((p, i) => ["node", ...p, value?.[i]]);
  sensors?.forEach((s) => rows.push([s.words ?? "sensor", s.x, s.y, s.value]));
  return csv(["of", "x [m]", "y [m]", `value [${units || "–"}]`], rows);
}

function chartsTable(specs: readonly ChartSpec[]): string {
  const first = specs[0]!;
  const alike = specs.filter((s) => s.times.length === first.times.length);
  const columns = alike.flatMap((spec) =>
    spec.series.map((s) => ({
      name: `${spec.yLabel}: ${s.label}`,
      values: (s.said ?? s.values).map((v) => (typeof v === "number" ? v * (spec.factor ?? 1) : undefined)),
    })),
  );
  return csv(
    [first.xLabel, ...columns.map((c) => c.name)],
    first.times.map((t, i) => [t, ...columns.map((c) => c.values[i])]),
  );
}

async function pngOf(drawing: string): Promise<Blob> {
  const [, width, height] = /viewBox="0 0 (\S+) (\S+)"/.exec(drawing)!;
  const image = new Image();
  const sized = drawing.replace("<svg ", `<svg width="${width}" height="${height}" `);
  image.setAttribute("src", `data:image/svg+xml;charset=utf-8,${encodeURIComponent(sized)}`);
  await image.decode();
  const canvas = document.createElement("canvas");
  canvas.width = 2 * Number(width);
  canvas.height = 2 * Number(height);
  canvas.getContext("2d")!.drawImage(image, 0, 0, canvas.width, canvas.height);
  return blobOf(canvas);
}

interface Props {
  content: Content | undefined;
  theme: Theme;
  paper: Theme;
  /** Name of a file, title of a drawing. */
  name: string;
  /** The result, where it is not simply usable: saved figures say so. */
  worth: string;
  /** Time of the step that is looked at. */
  selected: number | undefined;
  onSelect: (time: number) => void;
  /** Somebody drew a line on a map. */
  onProbe: (probe: Probe) => void;
}

export function Figure({ content, theme, paper, name, worth, selected, onSelect, onProbe }: Props) {
  if (!content) return <p class="none">Nothing to draw here.</p>;
  const file = worth ? `${name} (${worth.replace(/^Result: /, "")})` : name;
  return (
    <>
      <span class="controls">
        <button
          type="button"
          aria-label={`${name}: save as SVG`}
          onClick={() =>
            save(new Blob([marked(contentSvg(content, paper), worth, paper)], { type: "image/svg+xml" }), `${file}.svg`)
          }
        >
          SVG
        </button>
        <button
          type="button"
          aria-label={`${name}: save as PNG`}
          onClick={() =>
            void pngOf(marked(contentSvg(content, theme), worth, theme)).then((blob) => save(blob, `${file}.png`))
          }
        >
          PNG
        </button>
        <button
          type="button"
          aria-label={`${name}: save as CSV`}
          onClick={() => saveText(contentTable(content), `${file}.csv`)}
        >
          CSV
        </button>
      </span>
      <div class="screen">
        {"charts" in content ? (
          content.charts.map((spec) => (
            <Chart
              key={spec.name}
              spec={spec}
              theme={theme}
              selected={spec.sync === "" ? undefined : selected}
              onSelect={spec.sync === "" ? nothing : onSelect}
            />
          ))
        ) : "mesh" in content ? (
          <Mesh spec={content.mesh} theme={theme} onProbe={onProbe} />
        ) : (
          <PairsView {...content} theme={theme} />
        )}
      </div>
      <Paper content={content} theme={paper} />
    </>
  );
}

const nothing = (): void => {};

/** What is printed: drawn once the screen has been. */
function Paper({ content, theme }: { content: Content; theme: Theme }) {
  const [drawing, setDrawing] = useState("");
  useEffect(() => {
    const low = (spec: ChartSpec): ChartSpec => ({ ...spec, height: paperHeight * (spec.height ?? 210) });
    const shown = "charts" in content ? { charts: content.charts.map(low) } : content;
    const draw = (): void => setDrawing(contentSvg(shown, theme));
    const timer = setTimeout(draw, 300);
    addEventListener("beforeprint", draw);
    return () => {
      clearTimeout(timer);
      removeEventListener("beforeprint", draw);
    };
  }, [content, theme]);
  return <div class="paper" aria-hidden="true" dangerouslySetInnerHTML={{ __html: drawing }} />;
}

function Mesh({ spec, theme, onProbe }: { spec: MeshSpec; theme: Theme; onProbe: (probe: Probe) => void }) {
  const [readout, setReadout] = useState("");
  const begun = useRef<[number, number] | undefined>(undefined);
  const drawing = useMemo(() => meshSvg(spec, theme, drawnWidth), [spec, theme]);
  const at = (event: PointerEvent): [number, number] => {
    const box = (event.currentTarget as HTMLElement).getBoundingClientRect();
    const view = meshView(spec, drawnWidth);
    // The drawing is as large as fits, in the middle.
    const scale = Math.max(drawnWidth / box.width, view.height / box.height);
    const left = box.left + (box.width - drawnWidth / scale) / 2;
    return view.from((event.clientX - left) * scale, (event.clientY - box.top) * scale);
  };
  const end = (event: PointerEvent): void => {
    const from = begun.current;
    const to = at(event);
    begun.current = undefined;
    if (from && (from[0] !== to[0] || from[1] !== to[1])) onProbe([...from, ...to]);
  };
  return (
    <>
      <div
        class={`mesh ${spec.probe ? "probed" : ""}`}
        onPointerMove={(e) => setReadout(meshReadout(spec, ...at(e)))}
        onPointerLeave={() => setReadout("")}
        {...(spec.probe ? { onPointerDown: (e: PointerEvent) => void (begun.current = at(e)), onPointerUp: end } : {})}
        dangerouslySetInnerHTML={{ __html: drawing }}
      />
      <p class="readout">{readout}</p>
    </>
  );
}

function PairsView({
  pairs,
  legend,
  theme,
}: {
  pairs: Pairs;
  legend: Parameters<typeof Legend>[0]["entries"];
  theme: Theme;
}) {
  const drawing = useMemo(() => pairsSvg(pairs, theme), [pairs, theme]);
  return (
    <>
      <Legend entries={legend} theme={theme} />
      <div class="mesh" dangerouslySetInnerHTML={{ __html: drawing }} />
    </>
  );
}
