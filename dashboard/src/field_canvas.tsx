/** The canvases of the field: the mesh with WebGL2, over it the sensors; turned and enlarged with the pointer. */
import type { RefObject } from "preact";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { fit, project, type Camera, type Vec3, type Viewport } from "./camera";
import type { Theme } from "./colour";
import type { View } from "./field";
import { drawOverlay, foot, type Marker } from "./field_overlay";
import { nearestPoints, under } from "./field_words";
import type { Box, Surface } from "./mesh";
import { MeshView } from "./mesh_view";
import { drawPicture, throughPicture } from "./picture";
import type { FieldsAnswer, Mesh, Model, SensorsAnswer } from "./types";

export interface Geometry {
  mesh: Mesh;
  surface: Surface;
  box: Box;
}

interface Props {
  model: Model | undefined;
  geometry: Geometry | undefined;
  shown: View;
  fields: FieldsAnswer | undefined;
  sensors: SensorsAnswer | undefined;
  /** Displacements are drawn this much larger; 0: not at all. */
  factor: number;
  edges: boolean;
  camera: Camera;
  setCamera: (change: (camera: Camera) => Camera) => void;
  theme: Theme;
  label: string;
  /** Why there is nothing to see. */
  problem: string | undefined;
  setReadout: (text: string) => void;
  picture: RefObject<HTMLCanvasElement | null>;
  overlay: RefObject<HTMLCanvasElement | null>;
  /** What lies behind the structure. */
  image: ImageBitmap | undefined;
  ground: RefObject<HTMLCanvasElement | null>;
}

export function FieldCanvas(p: Props) {
  const { geometry, shown, fields, sensors, camera, factor, theme } = p;
  const frame = useRef<HTMLDivElement>(null);
  const size = useSize(frame);
  const { view, problem, drawings } = useMeshView(geometry, p.picture);
  const nearest = useMemo(() => nearestPoints(p.model), [p.model]);
  const viewport: Viewport = { ...size, foot };
  const pixelsPerMetre = geometry ? fit(geometry.box, { ...camera, zoom: 1 }, viewport) : 1;
  const pixel = (point: Vec3, node: number | undefined): Vec3 => {
    const u = node === undefined ? undefined : fields?.displacement[node];
    const displaced = u ? (point.map((x, k) => x + factor * (u[k] ?? 0)) as Vec3) : point;
    return project(displaced, geometry!.box, camera, viewport, pixelsPerMetre);
  };
  const markers = geometry ? markersOf(p, (point, i) => pixel(point, nearest[i])) : [];

  useEffect(() => {
    if (!view || !geometry) return;
    const ratio = devicePixelRatio;
    for (const canvas of [p.ground.current!, p.picture.current!, p.overlay.current!])
      resize(canvas, size.width * ratio, size.height * ratio);
    const corners = (p.model?.picture?.corners ?? []).map((c) => pixel(c as Vec3, undefined));
    drawPicture(p.ground.current!, p.image, corners, ratio);
    if (fields) view.setDisplacement(fields.displacement);
    if (shown.nodes) view.setValues(shown.nodes);
    const colouring = shown.nodes ? { colouring: { range: shown.range, map: shown.map } } : {};
    const { box } = geometry;
    view.draw({ camera, view: viewport, pixelsPerMetre, box, factor, edges: p.edges, theme, ...colouring });
    const scale = pixelsPerMetre * camera.zoom;
    drawOverlay(p.overlay.current!, { markers, shown, theme, viewport, ratio, camera, pixelsPerMetre: scale });
  }, [view, geometry, shown, fields, sensors, camera, size, theme, factor, p.edges, drawings, p.image]);

  const move = (event: PointerEvent): void => {
    if (event.buttons) return p.setCamera((c) => dragged(c, event));
    const bounds = frame.current!.getBoundingClientRect();
    const { model, setReadout } = p;
    const node = (k: number): Vec3 => pixel(geometry!.mesh.points[k] as Vec3, k);
    const at = [event.clientX - bounds.left, event.clientY - bounds.top] as const;
    setReadout(under(at, { model, sensors, markers, shown, pixel: node, nodes: geometry?.surface.nodes }));
  };
  const wheel = (event: WheelEvent): void => {
    if (!event.ctrlKey && document.activeElement !== frame.current) return;
    event.preventDefault();
    p.setCamera((c) => zoomed(c, Math.exp(-event.deltaY * 0.0015)));
  };
  const none = p.problem ?? problem;
  return (
    <div
      class="field"
      ref={frame}
      tabIndex={0}
      role="img"
      aria-label={p.label}
      onPointerDown={(e) => e.currentTarget.setPointerCapture(e.pointerId)}
      onPointerMove={move}
      onPointerLeave={() => p.setReadout("")}
      onWheel={wheel}
      onContextMenu={(e) => e.preventDefault()}
    >
      <canvas ref={p.picture} style={{ opacity: p.image ? throughPicture : 1 }} />
      <canvas ref={p.overlay} />
      <canvas class="ground" ref={p.ground} />
      {none && <p class="none">{none}</p>}
    </div>
  );
}

