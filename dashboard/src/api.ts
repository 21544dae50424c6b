/** Talking to the service: requests with the token, and the stream of events, taken up again where it broke. */
import { asStepLine, EventParser, isNumber, isObject, parseStates, tryJson } from "./parse";
import type {
  Entry,
  Event,
  FieldsAnswer,
  Held,
  Model,
  SamplesAnswer,
  SensorsAnswer,
  SignalAnswer,
  Status,
  StepLine,
  TestRecord,
} from "./types";
import {
  asAlarm,
  asEntry,
  asFields,
  asMesh,
  asModel,
  asQuarantine,
  asSamples,
  asSensors,
  asStatus,
  asTests,
} from "./wire";

export class HttpError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
}

const tokenKey = "knothe-token";
const sendingTokenKey = "knothe-sending-token";
/** The service sends at least a comment every 15 s. */
const silence = 40000;
const firstPause = 400;
const longestPause = 5000;

export class Api {
  private token: string | undefined;
  private sendingToken: string | undefined;
  site: string | undefined;

  constructor() {
    const given = /[#&]token=([^&]+)/.exec(location.hash);
    try {
      if (given?.[1]) {
        sessionStorage.setItem(tokenKey, decodeURIComponent(given[1]));
        history.replaceState(null, "", location.pathname + location.search);
      }
      this.token = sessionStorage.getItem(tokenKey) ?? undefined;
      this.sendingToken = sessionStorage.getItem(sendingTokenKey) ?? undefined;
    } catch {
      this.token = given?.[1];
    }
    this.site = new URLSearchParams(location.search).get("site") ?? undefined;
  }

  setToken(token: string): void {
    this.token = token;
    try {
      sessionStorage.setItem(tokenKey, token);
    } catch {
      // A browser without storage asks again next time.
    }
  }

  /** For what changes something: the service may want another token for it. */
  setSendingToken(token: string): void {
    this.sendingToken = token;
    try {
      sessionStorage.setItem(sendingTokenKey, token);
    } catch {
      // As above.
    }
  }

  /** Asks the service to do something; its answer. */
  private async post(path: string, body: Record<string, unknown>): Promise<unknown> {
    const token = this.sendingToken ?? this.token;
    const headers = { "Content-Type": "application/json", ...(token ? { Authorization: `Bearer ${token}` } : {}) };
    return JSON.parse(
      await textOf(path, await fetch(this.url(path), { method: "POST", headers, body: JSON.stringify(body) })),
    ) as unknown;
  }

  async acknowledge(alarm: number, by: string, comment: string): Promise<void> {
    await this.post(`v1/alarms/${alarm}/acknowledge`, { by, comment });
  }

  /** Assimilates a datum in quarantine after all, or takes it out for ever; who did it stands in the logbook. */
  async decide(what: "release" | "withdraw", held: Held, by: string, why: string): Promise<void> {
    const { source, session, seq } = held;
    await this.post(what === "release" ? "v1/quarantine" : "v1/withdraw", { source, session, seq, by, comment: why });
  }

  async note(step: number, by: string, text: string): Promise<void> {
    await this.post("v1/notes", { step, by, text });
  }

  /** Switches a sensor, from a step on. */
  async switchSensor(
    what: { sensor: number | string; active: boolean; step: number },
    by: string,
    comment: string,
  ): Promise<void> {
    await this.post("v1/sensors", { ...what, by, comment });
  }

  /** Ends the test, or takes that back. */
  async finish(finished: boolean, by: string, comment: string): Promise<void> {
    await this.post(`v1/tests/${finished ? "finish" : "resume"}`, { by, comment });
  }

  /** Begins another test, from the prior; the one that runs is finished. */
  async begin(name: string, by: string, comment: string): Promise<void> {
    await this.post("v1/tests", { name, by, comment });
  }

  /** Goes back to an earlier test. */
  async goBack(name: string, by: string, comment: string): Promise<void> {
    await this.post("v1/tests/resume", { name, by, comment });
  }

  private url(path: string, query: Record<string, string | number> = {}): string {
    const all = new URLSearchParams(Object.entries(query).map(([k, v]) => [k, String(v)]));
    if (this.site) all.set("site", this.site);
    const text = all.toString();
    return text ? `${path}?${text}` : path;
  }

  private headers(more: Record<string, string> = {}): Record<string, string> {
    return this.token ? { ...more, Authorization: `Bearer ${this.token}` } : more;
  }

  private async text(path: string, query?: Record<string, string | number>): Promise<string> {
    const answer = await fetch(this.url(path, query), { headers: this.headers(), cache: "no-store" });
    return textOf(path, answer);
  }

  private async json(path: string, query?: Record<string, string | number>): Promise<unknown> {
    return JSON.parse(await this.text(path, query)) as unknown;
  }

  async model(): Promise<Model | undefined> {
    return asModel(await this.json("v1/description"));
  }

  async mesh(): Promise<Pick<Model, "mesh" | "sensors">> {
    return asMesh(await this.json("v1/mesh"));
  }

  async status(): Promise<Status | undefined> {
    return asStatus(await this.json("v1/status"));
  }

  async alarms(): Promise<Event[]> {
    const answer = await this.json("v1/alarms");
    const list = isObject(answer) && Array.isArray(answer.alarms) ? answer.alarms : [];
    return list.map(asAlarm).filter((alarm): alarm is Event => alarm !== undefined);
  }

  async logbook(): Promise<Entry[]> {
    const answer = await this.json("v1/logbook");
    const list = isObject(answer) && Array.isArray(answer.logbook) ? answer.logbook : [];
    return list.map(asEntry).filter((entry): entry is Entry => entry !== undefined);
  }

  async tests(): Promise<TestRecord[]> {
    return asTests(await this.json("v1/tests"));
  }

  async quarantine(): Promise<Held[]> {
    return asQuarantine(await this.json("v1/quarantine"));
  }

  /** The lines of a test that does not run now. */
  async statesOf(test: string): Promise<StepLine[]> {
    return parseStates(await this.text("v1/states", { test }));
  }

  async states(from: number): Promise<StepLine[]> {
    return parseStates(await this.text("v1/states", { from }));
  }

  /** The displacement, and the field that is looked at. */
  async fields(step: number, wanted: string): Promise<FieldsAnswer> {
    const [name = "", parameter] = wanted.split(":");
    const other =
      parameter !== undefined || name === "bias"
        ? this.json("v1/field", { name, step, ...(parameter === undefined ? {} : { parameter }) })
        : undefined;
    const [displacement, more] = await Promise.all([
      this.json("v1/field", { name: "displacement", step }),
      name === "bias" ? absentIs404(other!) : other,
    ]);
    return asFields(displacement, wanted, more);
  }

  async sensors(step: number, wanted: string): Promise<SensorsAnswer> {
    const field = (name: string): Promise<unknown> => absentIs404(this.json("v1/field", { name, step }));
    const [observations, residual, bias] = await Promise.all([
      this.json("v1/observations", { step }),
      field("residual"),
      wanted === "bias" ? field("bias") : undefined,
    ]);
    return asSensors(observations, residual, bias);
  }

  async samples(step: number): Promise<SamplesAnswer> {
    return asSamples(await this.json("v1/samples", { step }));
  }

  /** A sensor by index or name, up to a step and predicted by its posterior. */
  async signal(step: number, sensor: string): Promise<SignalAnswer> {
    return (await this.json("v1/signal", { sensor, step })) as SignalAnswer;
  }

  /** The picture that a step was measured in. */
  async picture(step: number): Promise<ImageBitmap> {
    const answer = await fetch(this.url("v1/picture", { step }), { headers: this.headers(), cache: "no-store" });
    if (!answer.ok) throw new HttpError(answer.status, `v1/picture: HTTP ${answer.status}`);
    return createImageBitmap(await answer.blob());
  }

  /** One connection, until it ends; the id of the last event is kept in `cursor`. Without one, lines of steps from `cursor.from` are asked for. */
  async events(cursor: Cursor, listener: EventListener, signal: AbortSignal): Promise<void> {
    const headers = this.headers({ Accept: "text/event-stream" });
    if (cursor.id !== undefined) headers["Last-Event-ID"] = cursor.id;
    const quiet = new AbortController();
    const stop = (): void => quiet.abort();
    signal.addEventListener("abort", stop);
    let watch = setTimeout(stop, silence);
    try {
      const query: Record<string, number> = cursor.id === undefined ? { from: cursor.from } : {};
      const answer = await fetch(this.url("v1/events", query), { headers, cache: "no-store", signal: quiet.signal });
      if (!answer.ok || !answer.body) throw new HttpError(answer.status, `v1/events: HTTP ${answer.status}`);
      listener.opened();
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      const parser = new EventParser();
      for (;;) {
        const { done, value } = await reader.read();
        if (done) return;
        clearTimeout(watch);
        watch = setTimeout(stop, silence);
        for (const event of parser.push(value)) {
          if (event.id !== undefined) cursor.id = event.id;
          const content = tryJson(event.data);
          const line = event.event === "step" || event.event === "message" ? asStepLine(content) : undefined;
          if (line) listener.line(line);
          if (event.event === "withdrawn" && isObject(content) && isNumber(content.step)) listener.gone(content.step);
          const status = event.event === "status" ? asStatus(content) : undefined;
          if (status) listener.status(status);
          const alarm = event.event === "alarm" ? asAlarm(content) : undefined;
          if (alarm) listener.alarm(alarm);
          const entry = event.event === "logbook" ? asEntry(content) : undefined;
          if (entry) listener.entry(entry);
        }
      }
    } finally {
      clearTimeout(watch);
      signal.removeEventListener("abort", stop);
    }
  }

  /** Connects, and connects again, until `signal`. Before each connection `prepare` fetches what events do not bring. */
  async follow(
    prepare: (cursor: Cursor) => Promise<void>,
    listener: EventListener,
    signal: AbortSignal,
  ): Promise<void> {
    const cursor: Cursor = { from: 0 };
    let pause = firstPause;
    while (!signal.aborted) {
      const watching = {
        ...listener,
        opened: (): void => {
          pause = firstPause;
          listener.opened();
        },
      };
      try {
        await prepare(cursor);
        await this.events(cursor, watching, signal);
        listener.lost(undefined);
      } catch (error) {
        if (signal.aborted) return;
        listener.lost(error instanceof HttpError ? error : undefined);
        if (error instanceof HttpError && error.status === 401) return;
      }
      await new Promise((resolve) => setTimeout(resolve, pause * (0.8 + 0.4 * Math.random())));
      pause = Math.min(longestPause, pause * 1.6);
    }
  }
}

export interface Cursor {
  id?: string;
  from: number;
}

export interface EventListener {
  opened(): void;
  line(line: StepLine): void;
  /** All data of a step were withdrawn: it no longer has a line. */
  gone(step: number): void;
  status(status: Status): void;
  alarm(alarm: Event): void;
  entry(entry: Entry): void;
  lost(error: HttpError | undefined): void;
}

async function textOf(path: string, answer: Response): Promise<string> {
  const text = await answer.text();
  if (answer.ok) return text;
  const error = (tryJson(text) as { error?: { message?: string } } | undefined)?.error;
  throw new HttpError(answer.status, error?.message ?? `${path}: HTTP ${answer.status}`);
}

/** What a service does not have is no error. */
export async function absentIs404<T>(answer: Promise<T>): Promise<T | undefined> {
  try {
    return await answer;
  } catch (error) {
    if (error instanceof HttpError && error.status === 404) return undefined;
    throw error;
  }
}
