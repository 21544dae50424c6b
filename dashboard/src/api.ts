/** Talking to the service: requests with the token, and the stream of events, taken up again where it broke. */
import { asModel, asStatus, asStepLine, EventParser, parseStates, tryJson } from "./parse";
import type { FieldsAnswer, Model, SamplesAnswer, SensorsAnswer, Status, StepLine } from "./types";

export class HttpError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
}

const tokenKey = "knothe-token";
/** The service sends at least a comment every 15 s. */
const silence = 40000;
const firstPause = 400;
const longestPause = 5000;

export class Api {
  private token: string | undefined;
  site: string | undefined;

  constructor() {
    const given = /[#&]token=([^&]+)/.exec(location.hash);
    try {
      if (given?.[1]) {
        sessionStorage.setItem(tokenKey, decodeURIComponent(given[1]));
        history.replaceState(null, "", location.pathname + location.search);
      }
      this.token = sessionStorage.getItem(tokenKey) ?? undefined;
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
    const text = await answer.text();
    if (!answer.ok) {
      const error = (tryJson(text) as { error?: { message?: string } } | undefined)?.error;
      throw new HttpError(answer.status, error?.message ?? `${path}: HTTP ${answer.status}`);
    }
    return text;
  }

  private async json(path: string, query?: Record<string, string | number>): Promise<unknown> {
    return JSON.parse(await this.text(path, query)) as unknown;
  }

  async model(): Promise<Model | undefined> {
    return asModel(await this.json("v1/model"));
  }

  async status(): Promise<Status | undefined> {
    return asStatus(await this.json("v1/status"));
  }

  async sites(): Promise<string[]> {
    const answer = (await this.json("v1/sites")) as { sites?: unknown };
    return Array.isArray(answer.sites) ? answer.sites.map(String) : [];
  }

  async states(from: number): Promise<StepLine[]> {
    return parseStates(await this.text("v1/states", { from }));
  }

  fields(step: number): Promise<FieldsAnswer> {
    return this.json("v1/fields", { step }) as Promise<FieldsAnswer>;
  }

  sensors(step: number): Promise<SensorsAnswer> {
    return this.json("v1/sensors", { step }) as Promise<SensorsAnswer>;
  }

  samples(step: number): Promise<SamplesAnswer> {
    return this.json("v1/samples", { step }) as Promise<SamplesAnswer>;
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
          const line = event.event === "status" ? undefined : asStepLine(content);
          if (line) listener.line(line);
          const status = event.event === "status" ? asStatus(content) : undefined;
          if (status) listener.status(status);
        }
      }
    } finally {
      clearTimeout(watch);
      signal.removeEventListener("abort", stop);
    }
  }

  /** Connects, and connects again, until `signal`. Before each connection `prepare` fetches what events do not bring. */
  async follow(prepare: (cursor: Cursor) => Promise<void>, listener: EventListener, signal: AbortSignal): Promise<void> {
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
  status(status: Status): void;
  lost(error: HttpError | undefined): void;
}
