/** Surface of a mesh, and what is drawn on it. Pure. */
import type { Mesh } from "./types";

/** Faces by corner, outward for VTK's order of the corners. */
const faces: Record<string, number[][]> = {
  triangle: [[0, 1, 2]],
  quad: [[0, 1, 2, 3]],
  tetra: [
    [0, 2, 1],
    [0, 1, 3],
    [1, 2, 3],
    [0, 3, 2],
  ],
  hexahedron: [
    [0, 3, 2, 1],
    [4, 5, 6, 7],
    [0, 1, 5, 4],
    [1, 2, 6, 5],
    [2, 3, 7, 6],
    [3, 0, 4, 7],
  ],
  wedge: [
    [0, 1, 2],
    [3, 5, 4],
    [0, 3, 4, 1],
    [1, 4, 5, 2],
    [2, 5, 3, 0],
  ],
  pyramid: [
    [0, 3, 2, 1],
    [0, 1, 4],
    [1, 2, 4],
    [2, 3, 4],
    [3, 0, 4],
  ],
};

/** VTK's names, as in a file's `VTK_HEXAHEDRON` or meshio's `hexahedron20`: of higher orders the corners are drawn. */
export function shapeOf(type: string): string {
  const plain = type
    .toLowerCase()
    .replace(/^vtk_/, "")
    .replace(/^(bi|tri)?quadratic_/, "")
    .replace(/[0-9]+$/, "");
  return plain === "tetrahedron" ? "tetra" : plain === "hexa" ? "hexahedron" : plain;
}

export interface Surface {
  /** Node indices, three per triangle. */
  triangles: Uint32Array;
  /** Node indices, two per edge of a face (diagonals of quadrilaterals are none). */
  edges: Uint32Array;
  /** Nodes on the surface. */
  nodes: Uint32Array;
}

/** Faces that belong to one cell only. Of an unknown type of cells nothing is drawn. */
export function surfaceOf(mesh: Mesh): Surface {
  const seen = new Map<string, number[] | undefined>();
  for (const cell of mesh.cells) {
    for (const face of faces[shapeOf(mesh.type)] ?? []) {
      const corners = face.map((k) => cell[k]!);
      const key = [...corners].sort((a, b) => a - b).join(",");
      seen.set(key, seen.has(key) ? undefined : corners);
    }
  }
  const triangles: number[] = [];
  const edges = new Map<string, [number, number]>();
  const nodes = new Set<number>();
  for (const face of seen.values()) {
    if (!face) continue;
    face.forEach((a, k) => {
      const b = face[(k + 1) % face.length]!;
      nodes.add(a);
      edges.set(a < b ? `${a},${b}` : `${b},${a}`, [a, b]);
    });
    for (let k = 2; k < face.length; k += 1) triangles.push(face[0]!, face[k - 1]!, face[k]!);
  }
  return {
    triangles: Uint32Array.from(triangles),
    edges: Uint32Array.from([...edges.values()].flat()),
    nodes: Uint32Array.from(nodes),
  };
}

export interface Box {
  centre: [number, number, number];
  /** Half of the diagonal. */
  radius: number;
  low: number[];
  high: number[];
}

export function boxOf(points: readonly number[][]): Box {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (const p of points)
    for (let k = 0; k < 3; k += 1) {
      low[k] = Math.min(low[k]!, p[k] ?? 0);
      high[k] = Math.max(high[k]!, p[k] ?? 0);
    }
  const centre = [0, 1, 2].map((k) => (low[k]! + high[k]!) / 2) as [number, number, number];
  return { centre, radius: Math.hypot(...[0, 1, 2].map((k) => (high[k]! - low[k]!) / 2)) || 1, low, high };
}

export type Component = "magnitude" | "x" | "y" | "z";

/** One number per node: length of the vector, or one component. */
export function scalars(values: readonly number[][], component: Component): Float32Array {
  const k = component === "magnitude" ? -1 : "xyz".indexOf(component);
  return Float32Array.from(values, (v) => (k < 0 ? Math.hypot(v[0] ?? 0, v[1] ?? 0, v[2] ?? 0) : (v[k] ?? 0)));
}

export interface Range {
  low: number;
  high: number;
}

/** Of what has a sign: symmetric about 0, so that white is 0. */
export function rangeOf(values: ArrayLike<number>, hasSign: boolean): Range {
  let low = Infinity;
  let high = -Infinity;
  for (let i = 0; i < values.length; i += 1) {
    const v = values[i]!;
    if (v < low) low = v;
    if (v > high) high = v;
  }
  if (!Number.isFinite(low)) return { low: 0, high: 1 };
  if (hasSign) {
    const largest = Math.max(Math.abs(low), Math.abs(high)) || 1;
    return { low: -largest, high: largest };
  }
  return { low: Math.min(0, low), high: high > Math.min(0, low) ? high : Math.min(0, low) + 1 };
}

/** A round factor that draws the largest displacement as some 6 % of the structure's size. */
export function displayFactor(displacement: readonly number[][], box: Box): number {
  const largest = rangeOf(scalars(displacement, "magnitude"), false).high;
  const wanted = (0.12 * box.radius) / largest;
  if (!Number.isFinite(wanted) || wanted <= 0) return 1;
  const decade = 10 ** Math.floor(Math.log10(wanted));
  return Math.max(1, decade * (wanted / decade >= 5 ? 5 : wanted / decade >= 2 ? 2 : 1));
}
