/** What happened, newest first, with its cause; a click looks at its step. */
import { severitySign } from "./colour";
import { csv } from "./csv";
import { Panel } from "./panel";
import type { Event } from "./types";

const shown = 200;

export function EventsPanel({
  events,
  chosen,
  choose,
}: {
  events: readonly Event[];
  chosen: number | undefined;
  choose: (step: number) => void;
}) {
  const alarms = events.filter((e) => e.severity === "alarm").length;
  const warnings = events.filter((e) => e.severity === "warning").length;
  return (
    <Panel
      id="events"
      title="Alarms and their causes"
      note={`${alarms} alarms, ${warnings} warnings so far. Choose one to look at its step.`}
      csv={() =>
        csv(
          ["step", "severity", "kind", "message"],
          events.map((e) => [e.step, e.severity, e.kind, e.message]),
        )
      }
    >
      <ol class="events" tabIndex={0} aria-label="Alarms, newest first">
        {events.slice(0, shown).map((e) => (
          <li key={`${e.step} ${e.kind} ${e.message}`} class={e.severity}>
            <button type="button" aria-current={chosen === e.step} onClick={() => choose(e.step)}>
              <span class="sign" aria-hidden="true">
                {severitySign[e.severity]}
              </span>
              <span class="at">step {e.step}</span>
              <span>
                <span class="hidden">{e.severity}: </span>
                {e.message}
              </span>
            </button>
          </li>
        ))}
        {events.length === 0 && <li class="none">Nothing so far.</li>}
      </ol>
    </Panel>
  );
}
