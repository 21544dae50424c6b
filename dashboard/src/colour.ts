/** Colours that the colour-blind can tell apart: Okabe and Ito's set, viridis, and blue–white–orange for what has a sign. */
import type { QuietWord, Severity, StateWord, VerdictLevel } from "./types";

export interface Theme {
  dark: boolean;
  text: string;
  faint: string;
  grid: string;
  panel: string;
  gap: string;
  blue: string;
  orange: string;
  green: string;
  red: string;
  purple: string;
  threshold: string;
  prior: string;
  series: string[];
  mesh: [number, number, number];
  edge: [number, number, number];
}

const light: Theme = {
  dark: false,
  text: "#1b2430",
  faint: "#5b6776",
  grid: "#e3e7ec",
  panel: "#ffffff",
  gap: "#e3e8ee",
  blue: "#0072b2",
  orange: "#b35c00",
  green: "#00805d",
  red: "#c04a00",
  purple: "#9b3f77",
  threshold: "#1b2430",
  prior: "#7b8794",
  series: ["#0072b2", "#b35c00", "#00805d", "#9b3f77", "#6b7685", "#8a6d00", "#1f8ab5"],
  mesh: [0.82, 0.85, 0.88],
  edge: [0.25, 0.3, 0.36],
};
const dark: Theme = {
  dark: true,
  text: "#e6ebf1",
  faint: "#9aa7b6",
  grid: "#2b3541",
  panel: "#18202a",
  gap: "#27323e",
  blue: "#56b4e9",
  orange: "#e69f00",
  green: "#2fc79a",
  red: "#f0814a",
  purple: "#dd8fb9",
  threshold: "#ffffff",
  prior: "#8b98a7",
  series: ["#56b4e9", "#e69f00", "#2fc79a", "#dd8fb9", "#9aa7b6", "#f0e442", "#8fd3ff"],
  mesh: [0.34, 0.39, 0.45],
  edge: [0.06, 0.08, 0.1],
};

export function theme(isDark: boolean): Theme {
  return isDark ? dark : light;
}

/** Words and shapes say it too: nobody needs to see the colour. */
export const stateLook: Record<StateWord, { colour: string; ink: string; sign: string }> = {
  OK: { colour: "#007a59", ink: "#ffffff", sign: "✓" },
  DEGRADED: { colour: "#e69f00", ink: "#1b1300", sign: "▲" },
  STALE: { colour: "#5d6a79", ink: "#ffffff", sign: "◷" },
  BIASED: { colour: "#9b3f77", ink: "#ffffff", sign: "◆" },
  DIVERGED: { colour: "#b83a00", ink: "#ffffff", sign: "✕" },
  FINISHED: { colour: "#33506e", ink: "#ffffff", sign: "■" },
};

export const quietLook: Record<QuietWord, (typeof stateLook)[StateWord]> = {
  WAITING: { ...stateLook.STALE, sign: "◷" },
  "NO DATA": { ...stateLook.STALE, sign: "‖" },
  "NO CONTACT": { ...stateLook.STALE, sign: "⌁" },
};

export const levelLook: Record<VerdictLevel, (typeof stateLook)[StateWord]> = {
  ok: stateLook.OK,
  caution: stateLook.DEGRADED,
  reject: stateLook.DIVERGED,
};

export const severitySign: Record<Severity, string> = { info: "ℹ", warning: "▲", alarm: "✕" };

export type Rgb = [number, number, number];

const viridis: Rgb[] = [
  [68, 1, 84],
  [72, 36, 117],
  [65, 68, 135],
  [53, 95, 141],
  [42, 120, 142],
  [33, 145, 140],
  [34, 168, 132],
  [68, 191, 112],
  [122, 209, 81],
  [189, 223, 38],
  [253, 231, 37],
];
/** Blue over near white to orange-brown: safe for all common kinds of colour blindness. */
const signed: Rgb[] = [
  [5, 48, 97],
  [33, 102, 172],
  [67, 147, 195],
  [146, 197, 222],
  [209, 229, 240],
  [247, 247, 247],
  [253, 224, 193],
  [245, 182, 116],
  [224, 130, 30],
  [179, 88, 6],
  [110, 54, 4],
];

/** `at` in 0 … 1, outside of it the ends. */
export function colourAt(map: "viridis" | "signed", at: number): Rgb {
  const stops = map === "viridis" ? viridis : signed;
  const x = Math.min(1, Math.max(0, Number.isFinite(at) ? at : 0)) * (stops.length - 1);
  const i = Math.min(stops.length - 2, Math.floor(x));
  const a = stops[i]!;
  const b = stops[i + 1]!;
  return [0, 1, 2].map((k) => Math.round(a[k]! + (x - i) * (b[k]! - a[k]!))) as Rgb;
}

export function rgb([r, g, b]: Rgb): string {
  return `rgb(${r},${g},${b})`;
}

/** The same colour, seen through. */
export function through(hex: string, opacity: number): string {
  const n = parseInt(hex.slice(1), 16);
  return `rgba(${n >> 16},${(n >> 8) & 255},${n & 255},${opacity})`;
}
