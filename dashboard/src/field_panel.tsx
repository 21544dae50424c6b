/** The field on the mesh, with the sensors. */
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { fit, front, oblique, project, type Camera, type Vec3, type Viewport } from "./camera";
import type { Theme } from "./colour";
import { fieldTable, sensorsTable } from "./csv";
import { quantitiesOf, viewOf } from "./field";
import { drawOverlay, foot, type Marker } from "./field_overlay";
import { scaleFor, significant } from "./format";
import { boxOf, displayFactor, surfaceOf, type Component } from "./mesh";
import { MeshView } from "./mesh_view";
import { Panel } from "./panel";
import { blobOf } from "./png";
import type { Detail } from "./store";
import type { FieldsAnswer, Model, SensorsAnswer } from "./types";

interface Props {
  model: Model | undefined;
  fields: Detail<FieldsAnswer>;
  sensors: Detail<SensorsAnswer>;
  theme: Theme;
  quantity: string;
  setQuantity: (quantity: string) => void;
}

export function FieldPanel({ model, fields, sensors, theme, quantity, setQuantity }: Props) {
  const mesh = model?.mesh;
  const [component, setComponent] = useState<Component>("magnitude");
  const [deformed, setDeformed] = useState(true);
  const [edges, setEdges] = useState(true);
  const [camera, setCamera] = useState<Camera>(front);
  const [size, setSize] = useState({ width: 600, height: 300 });
  const [problem, setProblem] = useState<string>();
  const [readout, setReadout] = useState("");
  /** Grows when a new WebGL context has nothing drawn yet. */
  const [drawings, setDrawings] = useState(0);
  const frame = useRef<HTMLDivElement>(null);
  const picture = useRef<HTMLCanvasElement>(null);
  const overlay = useRef<HTMLCanvasElement>(null);
  const view = useRef<MeshView | undefined>(undefined);

  const surface = useMemo(() => mesh && surfaceOf(mesh), [mesh]);
  const box = useMemo(() => mesh && boxOf(mesh.points), [mesh]);
  const shown = useMemo(
    () => viewOf(quantity, component, fields.value, sensors.value, model?.sensors?.std ?? []),
    [quantity, component, fields.value, sensors.value, model],
  );
  const factor = deformed && fields.value && box ? displayFactor(fields.value.displacement, box) : 0;
  const nearest = useMemo(() => nearestPoints(model), [model]);
  const viewport: Viewport = { ...size, foot };
  const pixelsPerMetre = box ? fit(box, { ...camera, zoom: 1 }, viewport) : 1;

  useEffect(() => {
    if (!mesh || !surface) return;
    const canvas = picture.current!;
    const make = (): void => {
      try {
        view.current = new MeshView(canvas);
        view.current.setMesh(mesh.points, surface);
        setProblem(undefined);
      } catch (error) {
        setProblem(`The field is not drawn: ${(error as Error).message}.`);
      }
    };
    make();
    setDrawings((n) => n + 1);
    const restored = (): void => (make(), setDrawings((n) => n + 1));
    const lost = (event: Event): void => event.preventDefault();
    canvas.addEventListener("webglcontextlost", lost);
    canvas.addEventListener("webglcontextrestored", restored);
    const observer = new ResizeObserver(() =>
      setSize({ width: frame.current!.clientWidth, height: frame.current!.clientHeight }),
    );
    observer.observe(frame.current!);
    return () => {
      observer.disconnect();
      canvas.removeEventListener("webglcontextlost", lost);
      canvas.removeEventListener("webglcontextrestored", restored);
    };
  }, [mesh, surface]);

  const displaced = (point: Vec3, node: number | undefined): Vec3 => {
    const u = node === undefined ? undefined : fields.value?.displacement[node];
    return u ? (point.map((x, k) => x + factor * (u[k] ?? 0)) as Vec3) : point;
  };
  const toPixel = (point: Vec3): Vec3 => project(point, box!, camera, viewport, pixelsPerMetre);
  const markers: Marker[] = !box
    ? []
    : (model?.sensors?.points ?? []).map((point, i) => {
        const [x, y] = toPixel(displaced(point as Vec3, nearest[i]));
        return {
          x,
          y,
          component: model!.sensors!.components[i] ?? "x",
          status: sensors.value?.status[i] ?? "used",
          value: shown.sensors?.[i],
          normal: shown.sensors === undefined,
        };
      });

  useEffect(() => {
    const gl = view.current;
    if (!gl || !box) return;
    const ratio = devicePixelRatio;
    for (const canvas of [picture.current!, overlay.current!]) {
      if (canvas.width !== Math.round(size.width * ratio)) canvas.width = Math.round(size.width * ratio);
      if (canvas.height !== Math.round(size.height * ratio)) canvas.height = Math.round(size.height * ratio);
    }
    if (fields.value) gl.setDisplacement(fields.value.displacement);
    if (shown.nodes) gl.setValues(shown.nodes);
    gl.draw({
      camera,
      view: viewport,
      pixelsPerMetre,
      box,
      factor,
      edges,
      theme,
      ...(shown.nodes ? { colouring: { range: shown.range, map: shown.map } } : {}),
    });
    drawOverlay(overlay.current!, {
      markers,
      shown,
      theme,
      viewport,
      ratio,
      camera,
      pixelsPerMetre: pixelsPerMetre * camera.zoom,
    });
  }, [surface, shown, fields.value, sensors.value, camera, size, theme, factor, edges, drawings]);

  const point = (event: PointerEvent): void => {
    const bounds = frame.current!.getBoundingClientRect();
    const at = [event.clientX - bounds.left, event.clientY - bounds.top] as const;
    setReadout(
      under(at, {
        model,
        fields: fields.value,
        sensors: sensors.value,
        markers,
        shown,
        pixel: (node) => toPixel(displaced(mesh!.points[node] as Vec3, node)),
        nodes: surface?.nodes,
      }),
    );
  };
  const drag = (event: PointerEvent): void => {
    if (!event.buttons) return point(event);
    const { movementX: dx, movementY: dy } = event;
    const pan = event.shiftKey || event.buttons === 2;
    setCamera((c) =>
      pan
        ? { ...c, shift: [c.shift[0] + dx, c.shift[1] + dy] }
        : { ...c, yaw: c.yaw + dx * 0.008, pitch: Math.max(-1.57, Math.min(1.57, c.pitch + dy * 0.008)) },
    );
  };
  const zoom = (by: number): void => setCamera((c) => ({ ...c, zoom: Math.max(0.3, Math.min(30, c.zoom * by)) }));
  const wheel = (event: WheelEvent): void => {
    if (!event.ctrlKey && document.activeElement !== frame.current) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * 0.0015));
  };
  const counts = countWords(sensors.value);
  const step = quantity === "residual" ? sensors.value?.step : fields.value?.step;
  const title = `Field on the structure${step === undefined ? "" : `, step ${step}`}`;
  const none = !mesh ? "The model of this site has no mesh." : (problem ?? fields.problem ?? shown.problem);
  const values =
    quantity === "displacement" ? fields.value?.displacement : fields.value?.sensitivity[quantity.split(":")[1] ?? ""];
  return (
    <Panel
      id="field"
      title={title}
      span="wide"
      png={() => compose(picture.current!, overlay.current!, theme, title)}
      csv={() =>
        shown.sensors && sensors.value && model?.sensors
          ? sensorsTable(sensors.value, model.sensors)
          : values && mesh
            ? fieldTable(quantity.replace(":", "_"), values, mesh)
            : undefined
      }
      controls={
        <>
          <select aria-label="Field" value={quantity} onChange={(e) => setQuantity(e.currentTarget.value)}>
            {quantitiesOf(model?.parameters.map((p) => p.name) ?? []).map((q) => (
              <option key={q.value} value={q.value}>
                {q.label}
              </option>
            ))}
          </select>
          {!shown.sensors && (
            <select
              aria-label="Component"
              value={component}
              onChange={(e) => setComponent(e.currentTarget.value as Component)}
            >
              {["magnitude", "x", "y", "z"].map((c) => (
                <option key={c} value={c}>
                  {c}
                </option>
              ))}
            </select>
          )}
        </>
      }
    >
      <div
        class="field"
        ref={frame}
        tabIndex={0}
        role="img"
        aria-label={`${shown.label} on the structure. ${counts}`}
        onPointerDown={(e) => e.currentTarget.setPointerCapture(e.pointerId)}
        onPointerMove={drag}
        onPointerLeave={() => setReadout("")}
        onWheel={wheel}
        onContextMenu={(e) => e.preventDefault()}
      >
        <canvas ref={picture} />
        <canvas ref={overlay} />
        {none && <p class="none">{none}</p>}
      </div>
      <div class="under">
        <label>
          <input type="checkbox" checked={deformed} onChange={(e) => setDeformed(e.currentTarget.checked)} /> deformed
          {factor ? `, ${factor} × larger` : ""}
        </label>
        <label>
          <input type="checkbox" checked={edges} onChange={(e) => setEdges(e.currentTarget.checked)} /> elements
        </label>
        <span class="buttons">
          <button type="button" aria-label="Larger" title="Larger" onClick={() => zoom(1.25)}>
            +
          </button>
          <button type="button" aria-label="Smaller" title="Smaller" onClick={() => zoom(0.8)}>
            −
          </button>
          <button type="button" onClick={() => setCamera(front)}>
            front
          </button>
          <button type="button" onClick={() => setCamera(oblique)}>
            oblique
          </button>
        </span>
        <span class="readout">{readout.trim() || counts}</span>
      </div>
    </Panel>
  );
}

