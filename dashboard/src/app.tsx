/** The page. */
import { useCallback, useEffect, useMemo, useState } from "preact/hooks";
import { BannerView } from "./banner";
import { theme as themeOf } from "./colour";
import { stepsTable } from "./csv";
import { eventsOf, merged } from "./events";
import { EventsPanel } from "./events_panel";
import { QuarantinePanel } from "./quarantine_panel";
import { quantitiesOf } from "./field";
import { FieldPanel } from "./field_panel";
import { Help, TokenDialog } from "./help";
import { LogbookPanel, notesIn } from "./logbook_panel";
import { PairPanel } from "./pair_panel";
import { ComparisonPanel } from "./comparison_panel";
import { EvidencePanel, ForecastPanel, ParametersPanel, TimingPanel } from "./plot_panels";
import { saveText } from "./png";
import { Scrub } from "./scrub";
import { firstOpen, parameterNames, quantitiesIn, worthClass } from "./specs";
import type { Store } from "./store";
import { SignalPanel } from "./signal_panel";
import { Summary } from "./summary";
import { TestsPanel } from "./tests_panel";
import { ThemeButton, useTheme } from "./theme";

const panels = ["forecast", "parameters", "field", "pairs", "evidence", "timing"];
const playInterval = 120;

/** Lists and text take all keys themselves, the slider those that move it. */
function keepsKey(target: HTMLElement, key: string): boolean {
  if (!(target instanceof HTMLInputElement)) return /^(SELECT|TEXTAREA)$/.test(target.tagName);
  if (target.type === "range") return /^(Arrow|Page|Home|End)/.test(key);
  return target.type !== "checkbox";
}

