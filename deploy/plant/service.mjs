// The service's HTTP (docs/reference/service.md): asked until it answers.
import { setTimeout as sleep } from "node:timers/promises";

import { ConfigurationError, secret } from "./configuration.mjs";

/** The service will not have it, now or later: the bridge ends with status 4. */
export class Refusal extends Error {}

export class Service {
  constructor({ address, site, read_token, ingest_token }, log) {
    Object.assign(this, { address, site, log, read_token: secret(read_token), ingest_token: secret(ingest_token) });
  }

  async ask(path, token, body) {
    const headers = {
      ...(token && { Authorization: `Bearer ${token}` }),
      ...(body && { "Content-Type": "application/json" }),
    };
    for (let pause = 100; ; pause = Math.min(2 * pause, 5000)) {
      let reason;
      try {
        const answer = await fetch(this.address + path, {
          method: body ? "POST" : "GET",
          headers,
          body,
          signal: AbortSignal.timeout(30000),
        });
        const content = await answer.json();
        if (answer.ok) return content;
        reason = `${answer.status}: ${content.error?.message}`;
        if (answer.status < 500 || answer.status === 501) throw new Refusal(`${this.address}${path}: ${reason}`);
      } catch (error) {
        if (error instanceof Refusal) throw error;
        reason ??= error.cause?.message ?? error.message;
      }
      this.log(`${this.address}: ${reason}; is asked again until it answers`);
      await sleep(pause);
    }
  }

  /** What `values` are made of, and the model's times. */
  async layout() {
    const { displacements, scalars, times } = await this.ask(
      `/v1/description${this.site ? `?site=${this.site}` : ""}`,
      this.read_token,
    );
    return { displacements, scalars, times };
  }

  /** `{ status, line, at }` of now, `line` undefined before the first; throws what is in the way within `limit` ms. */
  async look(limit) {
    const at = Date.now();
    const get = async (path) => {
      const answer = await fetch(`${this.address}${path}${this.site ? `?site=${this.site}` : ""}`, {
        headers: this.read_token && { Authorization: `Bearer ${this.read_token}` },
        signal: AbortSignal.timeout(limit),
      });
      const content = await answer.json();
      if (answer.ok) return content;
      throw new Error(`${answer.status}: ${content.error?.message}`);
    };
    try {
      let status = await get("/v1/status");
      if (status.step === undefined) return { status, at };
      if (this.seen?.journal !== status.journal || this.seen.event !== status.event) {
        const line = await get("/v1/state");
        this.seen = { journal: status.journal, event: status.event, line };
        status = await get("/v1/status"); // the line is at most as new as this
      }
      if (this.seen.journal !== status.journal) throw new Error("another test has begun");
      return { status, line: this.seen.line, at };
    } catch (error) {
      throw new Error(
        error.name === "TimeoutError" ? `no answer within ${limit / 1000} s` : (error.cause?.message ?? error.message),
      );
    }
  }

  /** A note in the logbook, if it answers: what was sent is in the spool. */
  async note(by, text) {
    const headers = {
      "Content-Type": "application/json",
      ...(this.ingest_token && { Authorization: `Bearer ${this.ingest_token}` }),
    };
    const body = JSON.stringify({ ...(this.site && { site: this.site }), by, text });
    await fetch(`${this.address}/v1/notes`, { method: "POST", headers, body, signal: AbortSignal.timeout(5000) }).catch(
      () => {},
    );
  }

  store(datum) {
    return this.ask("/v1/measurements", this.ingest_token, JSON.stringify(datum));
  }
}

/** Where each channel is in `values`: a force or a gauge by its name, a displacement by its index. */
export function places(names, { displacements, scalars }) {
  return Object.fromEntries(
    names.map((name) => {
      const place = /^\d+$/.test(name)
        ? Number(name)
        : scalars.includes(name)
          ? displacements + scalars.indexOf(name)
          : NaN;
      if (place < displacements + scalars.length) return [name, place];
      throw new ConfigurationError(
        `error: channels.${name}: the project's data file has no such sensor; it has the displacements 0 to ` +
          `${displacements - 1}${scalars.length ? " and " + scalars.join(", ") : " and no force or gauge"}`,
      );
    }),
  );
}