export function zoomed(camera: Camera, by: number): Camera {
  return { ...camera, zoom: Math.max(0.3, Math.min(30, camera.zoom * by)) };
}

/** Turns; with Shift or the right button shifts. */
function dragged(c: Camera, { movementX: dx, movementY: dy, shiftKey, buttons }: PointerEvent): Camera {
  if (shiftKey || buttons === 2) return { ...c, shift: [c.shift[0] + dx, c.shift[1] + dy] };
  return { ...c, yaw: c.yaw + dx * 0.008, pitch: Math.max(-1.57, Math.min(1.57, c.pitch + dy * 0.008)) };
}

function markersOf({ model, sensors, shown }: Props, pixel: (point: Vec3, sensor: number) => Vec3): Marker[] {
  return (model?.sensors?.points ?? []).map((point, i) => {
    const [x, y] = pixel(point as Vec3, i);
    const component = model!.sensors!.components[i] ?? "x";
    const status = sensors?.status[i] ?? "used";
    return { x, y, component, status, value: shown.sensors?.[i], normal: shown.sensors === undefined };
  });
}

function resize(canvas: HTMLCanvasElement, width: number, height: number): void {
  if (canvas.width !== Math.round(width)) canvas.width = Math.round(width);
  if (canvas.height !== Math.round(height)) canvas.height = Math.round(height);
}

function useSize(frame: RefObject<HTMLElement | null>): { width: number; height: number } {
  const [size, setSize] = useState({ width: 600, height: 300 });
  useEffect(() => {
    const element = frame.current!;
    const observer = new ResizeObserver(() => setSize({ width: element.clientWidth, height: element.clientHeight }));
    observer.observe(element);
    return () => observer.disconnect();
  }, []);
  return size;
}

/** A view of the mesh, made again when the graphics card has lost it; `drawings` grows when nothing is drawn yet. */
function useMeshView(geometry: Geometry | undefined, picture: RefObject<HTMLCanvasElement | null>) {
  const [state, setState] = useState<{ view?: MeshView; problem?: string; drawings: number }>({ drawings: 0 });
  useEffect(() => {
    if (!geometry) return;
    const canvas = picture.current!;
    const make = (): void => {
      try {
        const view = new MeshView(canvas);
        view.setMesh(geometry.mesh.points, geometry.surface);
        setState(({ drawings }) => ({ view, drawings: drawings + 1 }));
      } catch (error) {
        setState({ problem: `The field is not drawn: ${(error as Error).message}.`, drawings: 0 });
      }
    };
    make();
    const lost = (event: Event): void => event.preventDefault();
    canvas.addEventListener("webglcontextlost", lost);
    canvas.addEventListener("webglcontextrestored", make);
    return () => {
      canvas.removeEventListener("webglcontextlost", lost);
      canvas.removeEventListener("webglcontextrestored", make);
    };
  }, [geometry]);
  return { view: state.view, problem: state.problem, drawings: state.drawings };
}
