// A stand-in for `knothe serve`, for working on the page and for its tests: the routes of docs/reference/dashboard.md, answered from
// recording.json.gz (made by record.py from real runs). State lives in a Recording, so a test can stop a server and start another that goes on.
//
//   node mock/server.mjs [--port 8080] [--rate 10] [--start 0] [--token SECRET] [--page dist/index.html]
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { gunzipSync } from "node:zlib";

const here = dirname(fileURLToPath(import.meta.url));
const sites = ["beam"];
const budget = 10000;
const noise = 1e-6;
/** Physical values of 1. */
const references = { Y0: { value: 216, units: "J/m3" }, Ad: { value: 0.00225, units: "m3/J" } };

export function verdict(level, code, message) {
  return { level, reasons: [{ code, level, value: 1, limit: 0, message }] };
}

export class Recording {
  constructor() {
    Object.assign(this, JSON.parse(gunzipSync(readFileSync(join(here, "recording.json.gz")))));
    // In the service a step is the index of its model time: times that never came leave a hole.
    this.lines.forEach((line) => (line.step = Math.round(line.time * 100) - 1));
    for (const line of this.lines) line.verdict ??= { level: "ok", reasons: [] };
    this.kept = Object.keys(this.fields)
      .map(Number)
      .sort((a, b) => a - b);
    this.unpacked = new Map();
  }

  /** Lines spoilt on purpose, to see what the real program does not do with these data. */
  scenario() {
    for (const line of this.lines) {
      if (line.step >= 44 && line.step <= 46)
        Object.assign(line, {
          trusted: false,
          ess: 0.71,
          remark: "effective sample size 71 % is below 90 %",
          verdict: verdict("caution", "computation", "the computation is not exact: effective sample size 71 %"),
        });
      if (line.step >= 60 && line.used > 0) {
        const part = (line.used - 2) / line.used;
        Object.assign(line, {
          used: line.used - 2,
          rejected: 2,
          log_evidence_increment: line.log_evidence_increment * part,
        });
      }
      if (line.step === 72) line.elapsed_us = { ...line.elapsed_us, map: 11400, update: 11600, total: 12900 };
    }
    return this;
  }

  line(step) {
    return this.lines.find((line) => line.step === step);
  }

  unpack(index, name) {
    const key = `${index} ${name}`;
    if (!this.unpacked.has(key)) {
      const { scale, shape, int16 } = this.fields[index][name];
      const bytes = Buffer.from(int16, "base64");
      const flat = Array.from({ length: bytes.length / 2 }, (_, i) => bytes.readInt16LE(2 * i) * scale);
      this.unpacked.set(
        key,
        Array.from({ length: shape[0] }, (_, i) => flat.slice(3 * i, 3 * i + 3)),
      );
    }
    return this.unpacked.get(key);
  }

  /** Between the kept steps, linearly. */
  field(index, name) {
    const after = this.kept.find((k) => k >= index) ?? this.kept.at(-1);
    const before = [...this.kept].reverse().find((k) => k <= index) ?? this.kept[0];
    const weight = after === before ? 0 : (index - before) / (after - before);
    const [a, b] = [this.unpack(before, name), this.unpack(after, name)];
    return a.map((row, i) => row.map((v, k) => Number((v + weight * (b[i][k] - v)).toPrecision(6))));
  }

  description() {
    return {
      run: "recording",
      version: this.version,
      site: "beam",
      sites,
      project: "quick.toml",
      model: "beam.h5",
      steps: this.steps,
      time: { label: "model time", units: "" },
      budget_us: budget,
      parameters: this.parameters.map((p) => ({ ...p, reference: references[p.name] })),
      forecasts: this.forecasts,
      fields: ["displacement", "sensitivity", "residual"],
    };
  }

  meshAnswer() {
    return { ...this.mesh, sensors: this.sensors.map((s) => ({ ...s, std: noise })) };
  }

  /** A picture a tenth larger than the structure on every side: grey from left to right, white above. */
  get corners() {
    const [low, high] = [Math.min, Math.max].map((f) => [0, 1].map((k) => f(...this.mesh.points.map((p) => p[k]))));
    const margin = [0, 1].map((k) => 0.1 * (high[k] - low[k]));
    const z = Math.max(...this.mesh.points.map((p) => p[2]));
    const [left, right] = [low[0] - margin[0], high[0] + margin[0]];
    const [bottom, top] = [low[1] - margin[1], high[1] + margin[1]];
    return [
      [left, top, z],
      [right, top, z],
      [left, bottom, z],
    ];
  }

