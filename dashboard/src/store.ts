/** What the page knows, and who wants to hear when it changes. */
import { absentIs404, Api, HttpError, type Cursor } from "./api";
import { History } from "./history";
import { stateEvent } from "./events";
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

/** What belongs to one step and is fetched when it is looked at; `problem` says why there is none. */
export interface Detail<T> {
  value?: T;
  problem?: string;
}

const kinds = ["fields", "sensors", "samples", "signal"] as const;
type Kind = (typeof kinds)[number];
type Answers = { fields: FieldsAnswer; sensors: SensorsAnswer; samples: SamplesAnswer; signal: SignalAnswer };
/** The live step's details are fetched at most this often, ms, and not more than a fifth of the time is spent on it. */
const shortestInterval = 400;
/** What is not there need not be asked for ten times a second. */
const afterFailure = 3000;
const kept = 60;
const mostAlarms = 500;
const statusInterval = 2000;
const hiddenInterval = 500;
/** ms per step drawn: 20,000 steps are drawn once a second. */
const drawingInterval = 0.05;

/** An earlier test beside the one that runs. */
export interface Comparison {
  name: string;
  lines?: StepLine[];
  problem?: string;
}

export class Store {
  readonly api = new Api();
  readonly history = new History();
  model: Model | undefined;
  status: Status | undefined;
  /** Changes of state since the page was opened, newest first. */
  stateEvents: Event[] = [];
  /** What the service told. */
  alarms: Event[] = [];
  /** What people did and said, in the order of writing. */
  logbook: Entry[] = [];
  /** All tests of this structure, as they were when the page connected. */
  tests: TestRecord[] = [];
  comparison: Comparison | undefined;
  /** What is stored and not assimilated. */
  quarantine: Held[] = [];
  /** The field looked at: "displacement", "sensitivity:NAME", "residual", "bias". */
  wanted = "displacement";
  /** The signal looked at, by index or name, where one was chosen. */
  private wantedSignal: string | undefined;
  connected = false;
  lostAt: number | undefined;
  lastDatumAt: number | undefined;
  needsToken: "first" | "wrong" | undefined;
  problem: string | undefined;
  /** The step looked at; `undefined` follows the latest. */
  chosen: number | undefined;
  readonly detail: { [K in Kind]: Detail<Answers[K]> } = {
    fields: {},
    sensors: {},
    samples: {},
    signal: {},
  };

  private listeners = new Set<() => void>();
  private scheduled = false;
  private waiting: ReturnType<typeof setTimeout> | undefined;
  private drawnAt = 0;
  private stop = new AbortController();
  private cache = new Map<string, unknown>();
  private busy = new Set<Kind>();
  private notBefore = new Map<Kind, number>();
  private timer: ReturnType<typeof setTimeout> | undefined;
  private tokenTried = false;
  /** Answers to what was asked before everything was forgotten are not taken. */
  private epoch = 0;
  private poll: ReturnType<typeof setInterval> | undefined;

  subscribe(listener: () => void): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  /** At most one drawing per frame, however fast data come; fewer when thousands of steps are drawn. What a person does is shown at once. */
  changed(now = true): void {
    if (this.scheduled && !now) return;
    const run = (): void => {
      clearTimeout(this.waiting);
      this.scheduled = false;
      this.drawnAt = performance.now();
      this.listeners.forEach((listener) => listener());
    };
    const wait = document.hidden
      ? hiddenInterval
      : now
        ? 0
        : this.drawnAt + this.history.lines.length * drawingInterval - performance.now();
    clearTimeout(this.waiting);
    this.scheduled = true;
    this.waiting = setTimeout(() => (document.hidden ? run() : requestAnimationFrame(run)), Math.max(0, wait));
  }

  start(): void {
    this.stop.abort();
    this.stop = new AbortController();
    void this.api.follow(
      (cursor) => this.prepare(cursor),
      {
        opened: () => {
          this.connected = true;
          clearInterval(this.poll);
          this.poll = setInterval(() => void this.refreshStatus(), statusInterval);
          this.needsToken = undefined;
          this.problem = undefined;
          this.changed();
          void this.verify();
        },
        line: (line) => {
          this.take(line);
          this.lastDatumAt = performance.now();
          this.changed(false);
          this.fetchDetails();
        },
        gone: (step) => {
          this.forgetStep(step);
          this.changed();
          this.fetchDetails();
        },
        status: (status) => {
          // Another journal is another specimen: all that is known is of the one before.
          if (this.model?.journal !== undefined && status.journal !== this.model.journal) return this.start();
          this.takeStatus(status);
          this.changed();
        },
        alarm: (alarm) => {
          const others = this.alarms.filter((a) => alarm.id === undefined || a.id !== alarm.id);
          this.alarms = [alarm, ...others].slice(0, mostAlarms);
          this.changed();
        },
        entry: (entry) => {
          this.logbook = [...this.logbook.filter((e) => e.number !== entry.number), entry];
          if (entry.kind.startsWith("test_")) void this.fetchTests();
          this.changed();
        },
        lost: (error) => this.lost(error),
      },
      this.stop.signal,
    );
  }

