/** What was stored and is not assimilated, newest first, with the reason: it is released or withdrawn here. */
import { useState } from "preact/hooks";
import type { Api } from "./api";
import { csv } from "./csv";
import { Panel } from "./panel";
import { SignedForm } from "./signed_form";
import type { Held } from "./types";

const shown = 200;

interface Props {
  held: readonly Held[];
  api: Api;
}

export function QuarantinePanel({ held, api }: Props) {
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
            <Entry key={`${h.source} ${h.session} ${h.seq}`} held={h} api={api} />
          ))}
      </ol>
    </Panel>
  );
}

const actions = {
  release: { button: "Release", outcome: "is assimilated after all" },
  withdraw: { button: "Withdraw", outcome: "can never be released" },
} as const;

function Entry({ held, api }: { held: Held; api: Api }) {
  const [chosen, choose] = useState<keyof typeof actions>();
  const name = `${held.source}, ${held.session}, ${held.seq}`;
  return (
    <li class="warning">
      <p>
        <b>{name}</b> (step {held.step}): {held.reason}
      </p>
      {chosen ? (
        <SignedForm
          api={api}
          label="why"
          needed={false}
          button={actions[chosen].button}
          confirm={`The datum ${name} ${actions[chosen].outcome}.`}
          send={(by, why) => api.decide(chosen, held, by, why)}
          done={() => choose(undefined)}
        />
      ) : (
        <>
          <button type="button" class="answer" onClick={() => choose("release")}>
            release …
          </button>
          <button type="button" class="answer" onClick={() => choose("withdraw")}>
            withdraw …
          </button>
        </>
      )}
    </li>
  );
}
