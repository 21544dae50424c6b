/** Over the mesh: sensors, colour bar, axes, length scale. */
import { rotation, roundLength, type Camera, type Viewport } from "./camera";
import { colourAt, rgb, through, type Theme } from "./colour";
import type { View } from "./field";
import { significant } from "./format";

export const foot = 58;

export interface Marker {
  x: number;
  y: number;
  component: string;
  status: string;
  /** To be shown as a colour. */
  value: number | undefined;
  /** Sensors are only shown, not coloured by a value. */
  normal: boolean;
}

interface Overlay {
  markers: Marker[];
  shown: View;
  theme: Theme;
  viewport: Viewport;
  ratio: number;
  camera: Camera;
  pixelsPerMetre: number;
}

export function drawOverlay(canvas: HTMLCanvasElement, o: Overlay): void {
  const ctx = canvas.getContext("2d")!;
  ctx.setTransform(o.ratio, 0, 0, o.ratio, 0, 0);
  ctx.clearRect(0, 0, o.viewport.width, o.viewport.height);
  for (const marker of o.markers) drawMarker(ctx, marker, o);
  if (o.shown.label) drawBar(ctx, o);
  drawAxes(ctx, o);
  drawKey(ctx, o);
}

/** Triangles point along the component that a sensor measures; shapes, not only colours, tell used from rejected and missing. */
function drawMarker(ctx: CanvasRenderingContext2D, m: Marker, { shown, theme, viewport }: Overlay): void {
  const [dx, dy] = m.component === "x" ? [1, 0] : m.component === "y" ? [0, -1] : [0, 0];
  ctx.save();
  // Smaller on a small screen, so that they do not hide the structure.
  const scale = Math.min(1, Math.max(0.55, viewport.width / 650));
  ctx.translate(m.x + 5 * scale * dx, m.y + 5 * scale * dy);
  ctx.scale(scale, scale);
  const size = m.normal ? 4 : 5.5;
  ctx.lineWidth = 1.2;
  if (m.status === "rejected") {
    cross(ctx, 5, theme);
  } else {
    ctx.rotate(dx ? 0 : -Math.PI / 2);
    ctx.beginPath();
    if (dx || dy) {
      ctx.moveTo(size * 1.2, 0);
      ctx.lineTo(-size * 0.7, size * 0.85);
      ctx.lineTo(-size * 0.7, -size * 0.85);
      ctx.closePath();
    } else ctx.arc(0, 0, size * 0.8, 0, 7);
    if (m.status === "missing") {
      ctx.fillStyle = theme.panel;
      ctx.fill();
      ctx.strokeStyle = theme.text;
      ctx.setLineDash([2, 1.5]);
      ctx.stroke();
    } else {
      const { low, high } = shown.range;
      ctx.fillStyle =
        m.normal || m.value === undefined ? "#ffffff" : rgb(colourAt(shown.map, (m.value - low) / (high - low)));
      ctx.fill();
      ctx.strokeStyle = "#10161d";
      ctx.stroke();
    }
  }
  ctx.restore();
}

function cross(ctx: CanvasRenderingContext2D, size: number, theme: Theme): void {
  for (const [width, colour] of [
    [4.5, theme.panel],
    [2.4, theme.red],
  ] as const) {
    ctx.lineWidth = width;
    ctx.strokeStyle = colour;
    ctx.beginPath();
    ctx.moveTo(-size, -size);
    ctx.lineTo(size, size);
    ctx.moveTo(size, -size);
    ctx.lineTo(-size, size);
    ctx.stroke();
  }
}

function drawBar(ctx: CanvasRenderingContext2D, { shown, theme, viewport }: Overlay): void {
  const width = Math.min(260, viewport.width * 0.5);
  const [x, y, height] = [12, viewport.height - 32, 10];
  for (let i = 0; i < width; i += 1) {
    ctx.fillStyle = rgb(colourAt(shown.map, i / (width - 1)));
    ctx.fillRect(x + i, y, 1.5, height);
  }
  ctx.strokeStyle = theme.faint;
  ctx.lineWidth = 1;
  ctx.strokeRect(x + 0.5, y + 0.5, width, height);
  ctx.fillStyle = theme.text;
  ctx.font = "12px system-ui, sans-serif";
  ctx.textAlign = "left";
  ctx.fillText(shown.scale.units ? `${shown.label} [${shown.scale.units}]` : shown.label, x, y - 6);
  const { low, high } = shown.range;
  const number = (v: number): string =>
    significant(v * shown.scale.factor, 3)
      .replace(/(\.\d*?)0+$/, "$1")
      .replace(/\.$/, "");
  ctx.fillText(number(low), x, y + 24);
  ctx.textAlign = "center";
  ctx.fillText(number((low + high) / 2), x + width / 2, y + 24);
  ctx.textAlign = "right";
  ctx.fillText(number(high), x + width, y + 24);
}

/** A length to compare with, and the directions of the axes. */
function drawAxes(ctx: CanvasRenderingContext2D, { theme, viewport, camera, pixelsPerMetre }: Overlay): void {
  const length = roundLength(90, pixelsPerMetre);
  const pixels = length * pixelsPerMetre;
  const right = viewport.width - 12;
  const y = viewport.height - 14;
  ctx.fillStyle = through(theme.panel, 0.8);
  ctx.fillRect(0, 0, 82, 60);
  ctx.strokeStyle = theme.text;
  ctx.fillStyle = theme.text;
  ctx.lineWidth = 1.5;
  ctx.font = "12px system-ui, sans-serif";
  ctx.beginPath();
  ctx.moveTo(right - pixels, y - 4);
  ctx.lineTo(right - pixels, y);
  ctx.lineTo(right, y);
  ctx.lineTo(right, y - 4);
  ctx.stroke();
  ctx.textAlign = "center";
  ctx.fillText(
    length < 1 ? `${significant(length * 1000, 1)} mm` : `${significant(length, 1)} m`,
    right - pixels / 2,
    y - 6,
  );
  const origin = [36, 46] as const;
  const [r, u] = rotation(camera);
  "xyz".split("").forEach((name, k) => {
    const [dx, dy] = [26 * r[k]!, -26 * u[k]!];
    if (Math.hypot(dx, dy) < 5) return;
    ctx.beginPath();
    ctx.moveTo(...origin);
    ctx.lineTo(origin[0] + dx, origin[1] + dy);
    ctx.stroke();
    ctx.fillText(name, origin[0] + dx * 1.35, origin[1] + dy * 1.35 + 4);
  });
}

function drawKey(ctx: CanvasRenderingContext2D, o: Overlay): void {
  if (o.markers.length === 0) return;
  const entries: [string, string][] = [
    ["used", "sensor used"],
    ["rejected", "rejected"],
    ["missing", "missing"],
  ];
  ctx.font = "12px system-ui, sans-serif";
  let x = o.viewport.width - 12;
  // Readable over a picture too.
  const width = entries.reduce((sum, [, words]) => sum + ctx.measureText(words).width + 28, 0);
  ctx.fillStyle = through(o.theme.panel, 0.8);
  ctx.fillRect(x - width, 0, width + 6, 24);
  for (const [status, words] of entries.reverse()) {
    ctx.textAlign = "right";
    ctx.fillStyle = o.theme.text;
    ctx.fillText(words, x, 16);
    x -= ctx.measureText(words).width + 12;
    drawMarker(ctx, { x: x - 5, y: 12, component: "x", status, value: undefined, normal: true }, o);
    x -= 16;
  }
}
