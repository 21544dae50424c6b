/** The posterior in numbers: parameters and forecasts of the step looked at. */
import type { Theme } from "./colour";
import { given, probability, significant } from "./format";
import { bandsOf } from "./history";
import {
  actionWords,
  forecastScale,
  modelShift,
  parameterNames,
  parameterScale,
  quantitiesIn,
  quantityWords,
  worthClass,
  worthDigits,
} from "./specs";
import type { Model, QuantityDescription, StepLine } from "./types";

interface Props {
  model: Model | undefined;
  line: StepLine | undefined;
  theme: Theme;
}

export function Summary({ model, line, theme }: Props) {
  if (!line) return null;
  const bands = bandsOf(line.quantiles.levels);
  const outer = bands.pairs[0];
  const level = line.verdict?.level ?? "ok";
  return (
    <section
      class={`summary ${worthClass(line)}`}
      aria-label={`Posterior at step ${line.step}${level === "reject" ? ", not usable" : ""}`}
    >
      <h2 class="hidden">Decision, forecasts and parameters</h2>
      {line.decision && (
        <article data-decision={line.decision.action}>
          <h3>
            next <small>decision</small>
          </h3>
          <p class="value">{actionWords(line.decision)}</p>
          <p class="interval">{line.decision.message}</p>
        </article>
      )}
      {expiredLast(quantitiesIn(model, line), line).map((q) => {
        const f = line.forecast[q.name];
        if (!f) return null;
        const scale = forecastScale(q, f);
        const { pairs, middle } = bandsOf(f.levels);
        const at = (i: number | undefined): string =>
          i === undefined
            ? "–"
            : worthDigits(line, f.values[i]! * scale.factor, f.std * scale.factor, modelShift(line));
        const p = f.probability_above_threshold;
        const below = f.probability_below_threshold;
        const threshold = given((q.threshold ?? 0) * scale.factor);
        return (
          <article key={`forecast ${q.name}`} data-forecast={q.name}>
            <h3>
              {q.name}{" "}
              <small>
                {quantityWords(q)}
                {f.past ? " (past)" : ""}
              </small>
            </h3>
            <p class="value">
              {at(middle)} <small>{scale.units}</small>
            </p>
            <p class="interval">
              {pairs[0] ? `${pairs[0].percent} %: ${at(pairs[0].low)} … ${at(pairs[0].high)} ${scale.units}` : ""}
            </p>
            {p !== undefined && q.threshold !== undefined && (
              <p class="failure">
                <meter class="p" min={0} max={1} value={p} aria-label={`P(${q.name} above threshold)`} />
                <b>
                  {`P(> ${threshold} ${scale.units})`} {probability(p).replace(/^(?=\d)/, "= ")}
                </b>
                {below !== undefined && (
                  <small>
                    {`P(< ${threshold} ${scale.units})`} {probability(below).replace(/^(?=\d)/, "= ")}
                  </small>
                )}
              </p>
            )}
          </article>
        );
      })}
      {parameterNames(model, line).map((name, k) => {
        const parameter = model?.parameters[k];
        const values = line.quantiles.values[k] ?? [];
        const std = Math.sqrt(line.covariance[k]?.[k] ?? NaN);
        const at = (i: number | undefined, by = factor): string =>
          i === undefined ? "–" : worthDigits(line, by * (values[i] ?? NaN), Math.abs(by) * std, modelShift(line, k));
        const { factor, units } = parameterScale(parameter);
        return (
          <article key={`parameter ${name}`} data-parameter={name}>
            <h3>
              {name} <small>parameter</small>
            </h3>
            <p class="value">
              {at(bands.middle)} <small>{units}</small>
              {units && parameter?.reference?.value !== 1 && (
                <small class="multiple"> {`${at(bands.middle, 1)} × ${given(factor)} ${units}`}</small>
              )}
            </p>
            <p class="interval">{outer ? `${outer.percent} %: ${at(outer.low)} … ${at(outer.high)} ${units}` : ""}</p>
            {parameter?.lower !== undefined && parameter.upper !== undefined && outer && (
              <Interval
                low={factor * parameter.lower}
                high={factor * parameter.upper}
                from={factor * values[outer.low]!}
                to={factor * values[outer.high]!}
                middle={factor * values[bands.middle ?? 0]!}
                colour={level === "ok" ? theme.blue : theme.faint}
                theme={theme}
              />
            )}
          </article>
        );
      })}
    </section>
  );
}

/** What has passed does not lead. */
function expiredLast(all: readonly QuantityDescription[], line: StepLine): QuantityDescription[] {
  const past = (q: QuantityDescription): number => (line.forecast[q.name]?.past ? 1 : 0);
  return [...all].sort((a, b) => past(a) - past(b));
}

/** The posterior's interval inside the allowed range: how much the data have narrowed it. */
function Interval(p: {
  low: number;
  high: number;
  from: number;
  to: number;
  middle: number;
  colour: string;
  theme: Theme;
}) {
  const at = (v: number): number => 100 * Math.min(1, Math.max(0, (v - p.low) / (p.high - p.low)));
  return (
    <>
      <svg
        class="box"
        viewBox="0 0 100 8"
        preserveAspectRatio="none"
        role="img"
        aria-label="Interval inside the allowed range"
      >
        <rect x="0" y="2.5" width="100" height="3" fill={p.theme.grid} />
        <rect x={at(p.from)} y="1" width={Math.max(0.8, at(p.to) - at(p.from))} height="6" fill={p.colour} />
        <rect x={at(p.middle) - 0.4} y="0" width="0.8" height="8" fill={p.theme.text} />
      </svg>
      <p class="ends">
        <span>{significant(p.low, 2)}</span>
        <span>allowed range</span>
        <span>{significant(p.high, 2)}</span>
      </p>
    </>
  );
}
