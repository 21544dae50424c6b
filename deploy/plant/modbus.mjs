// The registers of a Modbus/TCP server: functions 3, 4, 6 and 16 of the Modbus application protocol 1.1b3.
import { once } from "node:events";
import { connect } from "node:net";
import { setTimeout as sleep } from "node:timers/promises";

const EXCEPTIONS = {
  1: "illegal function",
  2: "illegal data address",
  3: "illegal data value",
  4: "server device failure",
  6: "server device busy",
  10: "gateway path unavailable",
  11: "gateway target device failed to respond",
};
const FUNCTIONS = { holding: 3, input: 4 };
const WRITE_ONE = 6,
  WRITE_SEVERAL = 16;
const NAMES = { int16: "Int16BE", uint16: "UInt16BE", int32: "Int32BE", uint32: "UInt32BE", float32: "FloatBE" };

/** How many registers, of 16 bits, a number of a type has. */
export const WORDS = { int16: 1, uint16: 1, int32: 2, uint32: 2, float32: 2 };

const in_order = (registers, { type, word_order }) =>
  word_order === "little" && WORDS[type] === 2
    ? Buffer.concat([registers.subarray(2, 4), registers.subarray(0, 2)])
    : registers;

/** The number in the registers (big-endian; `word_order` is that of the two words). */
const decode = (registers, point) => in_order(registers, point)[`read${NAMES[point.type]}`](0);

/** The registers with a number in them; an integer type's is rounded. RangeError: the type does not hold it. */
function encode(number, point) {
  const registers = Buffer.alloc(2 * WORDS[point.type]);
  if (point.type === "float32" && !Number.isFinite(Math.fround(number))) throw new RangeError();
  if (point.type === "float32") registers.writeFloatBE(number);
  else registers[`write${NAMES[point.type]}`](Math.round(number));
  return in_order(registers, point);
}

/** One request at a time: the answer's registers, and when they were read. */
class Connection {
  constructor(socket, device, timeout) {
    Object.assign(this, {
      socket,
      device,
      timeout,
      transaction: 0,
      received: Buffer.alloc(0),
      last: Promise.resolve(),
    });
    socket.on("data", (bytes) => {
      this.received = Buffer.concat([this.received, bytes]);
      if (this.received.length >= 6 && this.received.length >= 6 + this.received.readUInt16BE(4))
        this.socket.emit("answer");
    });
  }

  registers(code, address, count) {
    return this.in_turn(async () => {
      const { stamp, exception, content } = await this.exchange(code, words(address, count));
      if (exception) return { stamp, exception };
      if (content[0] !== 2 * count || content.length !== 1 + 2 * count)
        throw new Error(`${content[0]} bytes for ${count} registers`);
      return { stamp, registers: content.subarray(1) };
    });
  }

  /** What the server says against it, or undefined. */
  write(address, registers) {
    const count = registers.length / 2;
    const [code, body] =
      count === 1
        ? [WRITE_ONE, Buffer.concat([words(address), registers])]
        : [WRITE_SEVERAL, Buffer.concat([words(address, count), Buffer.from([registers.length]), registers])];
    return this.in_turn(async () => {
      const { exception, content } = await this.exchange(code, body);
      if (!exception && content.compare(body.subarray(0, 4)) !== 0) throw new Error("the answer is to another write");
      return exception;
    });
  }

  in_turn(request) {
    return (this.last = this.last.then(request));
  }

  async exchange(code, body) {
    this.transaction = (this.transaction + 1) % 65536;
    const asked = Date.now();
    this.socket.write(
      Buffer.concat([words(this.transaction, 0, 2 + body.length), Buffer.from([this.device, code]), body]),
    );
    await once(this.socket, "answer", { signal: AbortSignal.timeout(this.timeout) }).catch((error) => {
      throw new Error(error.name === "AbortError" ? `no answer within ${this.timeout / 1000} s` : error.message);
    });
    // Modbus has no time stamps: half-way between question and answer.
    const stamp = (asked + Date.now()) / 2;
    const answer = this.received;
    this.received = Buffer.alloc(0);
    if (answer.readUInt16BE(0) !== this.transaction || answer.length < 9 || (answer[7] & 0x7f) !== code)
      throw new Error("not an answer of Modbus/TCP");
    if (answer[7] & 0x80)
      return { stamp, exception: `exception ${answer[8]}, ${EXCEPTIONS[answer[8]] ?? "not known"}` };
    return { stamp, content: answer.subarray(8) };
  }
}

function words(...numbers) {
  const bytes = Buffer.alloc(2 * numbers.length);
  numbers.forEach((number, k) => bytes.writeUInt16BE(number, 2 * k));
  return bytes;
}

/** A connection to the server, and what is thrown once it is lost. */
async function connected({ address, device, timeout }) {
  const [, host, port] = /^(.*):(\d+)$/.exec(address);
  const limit = 1000 * (timeout ?? 1);
  const socket = connect({ host, port: Number(port), noDelay: true });
  try {
    await once(socket, "connect", { signal: AbortSignal.timeout(limit) });
  } catch (error) {
    socket.destroy();
    throw error.name === "AbortError" ? new Error(`no connection within ${limit / 1000} s`) : error;
  }
  const lost = once(socket, "close").then(() => {
    throw new Error("the connection is lost");
  });
  lost.catch(() => {}); // it is waited for elsewhere
  return { socket, lost, connection: new Connection(socket, device ?? 1, limit) };
}

async function sample(connection, name, channel) {
  const code = FUNCTIONS[channel.table ?? "holding"];
  const { stamp, registers, exception } = await connection.registers(code, channel.register, WORDS[channel.type]);
  const read = exception ? NaN : decode(registers, channel);
  const good = Number.isFinite(read);
  return { name, stamp, value: good ? channel.scale * read + channel.offset : null, reason: exception ?? `${read}` };
}

async function poll(connection, name, channel, take) {
  const every = 1000 * channel.every;
  for (let due = 0; ; due += every) {
    due = Math.max(due, Math.ceil(Date.now() / every) * every); // what is late is left out
    await sleep(due - Date.now());
    take(await sample(connection, name, channel));
  }
}

/** Runs until the connection is lost, which it throws. */
export async function read({ modbus, channels }, { take, log }) {
  const { socket, lost, connection } = await connected(modbus);
  log(`${modbus.address}: connected`);
  try {
    await Promise.race([
      lost,
      ...Object.entries(channels).map(([name, channel]) => poll(connection, name, channel, take)),
    ]);
  } finally {
    socket.destroy();
  }
}

/** Single registers of the machine, read and written when they are asked for. */
export async function open_machine({ modbus }) {
  const { socket, lost, connection } = await connected(modbus);
  return {
    sample: (name, channel) => sample(connection, name, channel),
    /** Why the server does not take a number, in words, or undefined. */
    async write(number, point) {
      try {
        return await connection.write(point.register, encode(number, point));
      } catch (error) {
        if (error instanceof RangeError) return `${number} is no ${point.type}`;
        throw error;
      }
    },
    lost,
    close: async () => socket.destroy(),
  };
}