  /** As BMP, which needs no compression; its rows go upwards. */
  picture() {
    const [width, height] = [240, 80];
    const bytes = Buffer.alloc(54 + 3 * width * height);
    bytes.write("BM");
    for (const [at, value] of [
      [2, bytes.length],
      [10, 54],
      [14, 40],
      [18, width],
      [22, height],
      [26, 1 + (24 << 16)],
    ])
      bytes.writeUInt32LE(value, at);
    for (let y = 0; y < height; y += 1)
      for (let x = 0; x < width; x += 1)
        bytes.fill(
          y > 0.9 * height ? 255 : Math.round((200 * x) / width),
          54 + 3 * (y * width + x),
          57 + 3 * (y * width + x),
        );
    return bytes;
  }

  fieldAt(step, name, parameter) {
    const index = this.lines.findIndex((line) => line.step === step);
    if (index < 0) return undefined;
    const line = this.lines[index];
    const answer = { name, step, time: line.time, units: "m" };
    if (name === "displacement") return { ...answer, location: "nodes", values: this.field(index, name) };
    if (name === "residual") {
      const all = this.residual[index];
      return {
        ...answer,
        location: "sensors",
        values: all.map((r) => (r ?? 0) * noise),
        missing: all.flatMap((r, k) => (r === null ? [k] : [])),
      };
    }
    const k = this.parameters.findIndex((p) => p.name === parameter);
    if (name !== "sensitivity" || k < 0) return undefined;
    const std = Math.sqrt(line.covariance[k][k]);
    return {
      ...answer,
      parameter,
      location: "nodes",
      values: this.field(index, `sensitivity:${parameter}`).map((row) =>
        row.map((v) => Number((v * std).toPrecision(6))),
      ),
    };
  }

  observationsAt(step) {
    const i = this.lines.findIndex((line) => line.step === step);
    if (i < 0) return undefined;
    const status = this.residual[i].map((r) => (r === null ? "missing" : "used"));
    const reason = Object.fromEntries(status.flatMap((s, k) => (s === "missing" ? [[k, "not measured"]] : [])));
    for (let n = 0, k = 11; n < this.lines[i].rejected; k += 17) {
      if (status[k % status.length] !== "used") continue;
      [status[k % status.length], reason[k % status.length], n] = ["rejected", "does not fit the others", n + 1];
    }
    return { step, time: this.lines[i].time, status, reason };
  }
}

/** Of the sensor by its number: a straight line, measured with the recorded residuals; its band opens behind the last datum. */
function signalOf(recording, known, sensor, step) {
  const times = Array.from({ length: recording.steps }, (_, i) => (i + 1) / recording.steps);
  const until = known.filter((line) => line.step <= step);
  const { time } = until.at(-1);
  const mean = times.map((t) => -4e-4 * t);
  const half = times.map((t) => 2 * noise + 5e-5 * Math.max(0, t - time));
  const seen = until.flatMap((line, i) => {
    const residual = recording.residual[i][sensor];
    return residual === null ? [] : [[line.time, -4e-4 * line.time + residual * noise]];
  });
  return {
    name: `${"xyz"[recording.sensors[sensor].component]}${sensor}`,
    units: "m",
    step,
    time,
    times,
    predicted: { mean, low: mean.map((v, i) => v - half[i]), high: mean.map((v, i) => v + half[i]) },
    measured: { time: seen.map(([t]) => t), value: seen.map(([, v]) => v) },
    loading: { name: "imposed_displacement", units: "m", values: times.map((t) => 4e-4 * t) },
  };
}

/** Wilson and Hilferty's approximation, good enough to look at. */
function chiSquaredTail(statistic, degrees) {
  const z = ((statistic / degrees) ** (1 / 3) - (1 - 2 / (9 * degrees))) / Math.sqrt(2 / (9 * degrees));
  const t = 1 / (1 + 0.2316419 * Math.abs(z));
  const tail =
    (Math.exp((-z * z) / 2) / Math.sqrt(2 * Math.PI)) *
    t *
    (0.31938153 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))));
  return z > 0 ? tail : 1 - tail;
}

