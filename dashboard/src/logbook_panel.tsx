/** What people did and said, newest first; a note can be added at the step that is looked at. */
import { useState } from "preact/hooks";
import type { Api } from "./api";
import type { Note } from "./chart";
import { csv } from "./csv";
import { clock, timeWords } from "./format";
import { Panel } from "./panel";
import { SensorForm } from "./sensor_form";
import { SignedForm } from "./signed_form";
import { testWords } from "./tests_panel";
import type { Entry, Model, StepLine } from "./types";

const shown = 200;

/** An entry in words, without its author. */
export function entryWords(entry: Entry, timeUnits?: string): string {
  const at = timeWords(entry.time, timeUnits);
  const why = entry.text ? `: ${entry.text}` : "";
  if (entry.kind === "sensor_off") return `sensor ${entry.sensor} switched off from ${at} on${why}`;
  if (entry.kind === "sensor_on") return `sensor ${entry.sensor} switched on from ${at} on${why}`;
  if (entry.kind === "test_finished") return `finished the test${why}`;
  if (entry.kind === "test_resumed") return `resumed the test${why}`;
  if (entry.kind === "test_begun") return `began this test${why}`;
  if (entry.kind === "verification_asked") return `asked the full-order model${why}`;
  if (entry.kind === "test_followed") return `went on to ${testWords(entry.text)}`;
  return entry.text;
}

/** What is marked in the plots: notes, and what was switched. */
export function notesIn(entries: readonly Entry[]): Note[] {
  return entries
    .filter((e) => e.kind === "note" || e.kind === "sensor_off" || e.kind === "sensor_on")
    .map((e) => ({ at: e.time, by: e.by, text: markWords(e) }));
}

function markWords(entry: Entry): string {
  if (entry.kind === "note") return entry.text.replace(/\s+/g, " ");
  const why = entry.text ? `: ${entry.text}` : "";
  return `sensor ${entry.sensor} ${entry.kind === "sensor_off" ? "off" : "on"}${why}`;
}

export function LogbookPanel({
  entries,
  line,
  api,
  model,
  off,
}: {
  entries: readonly Entry[];
  line: StepLine | undefined;
  api: Api;
  model: Model | undefined;
  /** Sensors that are switched off. */
  off: readonly number[];
}) {
  const [finishing, setFinishing] = useState(false);
  const marks = entries.filter((e) => e.kind.startsWith("test_"));
  const finished = marks[marks.length - 1]?.kind === "test_finished";
  // Acknowledgements stand at their alarms.
  const listed = entries.filter((e) => e.kind !== "acknowledgement").reverse();
  return (
    <Panel
      id="logbook"
      title="Logbook"
      note="Notes, and sensors that were switched off or on: kept with the data, and marked in the plots."
      csv={() =>
        csv(
          ["number", "kind", "time", "by", "text", "written_at"],
          entries.map((e) => [e.number, e.kind, e.time, e.by, e.text, e.written_at]),
        )
      }
    >
      {line && (
        <SignedForm
          api={api}
          label={`note at step ${line.step}`}
          needed={true}
          button="Write"
          send={(by, text) => api.note(line.step, by, text)}
          done={() => undefined}
        />
      )}
      {line && <SensorForm api={api} model={model} off={off} step={line.step} />}
      {finishing ? (
        <SignedForm
          api={api}
          label="comment"
          needed={false}
          button={finished ? "Resume the test" : "Finish the test"}
          send={(by, comment) => api.finish(!finished, by, comment)}
          done={() => setFinishing(false)}
        />
      ) : (
        <button type="button" class="answer" onClick={() => setFinishing(true)}>
          {finished ? "resume the test …" : "finish the test …"}
        </button>
      )}
      <ol class="events" tabIndex={0} aria-label="Logbook, newest first">
        {listed.slice(0, shown).map((e) => (
          <li key={e.number}>
            <p>
              <b>{e.by}</b>{" "}
              <span class="at">
                {timeWords(e.time, model?.time?.units)}
                {e.written_at === undefined ? "" : `, ${clock(e.written_at)}`}
              </span>{" "}
              {entryWords(e, model?.time?.units)}
            </p>
          </li>
        ))}
        {listed.length === 0 && <li class="none">Nothing so far.</li>}
      </ol>
    </Panel>
  );
}
