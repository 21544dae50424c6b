/** The test that runs beside an earlier one. */
import { useMemo } from "preact/hooks";
import { Chart } from "./chart";
import type { Theme } from "./colour";
import { comparedRows, comparisonSpecs, type ComparedRow } from "./comparison";
import { Panel } from "./panel";
import { specsTable, type PlotProps } from "./plot_panels";
import { quantitiesIn, worthClass } from "./specs";
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
  const here = model?.test || "unnamed test";
  const there = comparison?.name || "unnamed test";
  const [specs, rows] = useMemo(() => {
    if (!comparison || !other) return [[], []];
    const sides = [
      { label: here, lines },
      { label: there, lines: other },
    ] as const;
    const quantities = quantitiesIn(model, line ?? other[other.length - 1]);
    return [comparisonSpecs(sides, model, quantities, theme), comparedRows(sides, model, quantities)];
  }, [comparison, lines, version, model, theme]);
  if (!comparison) return null;
  // Beside a result that is not to be used a difference is none either.
  const classes = [lines, other ?? []].map((side) => worthClass(side[side.length - 1]));
  const worst = classes.reduce((a, b) => (b.length > a.length ? b : a));
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
      {rows.length > 0 && <Numbers rows={rows} here={here} there={there} worth={worst} />}
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

function Numbers({ rows, here, there, worth }: { rows: ComparedRow[]; here: string; there: string; worth: string }) {
  const heads = [here, there, "difference", "overlap"];
  return (
    <>
      <table class={`numbers ${worth}`}>
        <thead>
          <tr>
            {["at the end", ...heads].map((head) => (
              <th key={head} scope="col">
                {head}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map((row) => (
            <tr key={row.name}>
              <th scope="row">
                {row.name} {row.units && <small>[{row.units}]</small>}
              </th>
              {[row.here, row.other, row.difference, row.overlap].map((cell, k) => (
                <td key={heads[k]} data-label={heads[k]}>
                  {cell}
                </td>
              ))}
            </tr>
          ))}
        </tbody>
      </table>
      <p class="note">
        ±: one standard deviation. Overlap: the area that two normal densities with these means and standard deviations
        share.
      </p>
    </>
  );
}