export class MockService {
  /** `rate` steps per second; 0: `advance` is called by hand. */
  constructor(
    recording,
    { rate = 10, start = 0, token, page = join(here, "../dist/index.html"), period = 2, answer, picture = false } = {},
  ) {
    if (answer) this.answer = answer;
    Object.assign(this, {
      recording,
      rate,
      token,
      page,
      period,
      picture,
      count: start,
      readers: new Set(),
      requests: [],
      state: undefined,
      alarms: [],
      logbook: [],
      held: [],
      off: [],
      tests: [{ name: "", journal: "beam.journal", current: true, records: 0, finished: false }],
      lastAt: Date.now(),
    });
    // Each datum came 5 s after the one before.
    for (const line of recording.lines) line.received_at = 1.795e9 + 5 * line.step;
  }

  async listen(port = 0) {
    this.server = createServer((request, response) => this.answer(request, response));
    await new Promise((resolve, reject) => this.server.once("error", reject).listen(port, "127.0.0.1", resolve));
    this.port = this.server.address().port;
    this.clocks = [setInterval(() => this.readers.forEach((r) => r.write(":\n\n")), 5000)];
    if (this.rate > 0) this.clocks.push(setInterval(() => this.advance(), 1000 / this.rate));
    return this;
  }

  get url() {
    return `http://127.0.0.1:${this.port}/`;
  }

  async close() {
    this.clocks.forEach(clearInterval);
    this.server.closeAllConnections();
    await new Promise((resolve) => this.server.close(resolve));
  }

  get known() {
    return this.recording.lines.slice(0, this.count);
  }

  /** The next datum arrives. */
  advance() {
    if (this.count >= this.recording.lines.length) return;
    this.count += 1;
    this.lastAt = Date.now();
    const line = this.recording.lines[this.count - 1];
    for (const reader of this.readers) reader.write(this.event(this.count, line) + this.statusEvent());
  }

  /** The last datum is taken out: its step has no line any more. */
  withdraw() {
    const { step } = this.known.at(-1);
    this.recording.lines.splice(this.count - 1, 1);
    this.count -= 1;
    for (const reader of this.readers)
      reader.write(`id: ${4294967296 + this.count}\nevent: withdrawn\ndata: ${JSON.stringify({ step })}\n\n`);
  }

  say(state, reason) {
    this.state = { state, reason };
    for (const reader of this.readers) reader.write(this.statusEvent());
  }

  raise(alarm) {
    this.alarms.push({ id: this.alarms.length, ...alarm });
    for (const reader of this.readers) reader.write(`event: alarm\ndata: ${JSON.stringify(this.alarms.at(-1))}\n\n`);
  }

  /** Lines of an earlier test: a stiffer specimen, every second step. */
  earlier() {
    const scaled = (values) => values.map((v) => 0.93 * v);
    return this.recording.lines
      .filter((line) => line.step % 2 === 0 && line.step <= 70)
      .map((line) => ({
        ...line,
        mean: scaled(line.mean),
        quantiles: { ...line.quantiles, values: line.quantiles.values.map(scaled) },
        forecast: Object.fromEntries(
          Object.entries(line.forecast).map(([name, f]) => [name, { ...f, values: scaled(f.values) }]),
        ),
      }));
  }

  get test() {
    return this.tests.find((test) => test.current).name;
  }

  /** Another specimen: `/v1/tests`, `/v1/tests/resume`. What the mock shows begins anew. */
  change(path, body) {
    const [before, there] = [this.tests.find((t) => t.current), this.tests.find((t) => t.name === body.name)];
    if (path === "/v1/tests" && there) return;
    Object.assign(before, { current: false, finished: true, records: this.count, followed_by: body.name });
    if (there) Object.assign(there, { current: true, finished: false });
    else
      this.tests.push({
        name: body.name,
        journal: `beam.${body.name}.journal`,
        current: true,
        records: 0,
        finished: false,
        begun_at: Date.now() / 1000,
      });
    this.count = 0;
    this.logbook = [];
    const entry = this.write("", { by: body.by, text: body.comment });
    entry.kind = there ? "test_resumed" : "test_begun";
    for (const reader of this.readers) reader.write(this.statusEvent());
    return entry;
  }

