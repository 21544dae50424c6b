/** A sensor's signal beside its prediction, load over displacement where there is a force. */
import { useMemo } from "preact/hooks";
import type { PlotProps } from "./plot_panels";
import { ChartsPanel } from "./plot_panels";
import { signalSpec } from "./signal";
import { quantitiesIn } from "./specs";
import type { Detail } from "./store";
import type { Model, SignalAnswer } from "./types";

/** As high as the two plots beside it, px. */
const panelHeight = 380;

/** More displacements are not listed one by one. */
const mostListed = 300;

/** What a list offers: the series, then the displacements, the one that is shown first among them. */
export function signalsOf(model: Model | undefined): { value: string; label: string }[] {
  const scalars = (model?.scalars ?? []).map((name) => ({ value: name, label: name.replace(/_/g, " ") }));
  const components = model?.sensors?.components ?? [];
  const count = Math.min(mostListed, model?.displacements ?? components.length);
  const listed = Array.from({ length: count }, (_, k) => k);
  const first = Number(model?.signal);
  if (first >= count) listed.push(first);
  return [
    ...scalars,
    ...listed.map((k) => ({
      value: String(k),
      label: `sensor ${k}${components[k] ? `, u_${components[k]}` : ""}`,
    })),
  ];
}

interface Props {
  signal: Detail<SignalAnswer>;
  wanted: string | undefined;
  want: (sensor: string) => void;
  plots: PlotProps;
}

export function SignalPanel({ signal, wanted, want, plots }: Props) {
  const { model, line, theme } = plots;
  const choices = useMemo(() => signalsOf(model), [model]);
  const s = signal.value;
  const specs = useMemo(
    () => (s ? [{ ...signalSpec(s, quantitiesIn(model, line), model?.time?.units, theme), height: panelHeight }] : []),
    [s, model, theme],
  );
  if (choices.length === 0) return null;
  return (
    <ChartsPanel
      id="signal"
      title={s?.loading ? "Measured and predicted, over the loading" : "Measured and predicted"}
      note={
        signal.problem ??
        (s ? `By the posterior of step ${s.step}; after the last datum, a forecast. Band: 95 %, noise included.` : "")
      }
      specs={specs}
      props={plots}
      overTime={false}
      controls={
        choices.length > 1 && (
          <select aria-label="Signal" value={wanted ?? ""} onChange={(e) => want(e.currentTarget.value)}>
            {choices.map(({ value, label }) => (
              <option key={value} value={value}>
                {label}
              </option>
            ))}
          </select>
        )
      }
    />
  );
}