  useToken(token: string): void {
    this.api.setToken(token);
    this.tokenTried = true;
    this.needsToken = undefined;
    this.start();
    this.changed();
  }

  /** Another site: nothing of the last one may stay. */
  useSite(site: string): void {
    this.api.site = site;
    const url = new URL(location.href);
    url.searchParams.set("site", site);
    history.replaceState(null, "", url);
    this.forget();
    this.model = undefined;
    this.status = undefined;
    this.start();
    this.changed();
  }

  get line(): StepLine | undefined {
    return this.chosen === undefined ? this.history.latest : (this.history.find(this.chosen) ?? this.history.latest);
  }

  /** Looks at a step; `undefined` is live. */
  choose(step: number | undefined): void {
    this.chosen = step;
    this.notBefore.clear();
    this.changed();
    this.fetchDetails();
  }

  get signal(): string {
    return this.wantedSignal ?? this.model?.signal ?? "0";
  }

  wantSignal(sensor: string): void {
    this.wantedSignal = sensor;
    this.notBefore.clear();
    this.changed();
    this.fetchDetails();
  }

  /** Looks at a field. */
  want(field: string): void {
    this.wanted = field;
    // Nobody who has just asked wants to wait for the pace of live data.
    this.notBefore.clear();
    this.changed();
    this.fetchDetails();
  }

  /** Sets a test beside the one that runs; `undefined`: none. */
  async compare(name: string | undefined): Promise<void> {
    const asked: Comparison | undefined = name === undefined ? undefined : { name };
    this.comparison = asked;
    this.changed();
    if (!asked) return;
    const answer = await this.api.statesOf(asked.name).then(
      (lines) => ({ lines }),
      (error: unknown) => ({
        problem: error instanceof HttpError ? error.message : "No contact with the service.",
      }),
    );
    if (this.comparison !== asked) return;
    this.comparison = { ...asked, ...answer };
    this.changed();
  }

  /** Looks `steps` further, backward if negative; past the end is live again. */
  move(steps: number): void {
    const { lines } = this.history;
    if (lines.length === 0) return;
    const at = this.chosen === undefined ? lines.length - 1 : this.history.position(this.chosen);
    const next = Math.max(0, at + steps);
    this.choose(next >= lines.length - 1 && steps > 0 ? undefined : lines[Math.min(next, lines.length - 1)]!.step);
  }

  private take(line: StepLine): void {
    if (this.history.find(line.step)) this.forgetDetails(line.step);
    this.history.add(line);
  }

  private forgetStep(step: number): void {
    this.forgetDetails(step);
    this.history.remove(step);
    if (this.chosen === step) this.chosen = undefined;
  }

  private forgetDetails(step: number): void {
    for (const key of this.cache.keys()) if (key.endsWith(` ${step}`)) this.cache.delete(key);
  }

  private takeStatus(status: Status): void {
    const event = stateEvent(this.status, status);
    if (event) this.stateEvents = [event, ...this.stateEvents].slice(0, 200);
    this.status = status;
    if ((status.quarantined ?? 0) !== this.quarantine.length) void this.fetchQuarantine();
    if (status.data_age_s !== undefined) this.lastDatumAt = performance.now() - 1000 * status.data_age_s;
  }

  /**
   * A service that was restarted with something else between the questions of `prepare` and the stream of events (the browser repeats a
   * request whose connection broke) would feed its steps to what the page knows of the other.
   */
  private async verify(): Promise<void> {
    try {
      const model = await absentIs404(this.api.model());
      if (identity(model) !== identity(this.model)) this.start();
    } catch {
      // The stream of events notices when the service is gone.
    }
  }

  private async fetchTests(): Promise<void> {
    const { epoch } = this;
    try {
      const tests = (await absentIs404(this.api.tests())) ?? [];
      if (epoch !== this.epoch) return;
      this.tests = tests;
      this.changed();
    } catch {
      // The next connection asks again.
    }
  }