export function App({ store }: { store: Store }) {
  const [, redraw] = useState(0);
  const [choice, dark, nextTheme] = useTheme();
  const theme = themeOf(dark);
  const [help, setHelp] = useState(false);
  const [playing, setPlaying] = useState(false);
  const [chosenQuantity, setQuantity] = useState<number>();

  useEffect(() => store.subscribe(() => redraw((n) => n + 1)), [store]);
  useEffect(() => {
    if (!playing) return;
    if (store.chosen === undefined) store.choose(store.history.lines[0]?.step);
    const timer = setInterval(() => {
      store.move(1);
      if (store.chosen === undefined) setPlaying(false);
    }, playInterval);
    return () => clearInterval(timer);
  }, [playing, store]);

  const { history, model, status } = store;
  const line = store.line;
  const lines = history.lines;
  const budget = status?.budget_us ?? model?.budget_us;
  const version = history.version;
  const quantities = quantitiesIn(model, line);
  const quantity = Math.min(chosenQuantity ?? firstOpen(quantities, line), Math.max(0, quantities.length - 1));
  const names = parameterNames(model, line);
  // The pair plot is of one step: that of its draws, which may come a moment after the line.
  const pairLine = history.find(store.detail.samples.value?.step ?? -1) ?? line;
  const events = useMemo(() => {
    const found = eventsOf(lines, { quantities: model?.quantities ?? [], budget_us: budget });
    return merged(store.alarms, [...store.stateEvents, ...found]);
  }, [version, model, budget, store.stateEvents, store.alarms]);
  const fields = quantitiesOf(names);
  const notes = useMemo(() => notesIn(store.logbook), [store.logbook]);

  const key = useCallback(
    (event: KeyboardEvent) => {
      const target = event.target as HTMLElement;
      if (
        event.ctrlKey ||
        event.metaKey ||
        event.altKey ||
        target.closest("dialog[open]") ||
        keepsKey(target, event.key)
      )
        return;
      const pace = event.shiftKey ? 10 : 1;
      const actions: Record<string, () => void> = {
        ArrowLeft: () => store.move(-pace),
        ArrowRight: () => store.move(pace),
        Home: () => store.choose(store.history.lines[0]?.step),
        End: () => store.choose(undefined),
        l: () => store.choose(undefined),
        " ": () => setPlaying((p) => !p),
        f: () => store.want(fields[(fields.findIndex((x) => x.value === store.wanted) + 1) % fields.length]!.value),
        q: () => setQuantity((quantity + 1) % Math.max(1, quantities.length)),
        t: nextTheme,
        "?": () => setHelp(true),
      };
      const digit = panels[Number(event.key) - 1];
      const action = digit
        ? () => document.getElementById(digit)?.focus()
        : actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
      if (!action || (event.key === " " && target.tagName === "BUTTON")) return;
      event.preventDefault();
      action();
    },
    [fields.length, quantities.length, quantity, nextTheme],
  );
  useEffect(() => {
    addEventListener("keydown", key);
    return () => removeEventListener("keydown", key);
  }, [key]);

  const compare = (name: string): void => {
    void store.compare(name);
    requestAnimationFrame(() => document.getElementById("comparison")?.scrollIntoView({ block: "start" }));
  };
  const plots = {
    lines,
    version,
    model,
    status,
    line,
    notes,
    theme,
    selected: store.chosen === undefined ? undefined : line?.time,
    onSelect: (time: number) => {
      const nearest = history.nearest(time);
      store.choose(nearest && nearest.step === history.latest?.step ? undefined : nearest?.step);
    },
  };
  return (
    <>
      <header class="top">
        <h1>knothe{model?.site ? <small> {model.site}</small> : ""}</h1>
        {(model?.sites?.length ?? 0) > 1 && (
          <select
            aria-label="Structure"
            value={model?.site ?? ""}
            onChange={(e) => store.useSite(e.currentTarget.value)}
          >
            {model!.sites!.map((s) => (
              <option key={s} value={s}>
                {s}
              </option>
            ))}
          </select>
        )}
        <span class="link" id="contact">
          {store.connected ? "connected" : "no contact"}
        </span>
        <span class="buttons">
          <button type="button" onClick={() => saveText(stepsTable(lines, names), "knothe-steps.csv")}>
            all steps as CSV
          </button>
          <ThemeButton choice={choice} next={nextTheme} />
          <button type="button" onClick={() => setHelp(true)} aria-label="Help and keys">
            ?
          </button>
        </span>
      </header>
      <main>
        <BannerView store={store} />
        {store.problem && !store.connected && <p class="problem">The service says: {store.problem}</p>}
        <Scrub
          lines={lines}
          version={version}
          chosen={store.chosen}
          line={line}
          timeUnits={model?.time?.units}
          events={events}
          theme={theme}
          choose={(step) => store.choose(step)}
          playing={playing}
          setPlaying={setPlaying}
        />
        <Summary model={model} line={line} theme={theme} />
        <div class={`panels ${worthClass(line)}`}>
          <FieldPanel
            model={model}
            fields={store.detail.fields}
            sensors={store.detail.sensors}
            theme={theme}
            known={model !== undefined || line !== undefined}
            quantity={store.wanted}
            setQuantity={(name) => store.want(name)}
            fetchPicture={(step) => store.api.picture(step)}
          />
          <SignalPanel
            signal={store.detail.signal}
            wanted={store.signal}
            want={(sensor) => store.wantSignal(sensor)}
            plots={plots}
          />
          <ForecastPanel {...plots} quantity={quantity} setQuantity={setQuantity} />
          <ParametersPanel {...plots} />
          <PairPanel
            model={model}
            line={pairLine}
            lines={lines}
            names={names}
            samples={store.detail.samples}
            theme={theme}
          />
          <EvidencePanel {...plots} />
          <TimingPanel {...plots} />
          <EventsPanel events={events} chosen={store.chosen} choose={(step) => store.choose(step)} api={store.api} />
          <LogbookPanel
            entries={store.logbook}
            line={line}
            api={store.api}
            model={model}
            off={status?.switched_off ?? []}
          />
          <TestsPanel tests={store.tests} api={store.api} compare={compare} />
          <QuarantinePanel held={store.quarantine} api={store.api} />
          <ComparisonPanel
            comparison={store.comparison}
            close={() => void store.compare(undefined)}
            props={plots}
            theme={theme}
          />
        </div>
      </main>
      <Help open={help} close={() => setHelp(false)} version={model?.version ?? status?.version} />
      <TokenDialog needed={store.needsToken} use={(token) => store.useToken(token)} />
    </>
  );
}
