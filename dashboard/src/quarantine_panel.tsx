/** What was stored and is not assimilated, newest first, with the reason; the page changes nothing of it. */
import { csv } from "./csv";
import { Panel } from "./panel";
import type { Held } from "./types";

const shown = 200;

export function QuarantinePanel({ held }: { held: readonly Held[] }) {
  if (held.length === 0) return null;
  const data = held.length === 1 ? "1 datum is" : `${held.length} data are`;
  return (
    <Panel
      id="quarantine"
      title="In quarantine"
      note={`${data} stored and not assimilated, until released or withdrawn.`}
      csv={() =>
        csv(
          ["source", "session", "seq", "step", "reason"],
          held.map((h) => [h.source, h.session, h.seq, h.step, h.reason]),
        )
      }
    >
      <ol class="events" tabIndex={0} aria-label="Data in quarantine, newest first">
        {[...held]
          .reverse()
          .slice(0, shown)
          .map((h) => (
            <li key={`${h.source} ${h.session} ${h.seq}`} class="warning">
              <p>
                <b>
                  {h.source}, {h.session}, {h.seq}
                </b>{" "}
                (step {h.step}): {h.reason}
              </p>
            </li>
          ))}
      </ol>
    </Panel>
  );
}
