/** What a figure holds. */
import type { ChartSpec, LegendEntry } from "../chart";
import type { Theme } from "../colour";
import type { PairPicture } from "../pair_panel";
import type { MeshSpec } from "./mesh_svg";

export type Pairs = Omit<PairPicture, "width" | "height" | "theme">;

export type Content = { charts: ChartSpec[] } | { mesh: MeshSpec } | { pairs: Pairs; legend: LegendEntry[] };

export const charts = (...specs: (ChartSpec | undefined)[]): Content | undefined => {
  const there = specs.filter((s): s is ChartSpec => s !== undefined);
  return there.length ? { charts: there } : undefined;
};

/** The legend of pairs. */
export const pairWords = (theme: Theme, more: LegendEntry[] = []): LegendEntry[] => [
  { label: "draws of the posterior", colour: theme.blue, look: "bar" },
  { label: "50 % and 95 % of a Gaussian with its moments", colour: theme.text, look: "dash" },
  { label: "most probable", colour: theme.red, look: "bar" },
  ...more,
];

/** More do not fit: the first ones are shown. */
export const mostPairs = 5;