  /** What a person does: `/v1/alarms/ID/acknowledge`, `/v1/notes`. */
  write(path, body) {
    const id = /^\/v1\/alarms\/(\d+)\/acknowledge$/.exec(path)?.[1];
    const alarm = id === undefined ? undefined : this.alarms.find((a) => a.id === Number(id));
    const at = Date.now() / 1000;
    const switches = path === "/v1/sensors";
    if (switches) this.off = [...this.off.filter((k) => k !== body.sensor), ...(body.active ? [] : [body.sensor])];
    const entry = {
      number: this.logbook.length + 1,
      kind: alarm ? "acknowledgement" : switches ? `sensor_${body.active ? "on" : "off"}` : (body.kind ?? "note"),
      time: this.known.find((line) => line.step === body.step)?.time ?? 0,
      by: body.by,
      text: body.text ?? body.comment,
      written_at: at,
      ...(alarm ? { alarm: alarm.id } : {}),
      ...(switches ? { sensor: body.sensor } : {}),
    };
    this.logbook.push(entry);
    if (switches) for (const reader of this.readers) reader.write(this.statusEvent());
    for (const reader of this.readers) reader.write(`event: logbook\ndata: ${JSON.stringify(entry)}\n\n`);
    if (alarm) {
      alarm.acknowledged = { by: body.by, comment: body.comment, at };
      for (const reader of this.readers) reader.write(`event: alarm\ndata: ${JSON.stringify(alarm)}\n\n`);
    }
    return entry;
  }

  /** Ids need only increase. */
  event(count, line) {
    return `id: ${4294967296 + count}\nevent: step\ndata: ${JSON.stringify({ ...line, site: "beam", event: 4294967296 + count, data: 1 })}\n\n`;
  }

  statusEvent() {
    return `event: status\ndata: ${JSON.stringify(this.status())}\n\n`;
  }

  status() {
    const line = this.known.at(-1);
    const shown = {
      site: "beam",
      journal: `journal of ${this.test}`,
      test: this.test,
      period_s: this.rate > 0 ? 1 / this.rate : this.period,
      budget_us: budget,
      pending: 0,
      behind: 0,
      accepted: this.count,
      deadline_misses: this.known.filter((l) => l.elapsed_us.total > budget).length,
      read_only: false,
      version: "0.1.0",
    };
    if (!line) return { ...shown, state: "STALE", reason: "no datum yet", data_flow: "waiting" };
    const residuals = this.recording.residual[this.count - 1].filter((r) => r !== null);
    const statistic = residuals.reduce((sum, r) => sum + r * r, 0);
    return {
      ...shown,
      state: this.state?.state ?? "OK",
      reason: this.state?.reason ?? "",
      data_flow: this.state?.state === "STALE" ? "silent" : "arriving",
      structure: line.verdict.level,
      step: line.step,
      time: line.time,
      data_age_s: (Date.now() - this.lastAt) / 1000,
      ...(this.off.length ? { switched_off: this.off } : {}),
      quarantined: this.held.length,
      ...(residuals.length
        ? { misfit: { statistic, values: residuals.length, probability: chiSquaredTail(statistic, residuals.length) } }
        : {}),
    };
  }

