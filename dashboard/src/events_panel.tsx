/** What happened, newest first, with its cause; a click looks at its step. Alarms of the service can be acknowledged. */
import { useState } from "preact/hooks";
import type { Api } from "./api";
import { severitySign } from "./colour";
import { csv } from "./csv";
import { clock } from "./format";
import { Panel } from "./panel";
import { SignedForm } from "./signed_form";
import type { Event } from "./types";

const shown = 200;

interface Props {
  events: readonly Event[];
  chosen: number | undefined;
  choose: (step: number) => void;
  api: Api;
}

export function EventsPanel({ events, chosen, choose, api }: Props) {
  const [answering, setAnswering] = useState<number>();
  const alarms = events.filter((e) => e.severity === "alarm").length;
  const warnings = events.filter((e) => e.severity === "warning").length;
  const open = events.filter(isOpen).length;
  return (
    <Panel
      id="events"
      title="Alarms and their causes"
      note={`${counted(alarms, "alarm")}, ${counted(warnings, "warning")} so far${open > 0 ? `, ${open} not acknowledged` : ""}. Choose one to look at its step.`}
      csv={() =>
        csv(
          ["step", "severity", "kind", "message", "raised_at", "acknowledged_by", "comment"],
          events.map((e) => [
            e.step,
            e.severity,
            e.kind,
            e.message,
            e.raised_at,
            e.acknowledged?.by,
            e.acknowledged?.comment,
          ]),
        )
      }
    >
      <ol class="events" tabIndex={0} aria-label="Alarms, newest first">
        {events.slice(0, shown).map((e) => (
          <li
            key={`${e.step} ${e.kind} ${e.message} ${e.id}`}
            class={`${e.severity} ${e.acknowledged ? "answered" : ""}`}
          >
            <button type="button" aria-current={chosen === e.step} onClick={() => choose(e.step)}>
              <span class="sign" aria-hidden="true">
                {e.acknowledged ? "✓" : severitySign[e.severity]}
              </span>
              <span class="at">
                step {e.step}
                {e.raised_at !== undefined && <small> {clock(e.raised_at)}</small>}
              </span>
              <span>
                <span class="hidden">{e.severity}: </span>
                {e.message}
              </span>
            </button>
            {e.acknowledged && <Answer {...e.acknowledged} />}
            {isOpen(e) && answering !== e.id && (
              <button type="button" class="answer" onClick={() => setAnswering(e.id)}>
                acknowledge
              </button>
            )}
            {isOpen(e) && answering === e.id && (
              <SignedForm
                api={api}
                label="comment"
                needed={false}
                button="Acknowledge"
                send={(by, comment) => api.acknowledge(e.id!, by, comment)}
                done={() => setAnswering(undefined)}
              />
            )}
          </li>
        ))}
        {events.length === 0 && <li class="none">Nothing so far.</li>}
      </ol>
    </Panel>
  );
}

function counted(count: number, what: string): string {
  return `${count} ${what}${count === 1 ? "" : "s"}`;
}

/** An alarm or warning of the service that nobody has acknowledged. */
function isOpen(event: Event): boolean {
  return event.id !== undefined && event.severity !== "info" && !event.acknowledged;
}

function Answer({ by, comment, at }: NonNullable<Event["acknowledged"]>) {
  return (
    <p class="answer">
      acknowledged by <b>{by}</b>
      {at === undefined ? "" : `, ${clock(at)}`}
      {comment && `: ${comment}`}
    </p>
  );
}
