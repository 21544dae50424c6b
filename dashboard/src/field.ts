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

export function viewOf(quantity: Quantity, component: Component, fields: FieldsAnswer | undefined, sensors: SensorsAnswer | undefined): View {
  if (quantity === "residual") return atSensors(sensors, sensors?.normalised, "residual: measured − predicted", "standard deviations of the noise", 3);
  if (quantity === "bias") {
    if (fields?.bias) return atNodes(fields.bias, component, "model bias, corrected for", true);
    if (sensors?.bias) return atSensors(sensors, sensors.bias, "model bias, corrected for", "m", 0);
    return { ...nothing, problem: "No correction of the model's bias in this step." };
  }
  const name = quantity.split(":")[1];
  const values = name === undefined ? fields?.displacement : fields?.sensitivity[name];
  if (!values) return { ...nothing, ...(fields ? { problem: `The service sends no ${quantity.replace(":", " to ")}.` } : {}) };
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

function atSensors(answer: SensorsAnswer | undefined, values: readonly number[] | undefined, label: string, units: string, least: number): View {
  if (!answer || !values) return nothing;
  const sensors: (number | undefined)[] = answer.status.map(() => undefined);
  answer.index.forEach((sensor, k) => (sensors[sensor] = values[k]));
  const largest = roundUp(Math.max(least, ...values.map(Math.abs)));
  return { sensors, map: "signed", range: { low: -largest, high: largest }, scale: scaleFor(units, largest), label };
}

function rounded({ low, high }: Range): Range {
  const largest = roundUp(Math.max(Math.abs(low), Math.abs(high)));
  return { low: low < 0 ? -largest : 0, high: largest };
}
