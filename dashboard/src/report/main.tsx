/** A report: the record is in the page, and every place for a figure is drawn when it comes into view. */
import { render } from "preact";
import { useEffect, useState } from "preact/hooks";
import { theme as themeOf } from "../colour";
import { stepsTable } from "../csv";
import { given } from "../format";
import { saveText } from "../png";
import { useTheme } from "../theme";
import { Figure } from "./figure";
import { contentOf } from "./figures";
import type { Report } from "./record";

const report = JSON.parse(document.getElementById("record")!.textContent!) as Report;
const lines = report.kind === "assimilation" ? report.lines : [];

interface Look {
  dark: boolean;
  /** Index of the step. */
  chosen: number;
}

interface Place {
  id: string;
  name: string;
  element: Element;
  /** What is drawn there; nothing yet. */
  drawn?: Look;
  seen: boolean;
}

let look: Look = { dark: false, chosen: lines.length - 1 };
let choose: (index: number) => void = () => {};

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
      content={contentOf(report, place.id, theme, look.chosen)}
      theme={theme}
      paper={themeOf(false)}
      name={place.name}
      selected={lines[look.chosen]?.time}
      onSelect={(time) => {
        let best = 0;
        lines.forEach((l, i) => {
          if (Math.abs(l.time - time) < Math.abs(lines[best]!.time - time)) best = i;
        });
        choose(best);
      }}
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
  const [chosen, setChosen] = useState(lines.length - 1);
  choose = setChosen;
  useEffect(() => update({ dark, chosen }), [dark, chosen]);
  const line = lines[chosen];
  return (
    <>
      {line && lines.length > 1 && (
        <label class="steps">
          Step{" "}
          <input
            type="range"
            min={0}
            max={lines.length - 1}
            value={chosen}
            aria-valuetext={`step ${line.step}`}
            onInput={(e) => setChosen(Number(e.currentTarget.value))}
          />
          <span>
            {line.step}, t = {given(line.time)}
            {chosen === lines.length - 1 ? " (last)" : ""}
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
      <button type="button" onClick={nextTheme} aria-label={`Colours: ${choice}`}>
        {choice === "system" ? "◐ as system" : choice === "dark" ? "● dark" : "○ light"}
      </button>
    </>
  );
}

document.documentElement.classList.add("drawn");
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
