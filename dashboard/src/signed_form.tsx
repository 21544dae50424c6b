/** A short form for what changes something at the service: who asks, what they say, and the token where one is needed. */
import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import { HttpError, type Api } from "./api";

const nameKey = "knothe-name";

function rememberedName(): string {
  try {
    return localStorage.getItem(nameKey) ?? "";
  } catch {
    return "";
  }
}

export interface SignedFormProps {
  api: Api;
  /** What the text is, and whether there must be one. */
  label: string;
  needed: boolean;
  button: string;
  /** What else there is to fill in, in front. */
  children?: ComponentChildren;
  /** What will happen, in words: asked for before it does. */
  confirm?: string;
  send: (by: string, text: string) => Promise<void>;
  done: () => void;
}

export function SignedForm({ api, label, needed, button, children, confirm, send, done }: SignedFormProps) {
  const [typed, setBy] = useState<string>();
  const by = typed ?? rememberedName(); // what another form has learnt meanwhile counts here too
  const [text, setText] = useState("");
  const [token, setToken] = useState<string>();
  const [problem, setProblem] = useState("");
  const [asking, setAsking] = useState(false);
  const submit = async (): Promise<void> => {
    if (token !== undefined) api.setSendingToken(token.trim());
    try {
      localStorage.setItem(nameKey, by);
    } catch {
      // Asked again next time.
    }
    try {
      await send(by.trim(), text.trim());
      setText("");
      setProblem("");
      done();
    } catch (error) {
      setAsking(false);
      if (error instanceof HttpError && error.status === 401) setToken((t) => t ?? "");
      setProblem(error instanceof HttpError ? error.message : "No contact with the service.");
    }
  };
  if (asking)
    return (
      <form class="signed" onSubmit={(e) => (e.preventDefault(), void submit())}>
        <p class="confirm" role="alert">
          {confirm}
        </p>
        <button class="primary">Yes: {button.toLowerCase()}</button>
        <button type="button" onClick={() => setAsking(false)}>
          No
        </button>
      </form>
    );
  return (
    <form class="signed" onSubmit={(e) => (e.preventDefault(), confirm ? setAsking(true) : void submit())}>
      {children}
      <input
        aria-label="Your name"
        placeholder="your name"
        required
        maxLength={120}
        value={by}
        onInput={(e) => setBy(e.currentTarget.value)}
      />
      <input
        aria-label={label}
        placeholder={label}
        required={needed}
        maxLength={1000}
        value={text}
        onInput={(e) => setText(e.currentTarget.value)}
      />
      {token !== undefined && (
        <input
          type="password"
          autoComplete="off"
          aria-label="Token for sending"
          placeholder="token for sending"
          required
          value={token}
          onInput={(e) => setToken(e.currentTarget.value)}
        />
      )}
      <button>{button}</button>
      {problem && <p class="problem">{problem}</p>}
    </form>
  );
}
