/** The tests of this structure, one a specimen: which one runs, and how the next one is begun. */
import { useState } from "preact/hooks";
import type { Api } from "./api";
import { clock } from "./format";
import { Panel } from "./panel";
import { SignedForm } from "./signed_form";
import type { TestRecord } from "./types";

export function testWords(name: string): string {
  return name ? `test "${name}"` : "the unnamed test";
}

/** When it was begun, how much it holds, whether it goes on. */
export function testState(test: TestRecord): string {
  if (test.problem) return test.problem;
  const begun = test.begun_at === undefined ? [] : [`begun ${clock(test.begun_at)}`];
  const held =
    test.current || test.records === undefined ? [] : [test.records === 1 ? "1 datum" : `${test.records} data`];
  const state = test.current ? (test.finished ? "finished" : "running") : test.finished ? "finished" : "not finished";
  return [...begun, ...held, state].join(", ");
}

const letters = "[A-Za-z0-9_\\-]{1,64}";

interface Props {
  tests: readonly TestRecord[];
  api: Api;
  compare: (name: string) => void;
}

export function TestsPanel({ tests, api, compare }: Props) {
  const [beginning, setBeginning] = useState(false);
  const [back, setBack] = useState<string>();
  const [name, setName] = useState("");
  const current = tests.find((test) => test.current);
  if (!current) return null;
  return (
    <Panel id="tests" title="Tests" note="Start a new test for each specimen; earlier tests are kept.">
      {beginning ? (
        <SignedForm
          api={api}
          label="comment"
          needed={false}
          button="Begin the next test"
          confirm={`Is the next specimen in place? ${capital(testWords(current.name))} is finished, and all data from now on go to test "${name}", which begins from the prior.`}
          send={(by, comment) => api.begin(name, by, comment)}
          done={() => (setBeginning(false), setName(""))}
        >
          <input
            aria-label="Name of the next test"
            placeholder="name of the next test"
            title="letters, digits, - and _"
            pattern={letters}
            required
            maxLength={64}
            value={name}
            onInput={(e) => setName(e.currentTarget.value)}
          />
        </SignedForm>
      ) : (
        <button type="button" class="answer" onClick={() => setBeginning(true)}>
          begin the next specimen's test …
        </button>
      )}
      <ol class="events tests" aria-label="Tests">
        {tests.map((test) => (
          <li key={test.name} class={test.current ? "current" : ""}>
            <p>
              <b>{test.name || "Unnamed test"}:</b> <span class="at">{testState(test)}</span>
            </p>
            {!test.current && !test.problem && back !== test.name && (
              <>
                <button type="button" class="answer" onClick={() => compare(test.name)}>
                  compare
                </button>
                <button type="button" class="answer" onClick={() => setBack(test.name)}>
                  go back to it …
                </button>
              </>
            )}
            {back === test.name && (
              <SignedForm
                api={api}
                label="comment"
                needed={false}
                button="Go back"
                confirm={`${capital(testWords(current.name))} is left, and all data from now on go to ${testWords(test.name)}.`}
                send={(by, comment) => api.goBack(test.name, by, comment)}
                done={() => setBack(undefined)}
              />
            )}
          </li>
        ))}
      </ol>
    </Panel>
  );
}

function capital(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
