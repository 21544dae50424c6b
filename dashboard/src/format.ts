/** Numbers to words. Pure. */

const prefixes: [number, string][] = [
  [1e9, "G"],
  [1e6, "M"],
  [1e3, "k"],
  [1, ""],
  [1e-3, "m"],
  [1e-6, "µ"],
  [1e-9, "n"],
];
const prefixable = new Set(["m", "N", "Pa", "J", "s", "W", "g", "Hz"]);

/** A unit as it is written beside numbers of size `largest`: value × `factor` is in `units`. "1" and "" have no name. */
export interface Scale {
  factor: number;
  units: string;
}

export function scaleFor(units: string | undefined, largest: number): Scale {
  const plain = prettyUnits(units);
  if (!prefixable.has(plain) || !(largest > 0) || !Number.isFinite(largest)) return { factor: 1, units: plain };
  const [size, prefix] = prefixes.find(([s]) => largest >= s * 0.999) ?? [1e-9, "n"];
  return { factor: 1 / size, units: prefix + plain };
}

/** Of what is imposed, as the console and the tables have it (knothe/record/forecast_text.cpp): a length in mm. */
export function imposedScale(units: string | undefined, largest: number): Scale {
  if (units === "m" && largest >= 1e-5) return { factor: 1e3, units: "mm" };
  return units !== "m" && largest < 1e4 ? scaleFor(units, 1) : scaleFor(units, largest);
}

/** "0.12 mm". */
export function imposed(value: number, units: string | undefined): string {
  const scale = imposedScale(units, Math.abs(value));
  return `${given(Number((value * scale.factor).toPrecision(4)))} ${scale.units}`;
}

/** Three significant digits by default; no exponent between 1e-3 and 1e5. */
export function significant(value: number, digits = 3): string {
  if (value === 0) return "0";
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) {
    const [mantissa = "", exponent = ""] = value.toExponential(digits - 1).split("e");
    return `${minus(mantissa)}·10${superscript(exponent.replace("+", ""))}`;
  }
  const decimals = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return minus(value.toFixed(decimals));
}

/** A number that was given, not computed: as short as it was written. */
export function given(value: number): string {
  const size = Math.abs(value);
  return size >= 1e5 || (size > 0 && size < 1e-3) ? significant(value, 2) : minus(String(Number(value.toPrecision(6))));
}

/** A value with as many decimals as its spread makes worth reading: two digits of the spread. */
export function withSpread(value: number, spread: number): string {
  if (!(spread > 0) || !Number.isFinite(spread)) return significant(value, 4);
  const decimals = 1 - Math.floor(Math.log10(spread));
  if (decimals < 0 || decimals > 8) return significant(value, 4);
  return minus(value.toFixed(decimals));
}

function minus(text: string): string {
  return text.replace("-", "−");
}

function superscript(text: string): string {
  return [...text].map((c) => (c === "-" ? "⁻" : ("⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(c)] ?? c))).join("");
}

/** Probabilities near 0 and 1 are bounds, not "0 %" and "100 %": a probability that is estimated is never certain. */
export function probability(p: number): string {
  if (!Number.isFinite(p)) return "–";
  const percent = 100 * p;
  if (percent < 0.1) return "< 0.1 %";
  if (percent > 99.9) return "> 99.9 %";
  return percent < 10 || percent > 90 ? `${percent.toFixed(1)} %` : `${percent.toFixed(0)} %`;
}

export function duration(seconds: number): string {
  if (!Number.isFinite(seconds)) return "–";
  const s = Math.max(0, seconds);
  if (s < 10) return `${s.toFixed(1)} s`;
  if (s < 120) return `${Math.round(s)} s`;
  if (s < 7200) return `${Math.round(s / 60)} min`;
  if (s < 172800) return `${Math.round(s / 3600)} h`;
  return `${Math.round(s / 86400)} days`;
}

const padded = (...numbers: number[]) => numbers.map((number) => String(number).padStart(2, "0"));

/** hh:mm:ss of a Unix time in s, in the browser's time zone, whatever locales it knows. */
export function timeOfDay(unix: number): string {
  const at = new Date(1000 * unix);
  return padded(at.getHours(), at.getMinutes(), at.getSeconds()).join(":");
}

/** The time of day; with the date, yyyy-mm-dd, if it is not that of `now`. */
export function clock(unix: number, now = Date.now() / 1000): string {
  const at = new Date(1000 * unix);
  const time = timeOfDay(unix);
  const date = padded(at.getFullYear(), at.getMonth() + 1, at.getDate()).join("-");
  return at.toDateString() === new Date(1000 * now).toDateString() ? time : `${date} ${time}`;
}

export function microseconds(us: number): string {
  if (!Number.isFinite(us)) return "–";
  if (us < 1000) return `${significant(us, 2)} µs`;
  if (us < 1e6) return `${significant(us / 1000, 3)} ms`;
  return `${significant(us / 1e6, 3)} s`;
}

/** "N/m3" → "N/m³"; "1" → "". */
export function prettyUnits(units: string | undefined): string {
  const text = (units ?? "").replace(
    /([A-Za-z])([23])/g,
    (_, unit: string, power: string) => unit + (power === "2" ? "²" : "³"),
  );
  return text === "1" ? "" : text;
}

/** A model time: "t = 3600 s". */
export function timeWords(time: number, units: string | undefined): string {
  return `t = ${given(time)} ${prettyUnits(units)}`.trim();
}

/** "label [units]", as at an axis. */
export function axisLabel(label: string, units: string): string {
  return units ? `${label} [${units}]` : label;
}

/** `crack_length` → "crack length". */
export function words(name: string): string {
  return name.replace(/_/g, " ");
}

/** Powers of ten alone: what is between them has no room. */
export function decade(value: number): string {
  const power = Math.log10(value);
  if (Math.abs(power - Math.round(power)) > 1e-6) return "";
  return Math.abs(power) < 2.5 ? given(value) : significant(value, 1).replace("1·", "");
}

/** On an axis of less than two decades 2 and 5 have room too. */
export function halfDecade(value: number): string {
  const mantissa = Number(value.toExponential(3).split("e")[0]);
  return [1, 2, 5].includes(mantissa) ? given(Number(value.toPrecision(3))) : "";
}
