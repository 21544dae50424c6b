/** Keys, the words of the state, and how to read the pictures. */
import { useEffect, useRef, useState } from "preact/hooks";
import { levelLook, quietLook, stateLook } from "./colour";
import { levelWords, usual, usualLevel, usualQuiet } from "./state";
import { quietWords, stateWords, verdictLevels, type StateWord } from "./types";

export const keys: [string, string][] = [
  ["← →", "one step back, forward"],
  ["Shift + ← →", "ten steps"],
  ["Home, End or L", "first step, live"],
  ["Space", "play the steps, stop"],
  ["1 … 6", "go to forecast, parameters, field, pairs, evidence, time"],
  ["F", "next field on the structure"],
  ["Q", "next forecast"],
  ["T", "light, dark, as the system"],
  ["?", "this help"],
];

export function Help({ open, close, version }: { open: boolean; close: () => void; version: string | undefined }) {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    if (open && !dialog.current!.open) dialog.current!.showModal();
    if (!open && dialog.current!.open) dialog.current!.close();
  }, [open]);
  return (
    <dialog ref={dialog} onClose={close} aria-labelledby="help-title">
      <h2 id="help-title">How to read this page</h2>
      <dl class="states">
        {stateWords
          .filter((word) => word !== "STALE")
          .map((word) => (
            <Meaning key={word} word={word} look={stateLook[word]} means={usual[word]} />
          ))}
        {quietWords.map((word) => (
          <Meaning key={word} word={word} look={quietLook[word]} means={usualQuiet[word]} />
        ))}
        {verdictLevels.map((level) => (
          <Meaning key={level} word={levelWords[level]} look={levelLook[level]} means={usualLevel[level]} />
        ))}
      </dl>
      <ul>
        <li>
          Dark and light bands: half, and nearly all, of the probability. The thin upright line is the step looked at;
          grey columns are times without data.
        </li>
        <li>
          P(failure) is the probability that the forecast quantity exceeds the threshold of the project file, given the
          model and all data so far.
        </li>
        <li>Click into a plot to look at that time; drag in it to enlarge, double-click to see all.</li>
        <li>
          Drag on the structure turns it, with Shift shifts it; after a click on it, or with Ctrl, the wheel enlarges.
        </li>
        <li>CSV files hold SI units and full precision.</li>
      </ul>
      <table>
        <tbody>
          {keys.map(([key, what]) => (
            <tr key={key}>
              <th scope="row">
                <kbd>{key}</kbd>
              </th>
              <td>{what}</td>
            </tr>
          ))}
        </tbody>
      </table>
      <form method="dialog">
        <span>{version ? `knothe ${version}` : "knothe"}</span>
        <button>Close</button>
      </form>
    </dialog>
  );
}

export function TokenDialog({ needed, use }: { needed: "first" | "wrong" | undefined; use: (token: string) => void }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const [token, setToken] = useState("");
  useEffect(() => {
    if (needed && !dialog.current!.open) dialog.current!.showModal();
    if (!needed && dialog.current!.open) dialog.current!.close();
  }, [needed]);
  return (
    <dialog ref={dialog} aria-labelledby="token-title">
      <h2 id="token-title">Token</h2>
      <p>
        {needed === "wrong"
          ? "The service does not know this token."
          : "This service asks who reads: paste the token for reading."}{" "}
        It is kept for this browser tab only.
      </p>
      <form onSubmit={(e) => (e.preventDefault(), use(token.trim()))}>
        <input
          type="password"
          autoComplete="off"
          aria-label="Token"
          value={token}
          onInput={(e) => setToken(e.currentTarget.value)}
        />
        <button>Connect</button>
      </form>
    </dialog>
  );
}

function Meaning({ word, look, means }: { word: string; look: (typeof stateLook)[StateWord]; means: string }) {
  return (
    <div>
      <dt>
        <span class="chip" style={{ background: look.colour, color: look.ink }}>
          {look.sign} {word}
        </span>
      </dt>
      <dd>{means}</dd>
    </div>
  );
}
