/** Orthographic view of a structure: turn, shift, zoom. Pure. */
import type { Box } from "./mesh";

export type Vec3 = [number, number, number];

export interface Camera {
  /** Turn about the vertical, then nod, radians. (0, 0) looks along −z: x to the right, y up. */
  yaw: number;
  pitch: number;
  zoom: number;
  /** In pixels. */
  shift: [number, number];
}

export const front: Camera = { yaw: 0, pitch: 0, zoom: 1, shift: [0, 0] };
export const oblique: Camera = { yaw: -0.5, pitch: 0.4, zoom: 1, shift: [0, 0] };

/** Rows of the rotation: right, up, toward the viewer. */
export function rotation({ yaw, pitch }: Camera): [Vec3, Vec3, Vec3] {
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  const [d, t] = [Math.cos(pitch), Math.sin(pitch)];
  return [
    [c, 0, s],
    [t * s, d, -t * c],
    [-d * s, t, d * c],
  ];
}

export interface Viewport {
  width: number;
  height: number;
  /** Kept free at the bottom, for the colour bar. */
  foot: number;
}

/** Pixels per metre with which the box, as turned, fills the viewport. */
export function fit(box: Box, camera: Camera, view: Viewport): number {
  const [right, up] = rotation(camera);
  const half = box.high.map((h, k) => (h - box.low[k]!) / 2);
  const extent = (axis: Vec3): number => axis.reduce((sum, a, k) => sum + Math.abs(a) * half[k]!, 0) || box.radius;
  const margin = 1.14;
  return Math.min(view.width / (2 * extent(right) * margin), (view.height - view.foot) / (2 * extent(up) * margin));
}

/** Pixel coordinates (y down) and depth (toward the viewer, m). */
export function project(point: Vec3, box: Box, camera: Camera, view: Viewport, pixelsPerMetre: number): Vec3 {
  const [right, up, out] = rotation(camera);
  const p = point.map((v, k) => v - box.centre[k]!) as Vec3;
  const dot = (a: Vec3): number => a[0] * p[0] + a[1] * p[1] + a[2] * p[2];
  const scale = pixelsPerMetre * camera.zoom;
  return [
    view.width / 2 + scale * dot(right) + camera.shift[0],
    (view.height - view.foot) / 2 - scale * dot(up) + camera.shift[1],
    dot(out),
  ];
}

/** A round length that is some `pixels` long. */
export function roundLength(pixels: number, pixelsPerMetre: number): number {
  const wanted = pixels / pixelsPerMetre;
  const decade = 10 ** Math.floor(Math.log10(wanted));
  return decade * (wanted / decade >= 5 ? 5 : wanted / decade >= 2 ? 2 : 1);
}

/** The next of 1, 1.5, 2, 3, 5, 7, 10 × a power of ten: colour bars that do not flicker with every step. */
export function roundUp(value: number): number {
  if (!(value > 0) || !Number.isFinite(value)) return 1;
  const decade = 10 ** Math.floor(Math.log10(value));
  const next = [1, 1.5, 2, 3, 5, 7, 10].find((m) => value / decade <= m * (1 + 1e-9)) ?? 10;
  return next * decade;
}
