/** The test that runs beside an earlier one. */
import { useMemo } from "preact/hooks";
import { Chart } from "./chart";
import type { Theme } from "./colour";
import { comparisonSpecs } from "./comparison";
import { Panel } from "./panel";
import { specsTable, type PlotProps } from "./plot_panels";
import { quantitiesIn } from "./specs";
import type { Comparison } from "./store";
import { testWords } from "./tests_panel";

interface Props {
  comparison: Comparison | undefined;
  close: () => void;
  props: PlotProps;
  theme: Theme;
}

export function ComparisonPanel({ comparison, close, props, theme }: Props) {
  const { lines, version, model, line } = props;
  const other = comparison?.lines;
  const specs = useMemo(() => {
    if (!comparison || !other) return [];
    const here = model?.test || "unnamed test";
    const sides = [
      { label: here, lines },
      { label: comparison.name || "unnamed test", lines: other },
    ] as const;
    return comparisonSpecs(sides, model, quantitiesIn(model, line ?? other[other.length - 1]), theme);
  }, [comparison, lines, version, model, theme]);
  if (!comparison) return null;
  const empty = other?.length === 0 ? "It has no data." : undefined;
  const note =
    comparison.problem ??
    empty ??
    (other
      ? "Both over the model's time, as known at each time; solid: the test that runs."
      : "Computing its posterior from its journal …");
  return (
    <Panel
      id="comparison"
      title={`Comparison with ${testWords(comparison.name)}`}
      note={note}
      controls={
        <button type="button" onClick={close}>
          close
        </button>
      }
      csv={() => specs.map((spec) => specsTable([spec])).join("\r\n")}
    >
      <div class="compared">
        {specs.map((spec) => (
          <Chart
            key={spec.name}
            spec={spec}
            theme={theme}
            selected={props.selected ?? line?.time}
            onSelect={props.onSelect}
          />
        ))}
      </div>
    </Panel>
  );
}
