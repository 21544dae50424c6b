/** Switching a sensor off, or on again, from a step on. */
import { useState } from "preact/hooks";
import type { Api } from "./api";
import { SignedForm } from "./signed_form";
import type { Model } from "./types";

interface Props {
  api: Api;
  model: Model | undefined;
  /** Sensors that are off at the latest step. */
  off: readonly number[];
  /** The step looked at. */
  step: number;
}

/** What names a sensor: its index, or the name of a series. */
export function sensorOf(text: string): number | string {
  return /^\d+$/.test(text.trim()) ? Number(text) : text.trim();
}

/** Which sensors there are, in words. */
export function sensorsIn(model: Model | undefined): string {
  const places = model?.displacements;
  const indices = places === undefined ? [] : [`0 … ${places - 1}`];
  return ["sensor", [...indices, ...(model?.scalars ?? [])].join(", ")].filter(Boolean).join(" ");
}

export function SensorForm({ api, model, off, step }: Props) {
  const [open, setOpen] = useState(false);
  const [sensor, setSensor] = useState("");
  const [active, setActive] = useState(false);
  const [from, setFrom] = useState("here");
  const choose = (text: string, on: boolean): void => {
    setSensor(text);
    setActive(on);
    setFrom(on ? "first" : "here");
    setOpen(true);
  };
  return (
    <>
      {off.map((k) => (
        <p key={k} class="switched">
          sensor {k} is off{" "}
          <button type="button" class="answer" onClick={() => choose(String(k), true)}>
            switch it on …
          </button>
        </p>
      ))}
      {open ? (
        <SignedForm
          api={api}
          label="why"
          needed={false}
          button={active ? "Switch on" : "Switch off"}
          send={(by, comment) =>
            api.switchSensor({ sensor: sensorOf(sensor), active, step: from === "first" ? 0 : step }, by, comment)
          }
          done={() => setOpen(false)}
        >
          <input
            aria-label="Sensor"
            placeholder={sensorsIn(model)}
            title={sensorsIn(model)}
            list="series"
            required
            value={sensor}
            onInput={(e) => setSensor(e.currentTarget.value)}
          />
          <datalist id="series">
            {(model?.scalars ?? []).map((name) => (
              <option key={name} value={name} />
            ))}
          </datalist>
          <select aria-label="From when on" value={from} onChange={(e) => setFrom(e.currentTarget.value)}>
            <option value="here">from step {step} on</option>
            <option value="first">{active ? "as if never off" : "from the first step on"}</option>
          </select>
          <button type="button" onClick={() => setOpen(false)}>
            Cancel
          </button>
        </SignedForm>
      ) : (
        <button type="button" class="answer" onClick={() => choose("", false)}>
          switch a sensor off …
        </button>
      )}
    </>
  );
}
