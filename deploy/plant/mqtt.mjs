// Topics of an MQTT 3.1.1 broker, each with a number as text. What is written is retained: the broker keeps it as a
// register does, so that it can be read again.
import { once } from "node:events";
import { readFileSync } from "node:fs";
import { connect as connect_tcp, isIP } from "node:net";
import { connect as connect_tls } from "node:tls";

import { secret } from "./configuration.mjs";

const CONNECT = 1,
  CONNACK = 2,
  PUBLISH = 3,
  PUBACK = 4,
  SUBSCRIBE = 8,
  SUBACK = 9,
  PINGREQ = 12,
  PINGRESP = 13;
const KEEP_ALIVE_S = 10;
const LIMIT_MS = 5000; // for an answer

function text(words) {
  const bytes = Buffer.from(words);
  return Buffer.concat([two(bytes.length), bytes]);
}

const two = (number) => Buffer.from([number >> 8, number & 255]);

function packet(type, flags, ...parts) {
  const body = Buffer.concat(parts);
  const length = [];
  for (let left = body.length; ; left >>= 7) {
    length.push((left & 127) | (left > 127 ? 128 : 0));
    if (left <= 127) break;
  }
  return Buffer.concat([Buffer.from([(type << 4) | flags, ...length]), body]);
}

/** The first packet in the bytes, `{ type, flags, body, size }`, or null while it is not whole. */
function first_packet(bytes) {
  let length = 0;
  for (let k = 1; k < bytes.length && k < 5; ++k) {
    length += (bytes[k] & 127) << (7 * (k - 1));
    if (bytes[k] & 128) continue;
    const size = k + 1 + length;
    if (bytes.length < size) return null;
    return { type: bytes[0] >> 4, flags: bytes[0] & 15, body: bytes.subarray(k + 1, size), size };
  }
  return null;
}

/** A connection whose `values` are the newest of each topic: `{ value, stamp }`. */
class Client {
  constructor(socket, take) {
    Object.assign(this, { socket, take, values: new Map(), identifier: 0, received: Buffer.alloc(0) });
    this.lost = once(socket, "close").then(() => {
      throw new Error("the connection is lost");
    });
    this.lost.catch(() => {}); // it is waited for elsewhere
    socket.on("data", (bytes) => this.receive(bytes));
  }

  receive(bytes) {
    this.received = Buffer.concat([this.received, bytes]);
    for (let found; (found = first_packet(this.received));) {
      this.received = this.received.subarray(found.size);
      if (found.type === PUBLISH) this.publication(found);
      else this.socket.emit(`mqtt${found.type}`, found.body);
    }
  }

  publication({ flags, body }) {
    const after = 2 + body.readUInt16BE(0);
    const confirmed = (flags & 6) !== 0;
    if (confirmed) this.socket.write(packet(PUBACK, 0, body.subarray(after, after + 2)));
    const topic = body.subarray(2, after).toString();
    const words = body.subarray(after + (confirmed ? 2 : 0)).toString();
    const found = { value: words.trim() === "" ? NaN : Number(words), words, stamp: Date.now() };
    this.values.set(topic, found);
    if (!(flags & 1)) this.take?.(topic, found); // what was retained is of an earlier time
  }

  /** Sends, and waits for the answer of a type. */
  async ask(sent, type) {
    const answer = once(this.socket, `mqtt${type}`, { signal: AbortSignal.timeout(LIMIT_MS) });
    this.socket.write(sent);
    const [body] = await answer.catch((error) => {
      throw new Error(error.name === "AbortError" ? `no answer within ${LIMIT_MS / 1000} s` : error.message);
    });
    return body;
  }

