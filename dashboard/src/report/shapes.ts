/** A face as a field moves it. Pure. */
import type { Content } from "./content";
import type { Field } from "./record";

/** Drawn displacements are exaggerated so that the largest is 3 % of the structure's length. */
const drawnSize = 0.03;

export interface Face {
  points: [number, number][];
  cells: number[][];
}
type Moved = Pick<Field, "x" | "y">;

export function exaggeration(s: Face, f: Moved): number {
  const xs = s.points.map((p) => p[0]);
  const size = xs.reduce((a, b) => Math.max(a, b), -Infinity) - xs.reduce((a, b) => Math.min(a, b), Infinity);
  const largest = [...f.x, ...f.y].reduce((a, b) => Math.max(a, Math.abs(b)), 0);
  return largest > 0 ? (drawnSize * size) / largest : 0;
}

export function deformed(s: Face, f: Moved): { x: number[]; y: number[] } {
  const by = exaggeration(s, f);
  return { x: f.x.map((v) => v * by), y: f.y.map((v) => v * by) };
}

/** Its horizontal component, on the face as the field moves it. */
export function shape(s: Face | undefined, f: Field | undefined, label: string, units: string): Content | undefined {
  if (!s || !f) return undefined;
  return {
    mesh: {
      title: f.title,
      points: s.points,
      cells: s.cells,
      value: f.x,
      shift: deformed(s, f),
      label,
      units,
      signed: true,
    },
  };
}
