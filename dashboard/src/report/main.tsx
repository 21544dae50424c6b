/** A report: the record is in the page, and every place for a figure is drawn when it comes into view. */
import { render } from "preact";
import { useEffect, useState } from "preact/hooks";
import { theme as themeOf } from "../colour";
import { stepsTable } from "../csv";
import { timeWords } from "../format";
import { saveText } from "../png";
import { ThemeButton, useTheme } from "../theme";
import { bindUnits } from "../unbroken";
import { worthClass } from "../specs";
import { Figure } from "./figure";
import { contentOf } from "./figures";
import { framesOf, type Probe, type Report } from "./record";

bindUnits(document.querySelector("main")!);
const report = JSON.parse(document.getElementById("record")!.textContent!) as Report;
const lines = report.kind === "assimilation" ? report.lines : [];
const frames = framesOf(report);
const last = frames.length - 1;

interface Look {
  dark: boolean;
  /** Index of the step, or of the picture. */
  chosen: number;
  probe: Probe | undefined;
}

interface Place {
  id: string;
  name: string;
  element: Element;
  /** What is drawn there; nothing yet. */
  drawn?: Look;
  seen: boolean;
}

/** What a figure that is saved says of the result; a finding that is no result has no doubts to carry along. */
const doubt = document.querySelector(":is(.result.caution, .result.reject) .word")?.textContent?.trim() ?? "";
const worth = doubt.startsWith("Result: ") ? doubt : "";
let look: Look = { dark: false, chosen: last, probe: undefined };
let choose: (index: number) => void = () => {};
let probed: (probe: Probe) => void = () => {};

const places = [...document.querySelectorAll<HTMLElement>("figure[data-figure]")].map((figure): Place => {
  const element = document.createElement("div");
  element.className = "drawing";
  figure.prepend(element);
  const words = figure.querySelector("figcaption")?.textContent ?? "figure";
  return { id: figure.dataset.figure!, name: words.replace(/\s+/g, " ").trim().slice(0, 80), element, seen: false };
});

function draw(place: Place): void {
  if (place.drawn === look) return;
  place.drawn = look;
  const theme = themeOf(look.dark);
  render(
    <Figure
      content={contentOf(report, place.id, theme, look.chosen, look.probe)}
      theme={theme}
      paper={themeOf(false)}
      name={place.name}
      worth={worth}
      selected={frames[look.chosen]?.time}
      onSelect={(time) => {
        let best = 0;
        frames.forEach((f, i) => {
          if (Math.abs(f.time - time) < Math.abs(frames[best]!.time - time)) best = i;
        });
        choose(best);
      }}
      onProbe={(probe) => probed(probe)}
    />,
    place.element,
  );
}

function update(next: Look): void {
  look = next;
  for (const place of places) if (place.seen) draw(place);
}

function Controls() {
  const [choice, dark, nextTheme] = useTheme();
  const [chosen, setChosen] = useState(last);
  const [probe, setProbe] = useState<Probe>();
  choose = setChosen;
  probed = setProbe;
  useEffect(() => update({ dark, chosen, probe }), [dark, chosen, probe]);
  const line = lines[chosen];
  const frame = frames[chosen];
  return (
    <>
      {frame && frames.length > 1 && (
        <label class="steps">
          {lines.length ? "Step" : "Picture"}{" "}
          <input
            type="range"
            min={0}
            max={last}
            value={chosen}
            aria-valuetext={frame.label}
            onInput={(e) => setChosen(Number(e.currentTarget.value))}
          />
          <span>
            {frame.label}, {timeWords(frame.time, report.kind === "assimilation" ? report.time_units : undefined)}
            {chosen === last ? " (last)" : ""}
          </span>
        </label>
      )}
      {line && (
        <button
          type="button"
          onClick={() =>
            saveText(
              stepsTable(
                lines,
                line.mean.map(
                  (_, k) =>
                    (report.kind === "assimilation" ? report.summary.parameters?.[k]?.name : undefined) ?? `p${k}`,
                ),
              ),
              "steps.csv",
            )
          }
        >
          all steps as CSV
        </button>
      )}
      <button type="button" onClick={() => print()}>
        print
      </button>
      <ThemeButton choice={choice} next={nextTheme} />
    </>
  );
}

document.documentElement.classList.add("drawn", ...worthClass(lines[last]).split(" ").filter(Boolean));
render(<Controls />, document.getElementById("controls")!);
const observer = new IntersectionObserver(
  (entries) => {
    for (const entry of entries) {
      const place = places.find((p) => p.element === entry.target)!;
      place.seen = place.seen || entry.isIntersecting;
      if (place.seen) draw(place);
    }
  },
  { rootMargin: "600px" },
);
for (const place of places) observer.observe(place.element);
// On paper all of them are looked at.
const all = (): void => {
  for (const place of places) {
    place.seen = true;
    draw(place);
  }
};
addEventListener("beforeprint", all);
setTimeout(all, 2000);

// A table that is wider than the screen is moved by keys, too.
const tables = [...document.querySelectorAll<HTMLElement>(".scroll")];
const reachable = (): void => {
  for (const table of tables) {
    if (table.scrollWidth > table.clientWidth) table.tabIndex = 0;
    else table.removeAttribute("tabindex");
  }
};
addEventListener("resize", reachable);
reachable();