  async log_in(user, password) {
    const flags = 2 | (user ? 0xc0 : 0); // a clean session
    const names = [
      text(`knothe-plant-${process.pid}-${Date.now() % 1e6}`),
      ...(user ? [text(user), text(password)] : []),
    ];
    const answer = await this.ask(
      packet(CONNECT, 0, text("MQTT"), Buffer.from([4, flags]), two(2 * KEEP_ALIVE_S), ...names),
      CONNACK,
    );
    if (answer[1] !== 0) throw new Error(`the broker refuses the connection: code ${answer[1]}`);
    this.alive = setInterval(
      () => this.ask(packet(PINGREQ, 0), PINGRESP).catch(() => this.socket.destroy()),
      1000 * KEEP_ALIVE_S,
    );
  }

  next() {
    return two((this.identifier = (this.identifier % 65535) + 1));
  }

  async subscribe(topics) {
    const wanted = topics.flatMap((topic) => [text(topic), Buffer.from([1])]);
    const answer = await this.ask(packet(SUBSCRIBE, 2, this.next(), ...wanted), SUBACK);
    const refused = topics.filter((_, k) => answer[2 + k] > 2);
    if (refused.length > 0) throw new Error(`the broker refuses to subscribe ${refused.join(", ")}`);
    await this.ask(packet(PINGREQ, 0), PINGRESP); // what is retained comes before its answer
  }

  /** Retained, QoS 1: returns when the broker has it. */
  async publish(topic, words) {
    await this.ask(packet(PUBLISH, 3, text(topic), this.next(), Buffer.from(words)), PUBACK);
    this.values.set(topic, { value: Number(words), words, stamp: Date.now() });
  }

  close() {
    clearInterval(this.alive);
    this.socket.destroy();
  }
}

async function connected({ broker, user, password, ca }, topics, take) {
  const [, host, port] = /^(.*):(\d+)$/.exec(broker);
  const options = {
    host,
    port: Number(port),
    noDelay: true,
    ...(ca && { ca: readFileSync(ca), ...(!isIP(host) && { servername: host }) }),
  };
  const socket = (ca ? connect_tls : connect_tcp)(options);
  const client = new Client(socket, take);
  try {
    await once(socket, ca ? "secureConnect" : "connect", { signal: AbortSignal.timeout(LIMIT_MS) });
    await client.log_in(user, secret(password) ?? "");
    await client.subscribe([...new Set(topics)]);
    return client;
  } catch (error) {
    client.close();
    throw error.name === "AbortError" ? new Error(`no connection within ${LIMIT_MS / 1000} s`) : error;
  }
}

function sample(name, { scale, offset }, { value, words, stamp }) {
  const good = Number.isFinite(value);
  return { name, stamp, value: good ? scale * value + offset : null, reason: good ? "" : `"${words}" is no number` };
}

/** Runs until the connection is lost, which it throws. */
export async function read({ mqtt, channels }, { take, log }) {
  const names = Object.entries(channels);
  const client = await connected(
    mqtt,
    names.map(([, { topic }]) => topic),
    (topic, found) =>
      names.filter(([, channel]) => channel.topic === topic).forEach((channel) => take(sample(...channel, found))),
  );
  log(`${mqtt.broker}: connected`);
  try {
    await client.lost;
  } finally {
    client.close();
  }
}

/** Single topics of the machine, read and written when they are asked for. */
export async function open_machine({ mqtt, channels, command }) {
  const points = [...Object.values(channels), ...Object.values(command)].filter((point) => point.topic);
  const client = await connected(
    mqtt,
    points.map(({ topic }) => topic),
  );
  const read = [command.acknowledge, command.reached, ...Object.values(channels)].map((point) => point?.topic);
  return {
    async sample(name, channel) {
      const found = client.values.get(channel.topic);
      if (found) return sample(name, channel, found);
      if (read.includes(channel.topic))
        return { name, stamp: Date.now(), value: null, reason: "nothing was published" };
      return sample(name, channel, { value: 0, stamp: Date.now() }); // nobody has written it yet
    },
    async write(number, { topic }) {
      await client.publish(topic, `${number}`);
      return undefined;
    },
    lost: client.lost,
    close: async () => client.close(),
  };
}
