// Samples of the registers of a Modbus/TCP server: functions 3 and 4 of the Modbus application protocol 1.1b3.
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
const WORDS = { int16: 1, uint16: 1, int32: 2, uint32: 2, float32: 2 };
const DECODE = {
  int16: "readInt16BE",
  uint16: "readUInt16BE",
  int32: "readInt32BE",
  uint32: "readUInt32BE",
  float32: "readFloatBE",
};

/** The number in the registers (16 bits each, big-endian; `word_order` is that of the two words). */
function decode(registers, { type, word_order }) {
  if (word_order === "little" && WORDS[type] === 2)
    registers = Buffer.concat([registers.subarray(2, 4), registers.subarray(0, 2)]);
  return registers[DECODE[type]](0);
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
    return (this.last = this.last.then(() => this.exchange(code, address, count)));
  }

  async exchange(code, address, count) {
    const request = Buffer.alloc(12);
    const header = [
      (this.transaction = (this.transaction + 1) % 65536),
      0,
      6,
      (this.device << 8) | code,
      address,
      count,
    ];
    header.forEach((word, k) => request.writeUInt16BE(word, 2 * k));
    const asked = Date.now();
    this.socket.write(request);
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
    if (answer[8] !== 2 * count || answer.length !== 9 + 2 * count)
      throw new Error(`${answer[8]} bytes for ${count} registers`);
    return { stamp, registers: answer.subarray(9) };
  }
}

async function poll(connection, name, channel, take) {
  const every = 1000 * channel.every,
    code = FUNCTIONS[channel.table ?? "holding"];
  for (let due = 0; ; due += every) {
    due = Math.max(due, Math.ceil(Date.now() / every) * every); // what is late is left out
    await sleep(due - Date.now());
    const { stamp, registers, exception } = await connection.registers(code, channel.register, WORDS[channel.type]);
    const read = exception ? NaN : decode(registers, channel);
    const good = Number.isFinite(read);
    take({ name, stamp, value: good ? channel.scale * read + channel.offset : null, reason: exception ?? `${read}` });
  }
}

/** Runs until the connection is lost, which it throws. */
export async function read({ modbus, channels }, { take, log }) {
  const [, host, port] = /^(.*):(\d+)$/.exec(modbus.address);
  const timeout = 1000 * (modbus.timeout ?? 1);
  const socket = connect({ host, port: Number(port), noDelay: true });
  try {
    await once(socket, "connect", { signal: AbortSignal.timeout(timeout) });
    log(`${modbus.address}: connected`);
    const lost = once(socket, "close").then(() => {
      throw new Error("the connection is lost");
    });
    const connection = new Connection(socket, modbus.device ?? 1, timeout);
    await Promise.race([
      lost,
      ...Object.entries(channels).map(([name, channel]) => poll(connection, name, channel, take)),
    ]);
  } finally {
    socket.destroy();
  }
}
