// What is to be sent is on disk before it is sent: when it is sent again, it is the same.
import { appendFileSync, closeSync, fsyncSync, mkdirSync, openSync, readFileSync, truncateSync } from "node:fs";
import { dirname } from "node:path";
import { isDeepStrictEqual } from "node:util";

import { ConfigurationError } from "./configuration.mjs";

function sync(path) {
  const file = openSync(path, "r");
  fsyncSync(file);
  closeSync(file);
}

export class Spool {
  /** JSON lines: `{"identity","layout"}`, then data `{"seq",…}` and, once the service has them, `{"sent":seq}`. */
  constructor(path, identity) {
    Object.assign(this, { path, identity, layout: null, next: 0, waiting: [] });
    try {
      mkdirSync(dirname(path), { recursive: true });
      this.file = openSync(path, "a+", 0o640);
    } catch (error) {
      throw new ConfigurationError(`${path}: error: ${error.message}`);
    }
    sync(dirname(path));
    const content = readFileSync(path);
    const whole = content.lastIndexOf("\n") + 1; // killed in the middle of a line: it was not sent
    if (whole < content.length) truncateSync(path, whole);
    content
      .subarray(0, whole)
      .toString()
      .split("\n")
      .slice(0, -1)
      .forEach((line, number) => this.read(line, number + 1));
  }

  read(line, number) {
    let entry;
    try {
      entry = JSON.parse(line);
    } catch {
      throw new ConfigurationError(
        `${this.path}:${number}: error: not a line of a spool; use another file as "spool", and another "session"`,
      );
    }
    if (entry.layout) {
      if (!isDeepStrictEqual(entry.identity, this.identity))
        throw new ConfigurationError(
          `${this.path}: error: was written for another source, session, time or other channels: ` +
            'what was sent must not become something else; use another file as "spool", and another "session"',
        );
      this.layout = entry.layout;
    } else if ("sent" in entry) {
      this.waiting.shift();
    } else {
      this.push(entry);
    }
  }

  begin(layout) {
    this.layout = layout;
    this.write({ identity: this.identity, layout });
  }

  add(datum) {
    this.write(datum);
    this.push(datum);
  }

  push(datum) {
    this.waiting.push(datum);
    this.next = datum.seq + 1;
  }

  /** Need not be on disk at once: sent again, it is a duplicate. */
  sent(datum) {
    appendFileSync(this.file, `{"sent":${datum.seq}}\n`);
    this.waiting.shift();
  }

  write(entry) {
    appendFileSync(this.file, JSON.stringify(entry) + "\n");
    fsyncSync(this.file);
  }
}
