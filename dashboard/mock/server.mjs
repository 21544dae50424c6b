// A stand-in for `knothe serve`, for working on the page and for its tests: the routes of docs/service.md that the page reads, answered from
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

export class Recording {
  constructor() {
    Object.assign(this, JSON.parse(gunzipSync(readFileSync(join(here, "recording.json.gz")))));
    // In the service a step is the index of its model time: times that never came leave a hole.
    this.lines.forEach((line) => (line.step = Math.round(line.time * 100) - 1));
    this.kept = Object.keys(this.fields).map(Number).sort((a, b) => a - b);
    this.unpacked = new Map();
  }

  /** Lines spoilt on purpose, to see what the real program does not do with these data. */
  scenario() {
    for (const line of this.lines) {
      if (line.step >= 44 && line.step <= 46) Object.assign(line, { trusted: false, ess: 0.71, remark: "effective sample size 71 % is below 90 %" });
      if (line.step >= 60 && line.used > 0) {
        const part = (line.used - 2) / line.used;
        Object.assign(line, { used: line.used - 2, rejected: 2, log_evidence_increment: line.log_evidence_increment * part });
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
      this.unpacked.set(key, Array.from({ length: shape[0] }, (_, i) => flat.slice(3 * i, 3 * i + 3)));
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

  model() {
    const noise = 1e-6;
    return {
      site: "beam",
      parameters: this.parameters.map(({ quantiles, ...p }) => ({ ...p, levels: quantiles.levels, values: quantiles.values })),
      time: Array.from({ length: this.steps }, (_, i) => (i + 1) / 100),
      quantities: this.forecasts,
      sensors: { points: this.sensors.map((s) => [s.x, s.y, s.z]), components: this.sensors.map((s) => "xyz"[s.component]), std: this.sensors.map(() => noise) },
      mesh: { type: "VTK_HEXAHEDRON", points: this.mesh.points, cells: this.mesh.cells[0].connectivity },
      method: { kind: "transport", form: "collapsed", tolerance: 1e-3, bias_correction: "off" },
      model_sha256: "m", configuration_sha256: "c",
    };
  }

  fieldsAt(step) {
    const index = this.lines.findIndex((line) => line.step === step);
    if (index < 0) return undefined;
    const line = this.lines[index];
    const sensitivity = {};
    this.parameters.forEach((p, k) => {
      const std = Math.sqrt(line.covariance[k][k]);
      sensitivity[p.name] = this.field(index, `sensitivity:${p.name}`).map((row) => row.map((v) => Number((v * std).toPrecision(6))));
    });
    return { step, time: line.time, parameters: line.mean, units: "m", displacement: this.field(index, "displacement"), sensitivity };
  }

  sensorsAt(step) {
    const i = this.lines.findIndex((line) => line.step === step);
    if (i < 0) return undefined;
    const line = this.lines[i];
    const all = this.residual[i];
    const u = this.field(i, "displacement");
    const status = all.map((r) => (r === null ? "missing" : "used"));
    for (let n = 0, k = 11; n < line.rejected; k += 17) if (status[k % all.length] === "used") [status[k % all.length], n] = ["rejected", n + 1];
    const index = status.flatMap((s, k) => (s === "used" ? [k] : []));
    const predicted = index.map((k) => u[this.nodeOf(k)][this.sensors[k].component]);
    return { step, time: line.time, status, index, predicted, measured: index.map((k, n) => predicted[n] + all[k] * 1e-6), normalised: index.map((k) => all[k]) };
  }

  nodeOf(sensor) {
    this.nodes ??= this.sensors.map((s) => this.mesh.points.findIndex((p) => Math.hypot(p[0] - s.x, p[1] - s.y, p[2] - s.z) < 1e-6));
    return this.nodes[sensor];
  }
}

export class MockService {
  /** `rate` steps per second; 0: `advance` is called by hand. */
  constructor(recording, { rate = 10, start = 0, token, page = join(here, "../dist/index.html"), period = 2 } = {}) {
    Object.assign(this, { recording, rate, token, page, period, count: start, readers: new Set(), requests: [], state: undefined, lastAt: Date.now() });
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

  say(state, cause) {
    this.state = { state, cause };
    for (const reader of this.readers) reader.write(this.statusEvent());
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
    const shown = { site: "beam", period_s: this.rate > 0 ? 1 / this.rate : this.period, budget_us: budget, pending: 0, behind: 0, accepted: this.count, deadline_misses: 0, read_only: false, version: "0.1.0" };
    if (!line) return { ...shown, state: "WAITING", cause: "" };
    const residuals = this.recording.residual[this.count - 1].filter((r) => r !== null);
    const alarm = { statistic: residuals.reduce((sum, r) => sum + r * r, 0), values: residuals.length, probability: 0.43 };
    return { ...shown, state: this.state?.state ?? "OK", cause: this.state?.cause ?? "", step: line.step, time: line.time, age_s: (Date.now() - this.lastAt) / 1000,
      ...(residuals.length ? { alarm } : {}) };
  }

  answer(request, response) {
    const url = new URL(request.url, "http://localhost");
    this.requests.push({ path: url.pathname, lastEventId: request.headers["last-event-id"] });
    const send = (status, body, type = "application/json") => response.writeHead(status, { "Content-Type": type, "Cache-Control": "no-store" }).end(body);
    const fail = (status, type, message) => send(status, JSON.stringify({ error: { type, message } }));
    if (url.pathname === "/") return send(200, readFileSync(this.page), "text/html; charset=utf-8");
    if (this.token && request.headers.authorization !== `Bearer ${this.token}`) return fail(401, "Unauthorized", "a token is needed");
    const json = (value, what) => (value === undefined ? fail(404, "NoState", what) : send(200, JSON.stringify(value)));
    const from = Number(url.searchParams.get("from") ?? 0);
    const step = Number(url.searchParams.get("step") ?? this.known.at(-1)?.step);
    const known = this.known.some((line) => line.step === step);
    switch (url.pathname) {
      case "/v1/sites": return json({ sites });
      case "/v1/model": return json(this.recording.model());
      case "/v1/status": return json(this.status());
      case "/v1/state": return json(this.known.at(-1), "no datum yet");
      case "/v1/states": return json(this.known.filter((line) => line.step >= from));
      case "/v1/fields": return json(known ? this.recording.fieldsAt(step) : undefined, `step ${step} is not there`);
      case "/v1/sensors": return json(known ? this.recording.sensorsAt(step) : undefined, `step ${step} is not there`);
      case "/v1/samples": {
        const index = this.known.findIndex((line) => line.step === step);
        return json(index < 0 ? undefined : { step, parameters: this.recording.parameters.map((p) => p.name), points: this.recording.samples[index] }, `step ${step} is not there`);
      }
      case "/v1/events": return this.stream(request, response, url);
      default: return fail(404, "NoRoute", `${url.pathname} is not here`);
    }
  }

  stream(request, response, url) {
    response.writeHead(200, { "Content-Type": "text/event-stream", "Cache-Control": "no-store" });
    const last = request.headers["last-event-id"];
    const from = url.searchParams.get("from");
    const after = last !== undefined ? Number(last) - 4294967296 : from !== null ? this.known.findIndex((line) => line.step >= Number(from)) : this.count - 1;
    for (let k = Math.max(0, after < 0 ? this.count : after); k < this.count; k += 1) response.write(this.event(k + 1, this.recording.lines[k]));
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
  const service = new MockService(new Recording().scenario(), { rate: Number(option("rate", 10)), start: Number(option("start", 0)), token: option("token"),
    page: option("page", join(here, "../dist/index.html")) });
  await service.listen(Number(option("port", 8080)));
  console.log(service.url);
}
