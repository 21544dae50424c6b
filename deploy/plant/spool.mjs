// What is to be sent is on disk before it is sent: when it is sent again, it is the same.
import { appendFileSync, closeSync, fsyncSync, ftruncateSync, mkdirSync, openSync, readFileSync } from "node:fs";
import { dirname } from "node:path";
import { isDeepStrictEqual } from "node:util";

import { ConfigurationError } from "./configuration.mjs";

function sync(path) {
  const file = openSync(path, "r");
  fsyncSync(file);
  closeSync(file);
}

/** The entry that was written behind a line that was cut short: that one had not been taken. */
function behind_a_torn_one(line) {
  for (const { index } of line.matchAll(/\{"(?:seq|sent|identity|command|acknowledged|dropped|held|released)":/g)) {
    if (index === 0) continue;
    try {
      return JSON.parse(line.slice(index));
    } catch {
      // the next one, then
    }
  }
  return null;
}

export class Spool {
  /**
   * JSON lines: `{"identity","layout"}`, then data `{"seq",…}` and, once the service has them, `{"sent":seq}`; among them
   * what the machine was told, `orders` (command.mjs). `measured`: the last command after which was measured.
   */
  constructor(path, identity) {
    Object.assign(this, {
      path,
      identity,
      layout: null,
      next: 0,
      waiting: [],
      unwritten: [],
      repaired: 0,
      torn: false,
    });
    this.orders = [];
    try {
      mkdirSync(dirname(path), { recursive: true });
      this.file = openSync(path, "a+", 0o640);
    } catch (error) {
      throw new ConfigurationError(`${path}: error: ${error.message}`);
    }
    sync(dirname(path));
    const content = readFileSync(path);
    const whole = content.lastIndexOf("\n") + 1; // killed in the middle of a line: it was not sent
    if (whole < content.length) ftruncateSync(this.file, whole);
    this.size = whole;
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
      entry = behind_a_torn_one(line);
      if (entry) this.repaired += 1;
    }
    if (!entry) {
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
    } else if (!("seq" in entry)) {
      this.orders.push(entry);
    } else {
      this.push(entry);
    }
  }

  begin(layout) {
    this.layout = layout;
    this.write({ identity: this.identity, layout });
  }

  /** What the disk does not take now stays in memory, in its order, until `flush`. */
  add(data) {
    this.unwritten.push(...data);
    this.flush();
  }

  flush() {
    while (this.unwritten.length > 0) {
      this.write(this.unwritten[0]);
      this.push(this.unwritten.shift());
    }
  }

  push(datum) {
    this.waiting.push(datum);
    this.next = datum.seq + 1;
    this.measured = datum.command ?? this.measured;
  }

  /** Need not be on disk at once: sent again, it is a duplicate. */
  sent(datum) {
    this.append({ sent: datum.seq });
    this.waiting.shift();
    this.sent_at = Date.now();
  }

  write(entry) {
    this.append(entry);
    fsyncSync(this.file);
  }

  /** A line, whole or not at all: nothing is written behind what a full disk has cut short. */
  append(entry) {
    if (this.torn) ftruncateSync(this.file, this.size);
    const line = Buffer.from(JSON.stringify(entry) + "\n");
    this.torn = true;
    appendFileSync(this.file, line);
    this.torn = false;
    this.size += line.length;
  }
}