  answer(request, response) {
    const url = new URL(request.url, "http://localhost");
    this.requests.push({
      path: url.pathname,
      method: request.method,
      site: url.searchParams.get("site"),
      lastEventId: request.headers["last-event-id"],
    });
    const send = (status, body, type = "application/json") =>
      response.writeHead(status, { "Content-Type": type, "Cache-Control": "no-store" }).end(body);
    const fail = (status, type, message) => send(status, JSON.stringify({ error: { type, message } }));
    if (url.pathname === "/") return send(200, readFileSync(this.page), "text/html; charset=utf-8");
    if (this.token && request.headers.authorization !== `Bearer ${this.token}`)
      return fail(401, "Unauthorized", "a token is needed");
    if (request.method === "POST") {
      let body = "";
      request.on("data", (piece) => (body += piece));
      request.on("end", () => {
        const { pathname } = url;
        if (pathname === "/v1/quarantine" || pathname === "/v1/withdraw") {
          const { source, session, seq, by, comment } = JSON.parse(body);
          const kind = pathname === "/v1/withdraw" ? "withdrawn" : "released";
          this.held = this.held.filter((h) => h.seq !== seq);
          this.write(pathname, { by, kind, text: `${source}, ${session}, ${seq} ${kind} from quarantine: ${comment}` });
          for (const reader of this.readers) reader.write(this.statusEvent());
          return send(200, JSON.stringify({ accepted: true }));
        }
        const changes = url.pathname === "/v1/tests" || url.pathname === "/v1/tests/resume";
        const done = changes ? this.change(url.pathname, JSON.parse(body)) : this.write(url.pathname, JSON.parse(body));
        return done ? send(200, JSON.stringify(done)) : fail(409, "TestExists", "there is a test of this name already");
      });
      return;
    }
    const json = (value, what) => (value === undefined ? fail(404, "NoState", what) : send(200, JSON.stringify(value)));
    const from = Number(url.searchParams.get("from") ?? 0);
    const step = Number(url.searchParams.get("step") ?? this.known.at(-1)?.step);
    const known = this.known.some((line) => line.step === step);
    switch (url.pathname) {
      case "/v1/sites":
        return json({ sites });
      case "/v1/description":
        return json({
          ...this.recording.description(),
          run: `${this.recording.description().run} ${this.test}`,
          journal: this.status().journal,
          test: this.test,
          period_s: this.status().period_s,
          ...(this.picture ? { picture: { corners: this.recording.corners } } : {}),
        });
      case "/v1/picture":
        return this.picture && known
          ? send(200, this.recording.picture(), "image/bmp")
          : fail(404, "NoPicture", `step ${step} was not measured in a watched picture`);
      case "/v1/mesh":
        return json(this.recording.meshAnswer());
      case "/v1/status":
        return json(this.status());
      case "/v1/alarms":
        return json({ alarms: this.alarms });
      case "/v1/tests":
        return json({ tests: this.tests });
      case "/v1/logbook":
        return json({ logbook: this.logbook });
      case "/v1/state":
        return json(this.known.at(-1), "no datum yet");
      case "/v1/states":
        if (url.searchParams.has("test")) return json(this.earlier(), "no such test");
        return json(this.known.filter((line) => line.step >= from));
      case "/v1/field":
        return json(
          known
            ? this.recording.fieldAt(step, url.searchParams.get("name"), url.searchParams.get("parameter"))
            : undefined,
          "no such field or step",
        );
      case "/v1/observations":
        return json(known ? this.recording.observationsAt(step) : undefined, `step ${step} is not there`);
      case "/v1/signal":
        return json(
          known ? signalOf(this.recording, this.known, Number(url.searchParams.get("sensor")), step) : undefined,
          `there is no posterior of step ${step}`,
        );
      case "/v1/quarantine":
        return json({ quarantined: this.held });
      case "/v1/samples": {
        const index = this.known.findIndex((line) => line.step === step);
        return json(
          index < 0
            ? undefined
            : {
                step,
                parameters: this.recording.parameters.map((p) => p.name),
                samples: this.recording.samples[index],
              },
          `step ${step} is not there`,
        );
      }
      case "/v1/events":
        return this.stream(request, response, url);
      default:
        return fail(404, "NoRoute", `${url.pathname} is not here`);
    }
  }

  stream(request, response, url) {
    response.writeHead(200, { "Content-Type": "text/event-stream", "Cache-Control": "no-store" });
    const last = request.headers["last-event-id"];
    const from = url.searchParams.get("from");
    const after =
      last !== undefined
        ? Number(last) - 4294967296
        : from !== null
          ? this.known.findIndex((line) => line.step >= Number(from))
          : this.count - 1;
    for (let k = Math.max(0, after < 0 ? this.count : after); k < this.count; k += 1)
      response.write(this.event(k + 1, this.recording.lines[k]));
    response.write(this.statusEvent());
    this.readers.add(response);
    request.on("close", () => this.readers.delete(response));
  }
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  const option = (name, otherwise) => {
    const at = process.argv.indexOf(`--${name}`);
    return at < 0 ? otherwise : process.argv[at + 1];
  };
  const service = new MockService(new Recording().scenario(), {
    rate: Number(option("rate", 10)),
    start: Number(option("start", 0)),
    token: option("token"),
    page: option("page", join(here, "../dist/index.html")),
  });
  await service.listen(Number(option("port", 8080)));
  console.log(service.url);
}