function countWords(sensors: SensorsAnswer | undefined): string {
  if (!sensors) return "";
  const count = (word: string): number => sensors.status.filter((s) => s === word).length;
  return `Sensors: ${count("used")} used, ${count("rejected")} rejected, ${count("missing")} missing`;
}

/** Mesh point of each sensor, to move it with the structure. */
function nearestPoints(model: Model | undefined): number[] {
  const points = model?.mesh?.points ?? [];
  return (model?.sensors?.points ?? []).map((s) => {
    let best = 0;
    let least = Infinity;
    points.forEach((p, i) => {
      const d = (p[0]! - s[0]!) ** 2 + (p[1]! - s[1]!) ** 2 + (p[2]! - s[2]!) ** 2;
      if (d < least) [best, least] = [i, d];
    });
    return best;
  });
}

interface Under {
  model: Model | undefined;
  fields: FieldsAnswer | undefined;
  sensors: SensorsAnswer | undefined;
  markers: Marker[];
  shown: ReturnType<typeof viewOf>;
  pixel: (node: number) => Vec3;
  nodes: Uint32Array | undefined;
}

/** In words, what is under the pointer: a sensor if there is one, else the value at the closest mesh point. */
function under(at: readonly [number, number], u: Under): string {
  let best = -1;
  let least = 10;
  u.markers.forEach((m, i) => {
    const d = Math.hypot(m.x - at[0], m.y - at[1]);
    if (d < least) [best, least] = [i, d];
  });
  const place = (p: readonly number[] | undefined): string => (p ?? []).map((x) => significant(x * 1000, 3)).join(", ");
  if (best >= 0 && u.sensors) {
    const residual = u.sensors.residual?.[best];
    const std = u.model?.sensors?.std[best] ?? NaN;
    const reason = u.sensors.reason[best];
    const head = `Sensor ${best} (u${u.markers[best]!.component} at ${place(u.model?.sensors?.points[best])} mm): ${u.sensors.status[best]}${reason ? ` (${reason})` : ""}`;
    if (residual === undefined) return head;
    const scale = scaleFor("m", Math.abs(residual));
    return `${head}; measured − predicted ${significant(residual * scale.factor)} ${scale.units}${Number.isFinite(std) ? `, ${significant(residual / std, 2)} standard deviations of the noise` : ""}`;
  }
  if (!u.shown.nodes || !u.nodes) return "";
  least = 14;
  let depth = -Infinity;
  for (const node of u.nodes) {
    const [x, y, z] = u.pixel(node);
    const d = Math.hypot(x - at[0], y - at[1]);
    if (d < least - 1 || (d < least + 1 && z > depth)) [best, least, depth] = [node, d, z];
  }
  if (best < 0) return "";
  return `${u.shown.label}: ${significant(u.shown.nodes[best]! * u.shown.scale.factor, 4)} ${u.shown.scale.units} at (${place(u.model?.mesh?.points[best])}) mm`;
}

function compose(picture: HTMLCanvasElement, overlay: HTMLCanvasElement, theme: Theme, title: string): Promise<Blob> {
  const canvas = document.createElement("canvas");
  const top = 34 * devicePixelRatio;
  canvas.width = picture.width;
  canvas.height = picture.height + top;
  const ctx = canvas.getContext("2d")!;
  ctx.fillStyle = theme.panel;
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.fillStyle = theme.text;
  ctx.font = `600 ${14 * devicePixelRatio}px system-ui, sans-serif`;
  ctx.fillText(title, 10 * devicePixelRatio, 22 * devicePixelRatio);
  ctx.drawImage(picture, 0, top);
  ctx.drawImage(overlay, 0, top);
  return blobOf(canvas);
}
