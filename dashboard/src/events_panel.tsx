/** What happened, newest first, by kind and source, with its cause; a click looks at its step. Alarms of the service can be acknowledged. */
import { useState } from "preact/hooks";
import type { Api } from "./api";
import { severitySign } from "./colour";
import { csv } from "./csv";
import { grouped, isOpen, type EventGroup } from "./events";
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

export function EventsPanel({ events, ...rest }: Props) {
  const alarms = events.filter((e) => e.severity === "alarm").length;
  const warnings = events.filter((e) => e.severity === "warning").length;
  const open = events.filter(isOpen);
  return (
    <Panel
      id="events"
      title="Alarms and their causes"
      note={`${counted(alarms, "alarm")}, ${counted(warnings, "warning")} so far${open.length > 0 ? `, ${open.length} not acknowledged` : ""}. Choose one to look at its step.`}
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
      <p class="hidden" role="alert" aria-live="assertive" id="announced">
        {open[0] && `${open[0].severity} at step ${open[0].step}: ${open[0].message}`}
      </p>
      <ol class="events" tabIndex={0} aria-label="Alarms, newest first">
        {grouped(events)
          .slice(0, shown)
          .map((group) => (
            <Group key={keyOf(group)} group={group} {...rest} />
          ))}
        {events.length === 0 && <li class="none">Nothing so far.</li>}
      </ol>
    </Panel>
  );
}

/** The newest of its kind; the others behind a word. All are answered together. */
function Group({ group, api, ...rest }: { group: EventGroup } & Omit<Props, "events">) {
  const [answering, setAnswering] = useState(false);
  const { latest, all, open } = group;
  const earlier = all.slice(1);
  const together = open.length > 1 ? ` all ${open.length}` : "";
  const send = async (by: string, comment: string): Promise<void> => {
    for (const { id } of open) await api.acknowledge(id!, by, comment);
  };
  return (
    <li class={`${latest.severity} ${latest.acknowledged ? "answered" : ""}`}>
      <Row event={latest} {...rest} />
      {earlier.length > 0 && (
        <details class="earlier">
          <summary>{counted(earlier.length, "earlier one")}</summary>
          {earlier.slice(0, shown).map((e) => (
            <Row key={`${e.step} ${e.id} ${e.message}`} event={e} {...rest} />
          ))}
        </details>
      )}
      {open.length > 0 && !answering && (
        <button type="button" class="answer" onClick={() => setAnswering(true)}>
          acknowledge{together}
        </button>
      )}
      {open.length > 0 && answering && (
        <SignedForm
          api={api}
          label="comment"
          needed={false}
          button={`Acknowledge${together}`}
          send={send}
          done={() => setAnswering(false)}
        />
      )}
    </li>
  );
}

function Row({ event, chosen, choose }: { event: Event } & Pick<Props, "chosen" | "choose">) {
  return (
    <>
      <button type="button" aria-current={chosen === event.step} onClick={() => choose(event.step)}>
        <span class="sign" aria-hidden="true">
          {event.acknowledged ? "✓" : severitySign[event.severity]}
        </span>
        <span class="at">
          step {event.step}
          {event.raised_at !== undefined && <small> {clock(event.raised_at)}</small>}
        </span>
        <span>
          <span class="hidden">{event.severity}: </span>
          {event.message}
        </span>
      </button>
      {event.acknowledged && <Answer {...event.acknowledged} />}
    </>
  );
}

/** Of the oldest: the same while newer ones come. */
function keyOf({ all }: EventGroup): string {
  const first = all[all.length - 1]!;
  return `${first.step} ${first.kind} ${first.message} ${first.id}`;
}

function counted(count: number, what: string): string {
  return `${count} ${what}${count === 1 ? "" : "s"}`;
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
