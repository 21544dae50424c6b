/** What is under the pointer, in words. Pure. */
import type { Vec3 } from "./camera";
import type { View } from "./field";
import type { Marker } from "./field_overlay";
import { scaleFor, significant } from "./format";
import type { Model, SensorsAnswer } from "./types";

export function countWords(sensors: SensorsAnswer | undefined): string {
  if (!sensors) return "";
  const count = (word: string): number => sensors.status.filter((s) => s === word).length;
  return `Sensors: ${count("used")} used, ${count("rejected")} rejected, ${count("missing")} missing`;
}

/** Mesh point of each sensor, to move it with the structure. */
export function nearestPoints(model: Model | undefined): number[] {
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

export interface Under {
  model: Model | undefined;
  sensors: SensorsAnswer | undefined;
  markers: Marker[];
  shown: View;
  pixel: (node: number) => Vec3;
  nodes: Uint32Array | undefined;
}

/** In words, what is under the pointer: a sensor if there is one, else the value at the closest mesh point. */
export function under(at: readonly [number, number], u: Under): string {
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