  private async fetchQuarantine(): Promise<void> {
    const { epoch } = this;
    try {
      const held = (await absentIs404(this.api.quarantine())) ?? [];
      if (epoch !== this.epoch) return;
      this.quarantine = held;
      this.changed(false);
    } catch {
      // The next status asks again.
    }
  }

  /** Events tell changes of the state; its numbers (misfit, missed deadlines) go on changing. */
  private async refreshStatus(): Promise<void> {
    if (document.hidden) return;
    try {
      const status = await absentIs404(this.api.status());
      if (status) {
        this.takeStatus(status);
        this.changed(false);
      } else clearInterval(this.poll);
    } catch {
      // The stream of events notices when the service is gone.
    }
  }

  private lost(error: HttpError | undefined): void {
    clearInterval(this.poll);
    if (this.connected || this.lostAt === undefined) this.lostAt = performance.now();
    this.connected = false;
    if (error?.status === 401) {
      this.needsToken = this.tokenTried ? "wrong" : "first";
    } else if (error) this.problem = error.message;
    this.changed();
  }

  private forget(): void {
    this.epoch += 1;
    this.history.clear();
    this.cache.clear();
    this.stateEvents = [];
    this.alarms = [];
    this.quarantine = [];
    this.logbook = [];
    this.comparison = undefined;
    this.wantedSignal = undefined;
    this.chosen = undefined;
    this.lastDatumAt = undefined;
    for (const kind of kinds) this.detail[kind] = {};
  }

  /** Before each connection: the model (another one makes the page forget), and the steps that are not known yet. */
  private async prepare(cursor: Cursor): Promise<void> {
    const model = await absentIs404(this.api.model());
    if (identity(model) !== identity(this.model)) {
      this.forget();
      delete cursor.id;
    }
    // A mesh is large, and the same as long as the model is.
    const { mesh, sensors } =
      this.model?.mesh && identity(model) === identity(this.model)
        ? this.model
        : ((await absentIs404(this.api.mesh())) ?? {});
    this.model = model && { ...model, ...(mesh ? { mesh } : {}), ...(sensors ? { sensors } : {}) };
    this.alarms = [...((await absentIs404(this.api.alarms())) ?? [])].reverse().slice(0, mostAlarms);
    this.logbook = (await absentIs404(this.api.logbook())) ?? [];
    this.tests = (await absentIs404(this.api.tests())) ?? [];
    const from = (this.history.latest?.step ?? -1) + 1;
    if (cursor.id === undefined) {
      for (const line of (await absentIs404(this.api.states(from))) ?? []) this.take(line);
      cursor.from = (this.history.latest?.step ?? -1) + 1;
    }
    const status = await absentIs404(this.api.status());
    if (status) this.takeStatus(status);
    this.changed();
    this.fetchDetails();
  }

  /** Fields, sensors and samples of the step looked at. */
  private fetchDetails(): void {
    const line = this.line;
    if (!line) return;
    for (const kind of kinds) this.fetchDetail(kind, line.step);
  }

  private fetchDetail(kind: Kind, step: number): void {
    const wanted = kind === "signal" ? this.signal : kind === "samples" ? "" : this.wanted;
    const key = `${kind} ${wanted} ${step}`;
    const found = this.cache.get(key);
    if (found) {
      this.detail[kind] = { value: found as never };
      this.changed(this.chosen !== undefined);
      return;
    }
    const wait = (this.notBefore.get(kind) ?? 0) - performance.now();
    if (this.busy.has(kind) || wait > 0) {
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.fetchDetails(), Math.max(30, wait));
      return;
    }
    this.busy.add(kind);
    const begin = performance.now();
    let failed = false;
    const { epoch } = this;
    (this.api[kind](step, wanted) as Promise<Answers[Kind]>)
      .then(
        (value) => {
          if (epoch !== this.epoch) return;
          this.cache.set(key, value);
          if (this.cache.size > kept * kinds.length) this.cache.delete(this.cache.keys().next().value!);
          this.detail[kind] = { value: value as never };
        },
        (error: unknown) => {
          if (error instanceof HttpError) this.detail[kind] = { problem: error.message };
          failed = true;
        },
      )
      .finally(() => {
        this.busy.delete(kind);
        const took = performance.now() - begin;
        const live = this.chosen === undefined;
        this.notBefore.set(
          kind,
          performance.now() +
            (failed ? afterFailure : live ? Math.max(shortestInterval, 4 * took) : Math.min(took, 100)),
        );
        this.changed(this.chosen !== undefined);
      });
  }
}

/** Without a description, any service is the same. */
function identity(model: Model | undefined): string {
  return model ? JSON.stringify([model.site, model.run, model.parameters.map((p) => p.name)]) : "";
}
