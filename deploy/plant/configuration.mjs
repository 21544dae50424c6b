// What a user may write in the bridge's configuration, and what is said where it is wrong (docs/how-to/plant-data.md).
import { readFileSync } from "node:fs";

/** A mistake of the configuration: the bridge ends with status 3. */
export class ConfigurationError extends Error {}

const text = (value) => (typeof value === "string" && value !== "" ? "" : "must be a string that is not empty");
const number = (value) => (Number.isFinite(value) ? "" : "must be a number");
const positive = (value) => (value > 0 && Number.isFinite(value) ? "" : "must be a positive number");
const index = (value) =>
  Number.isInteger(value) && value >= 0 && value <= 65535 ? "" : "must be an integer from 0 to 65535";
const table = (value) => (value && typeof value === "object" && !Array.isArray(value) ? "" : "must be a table {…}");
const instant = (value) =>
  typeof value === "string" && /^\d{4}-.*T.*(Z|[+-]\d\d:\d\d)$/.test(value) && !Number.isNaN(Date.parse(value))
    ? ""
    : 'must be a time with its zone, such as "2026-11-23T09:00:00Z"';
const http = (value) => (/^https?:\/\/[^/]+$/.test(value) ? "" : 'must be "http://HOST:PORT", without a path');
const one_of =
  (...words) =>
  (value) =>
    words.includes(value) ? "" : `must be one of ${words.map((word) => `"${word}"`).join(", ")}`;

// Member: [its check, whether it is required].
const members = {
  "": {
    service: [table, true],
    source: [text, true],
    session: [text, true],
    time: [table, true],
    wait: [positive],
    spool: [text, true],
    opcua: [table],
    modbus: [table],
    channels: [table, true],
  },
  service: { address: [http, true], site: [text], read_token: [text], ingest_token: [text] },
  time: { start: [instant, true], seconds: [positive, true] },
  opcua: {
    endpoint: [(value) => (/^opc\.tcp:\/\/./.test(value) ? "" : 'must be "opc.tcp://HOST:PORT"'), true],
    security: [one_of("none", "sign", "sign_and_encrypt")],
    user: [text],
    password: [text],
  },
  modbus: {
    address: [(value) => (/^[^:]+:\d+$/.test(value) ? "" : 'must be "HOST:PORT"; 502 is usual'), true],
    device: [(value) => index(value) || (value > 255 ? "must be an integer from 0 to 255" : "")],
    timeout: [positive],
  },
  channel: { every: [positive, true], scale: [number], offset: [number], unit: [text] },
  opcua_channel: { node: [text, true] },
  modbus_channel: {
    register: [index, true],
    table: [one_of("holding", "input")],
    word_order: [one_of("big", "little")],
    type: [one_of("int16", "uint16", "int32", "uint32", "float32"), true],
  },
};

function faults_of(value, where, known) {
  const name = (key) => (where ? `${where}.${key}` : key);
  const faults = Object.keys(value)
    .filter((key) => !(key in known))
    .map((key) => `${name(key)}: is not known here; there are ${Object.keys(known).join(", ")}`);
  for (const [key, [check, required]] of Object.entries(known)) {
    if (!(key in value)) faults.push(...(required ? [`${name(key)}: is missing`] : []));
    else if (check(value[key])) faults.push(`${name(key)}: ${check(value[key])}, not ${JSON.stringify(value[key])}`);
  }
  return faults;
}

function all_faults(configuration) {
  if (table(configuration)) return [`the file ${table(configuration)}`];
  const faults = faults_of(configuration, "", members[""]);
  const readers = ["opcua", "modbus"].filter((reader) => reader in configuration);
  if (readers.length !== 1) faults.push('there must be one of "opcua" and "modbus": a bridge speaks with one server');
  for (const part of ["service", "time", ...readers])
    if (!table(configuration[part])) faults.push(...faults_of(configuration[part], part, members[part]));
  if (table(configuration.channels)) return faults;
  if (Object.keys(configuration.channels).length === 0) faults.push("channels: there must be one at least");
  const known = { ...members.channel, ...members[`${readers[0]}_channel`] };
  for (const [name, channel] of Object.entries(configuration.channels))
    faults.push(
      ...(table(channel) ? [`channels.${name}: ${table(channel)}`] : faults_of(channel, `channels.${name}`, known)),
    );
  return faults;
}

function parse(path) {
  let content;
  try {
    content = readFileSync(path, "utf8");
    return JSON.parse(content);
  } catch (error) {
    const at = /position (\d+)/.exec(error.message);
    if (content === undefined || !at) throw new ConfigurationError(`${path}: error: ${error.message}`);
    const before = content.slice(0, Number(at[1])).split("\n");
    throw new ConfigurationError(
      `${path}:${before.length}:${before.at(-1).length + 1}: error: not JSON: ${error.message}`,
    );
  }
}

export function read_configuration(path) {
  const configuration = parse(path);
  const faults = all_faults(configuration);
  if (faults.length > 0) throw new ConfigurationError(faults.map((fault) => `${path}: error: ${fault}`).join("\n"));
  for (const channel of Object.values(configuration.channels))
    Object.assign(channel, { scale: 1, offset: 0, ...channel });
  return configuration;
}

/** The first line of a file with a token or a password. */
export function secret(path) {
  if (path === undefined) return undefined;
  try {
    return readFileSync(path, "utf8").split("\n")[0].trim();
  } catch (error) {
    throw new ConfigurationError(`${path}: error: ${error.message}`);
  }
}
