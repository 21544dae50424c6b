/** What the field view can show of a step, and in which colours. Pure. */
import { roundUp } from "./camera";
import { scaleFor, type Scale } from "./format";
import { rangeOf, scalars, type Component, type Range } from "./mesh";
import type { FieldsAnswer, SensorsAnswer } from "./types";

/** "displacement", "sensitivity:NAME", "residual", "bias". */
export type Quantity = string;

export interface View {
  /** One number per mesh point, SI; absent where the quantity lives at sensors. */
  nodes?: Float32Array;
  /** One number per sensor, `undefined` where it has none. */
  sensors?: (number | undefined)[];
  map: "viridis" | "signed";
  range: Range;
  scale: Scale;
  label: string;
  /** Why there is nothing to see. */
  problem?: string;
}

export function quantitiesOf(parameters: readonly string[]): { value: Quantity; label: string }[] {
  return [
    { value: "displacement", label: "displacement" },
    ...parameters.map((name) => ({ value: `sensitivity:${name}`, label: `sensitivity to ${name}` })),
    { value: "residual", label: "residual at sensors" },
    { value: "bias", label: "model bias" },
  ];
}

export function viewOf(
  quantity: Quantity,
  component: Component,
  fields: FieldsAnswer | undefined,
  sensors: SensorsAnswer | undefined,
  std: readonly number[],
): View {
  if (quantity === "residual") {
    const known = std.length > 0 && std.every(Number.isFinite);
    const values = known
      ? sensors?.residual?.map((r, i) => (r === undefined ? undefined : r / std[i]!))
      : sensors?.residual;
    return atSensors(
      values,
      "residual: measured − predicted",
      known ? "standard deviations of the noise" : "m",
      known ? 3 : 0,
    );
  }
  if (quantity === "bias") {
    if (fields?.bias) return atNodes(fields.bias, component, "model bias, corrected for", true);
    if (sensors?.bias) return atSensors(sensors.bias, "model bias, corrected for", "m", 0);
    return { ...nothing, problem: "No correction of the model's bias in this step." };
  }
  const name = quantity.split(":")[1];
  const values = name === undefined ? fields?.displacement : fields?.sensitivity[name];
  if (!values)
    return { ...nothing, ...(fields && name === undefined ? { problem: "The service sends no displacement." } : {}) };
  const of = name === undefined ? "displacement" : `∂u/∂${name} · std(${name})`;
  return atNodes(values, component, of, component !== "magnitude");
}

const nothing: View = { map: "viridis", range: { low: 0, high: 1 }, scale: { factor: 1, units: "" }, label: "" };

function atNodes(values: readonly number[][], component: Component, label: string, hasSign: boolean): View {
  const nodes = scalars(values, component);
  const signed = hasSign && component !== "magnitude";
  const range = rounded(rangeOf(nodes, signed));
  const of = component === "magnitude" ? `|${label}|` : `${label}, ${component}`;
  return { nodes, map: signed ? "signed" : "viridis", range, scale: scaleFor("m", range.high), label: of };
}

function atSensors(
  values: readonly (number | undefined)[] | undefined,
  label: string,
  units: string,
  least: number,
): View {
  if (!values) return nothing;
  const largest = roundUp(Math.max(least, ...values.map((v) => Math.abs(v ?? 0))));
  return {
    sensors: [...values],
    map: "signed",
    range: { low: -largest, high: largest },
    scale: scaleFor(units, largest),
    label,
  };
}

function rounded({ low, high }: Range): Range {
  const largest = roundUp(Math.max(Math.abs(low), Math.abs(high)));
  return { low: low < 0 ? -largest : 0, high: largest };
}
