// What a user may write in the bridge's configuration, and what is said where it is wrong (docs/how-to/plant-data.md).
import { readFileSync } from "node:fs";

import { WORDS } from "./modbus.mjs";

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
const truth = (value) => (typeof value === "boolean" ? "" : "must be true or false");
const codes = (value) =>
  table(value) ||
  (["hold", "load", "stop"].every((action) => index(value[action]) === "") && Object.keys(value).length === 3
    ? ""
    : 'must be {"hold": …, "load": …, "stop": …} with integers from 0 to 65535');
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
    time: [table],
    wait: [positive],
    spool: [text, true],
    opcua: [table],
    modbus: [table],
    mqtt: [table],
    channels: [table, true],
    command: [table],
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
  mqtt: {
    broker: [(value) => (/^[^:]+:\d+$/.test(value) ? "" : 'must be "HOST:PORT"; 1883 is usual, 8883 with TLS'), true],
    user: [text],
    password: [text],
    ca: [text],
  },
  command: {
    armed: [truth],
    timeout: [positive],
    travel: [positive],
    dead_time: [positive, true],
    limits: [table, true],
    first: [table],
    set_point: [table, true],
    action: [table, true],
    sequence: [table, true],
    acknowledge: [table, true],
    reached: [table],
    heartbeat: [table, true],
  },
  limits: { lower: [number, true], upper: [number, true], step: [positive, true] },
  first: { time: [number, true], set_point: [number, true] },
  point: {
    set_point: {
      of: [one_of("load", "time")],
      scale: [(value) => (value === 0 ? "must not be 0" : number(value))],
      offset: [number],
      unit: [text],
    },
    action: { codes: [codes] },
    sequence: {},
    acknowledge: {},
    reached: {},
    heartbeat: { every: [positive, true] },
  },
  channel: { every: [positive, true], scale: [number], offset: [number], unit: [text] },
  mqtt_channel: {
    topic: [(value) => text(value) || (/[#+]/.test(value) ? "must be one topic, without # and +" : ""), true],
  },
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

const POINTS = Object.keys(members.point);
const READ = ["acknowledge", "reached"]; // the others are written

/** Two numbers that would be written, or one that is written and one that is read, at one place of the machine. */
function faults_of_places(command) {
  const taken = new Map();
  const faults = [];
  for (const name of POINTS.filter((name) => command[name])) {
    const { node, topic, register, type = "uint16", table = "holding" } = command[name];
    const places =
      (node ?? topic)
        ? [node ?? topic]
        : Array.from({ length: WORDS[type] ?? 1 }, (_, k) => `${table} register ${register + k}`);
    for (const place of places) {
      if (taken.has(place)) faults.push(`command.${name}: ${place} is that of command.${taken.get(place)}`);
      taken.set(place, name);
    }
  }
  return faults;
}

function faults_of_command(command, reader) {
  const faults = faults_of(command, "command", members.command);
  const part = (name) => (name in command && !table(command[name]) ? command[name] : undefined);
  for (const name of ["limits", "first"])
    if (part(name)) faults.push(...faults_of(part(name), `command.${name}`, members[name]));
  for (const name of POINTS.filter(part)) {
    const { register, table: from, ...place } = members[`${reader}_channel`] ?? {};
    const known = {
      ...place,
      ...(register && { register, type: [place.type[0]] }),
      ...(READ.includes(name) && from && { table: from }),
    };
    faults.push(...faults_of(part(name), `command.${name}`, { ...members.point[name], ...known }));
  }
  if (faults.length > 0) return faults;
  const { lower, upper } = command.limits;
  if (!(lower < upper)) faults.push(`command.limits: lower, ${lower}, must be less than upper, ${upper}`);
  const first = command.first?.set_point;
  if (first !== undefined && !(first >= lower && first <= upper))
    faults.push(`command.first.set_point: ${first} is outside command.limits, ${lower} to ${upper}`);
  if (command.first && !command.reached)
    faults.push(
      "command.first: is that of a driven test, which needs command.reached: who else knows when to measure?",
    );
  if (command.heartbeat.every >= (command.timeout ?? 2))
    faults.push(
      `command.heartbeat.every: ${command.heartbeat.every} must be less than command.timeout, ${command.timeout ?? 2}`,
    );
  return [...faults, ...faults_of_places(command)];
}

/** The model's time is that of the clock, or that of the command which the machine has done. */
function faults_of_time(configuration, driven) {
  if (!("time" in configuration)) return driven ? [] : ["time: is missing"];
  if (driven)
    return ["time: must be absent with command.reached: data are taken where the machine has reached a command"];
  return table(configuration.time) ? [] : faults_of(configuration.time, "time", members.time);
}

function all_faults(configuration) {
  if (table(configuration)) return [`the file ${table(configuration)}`];
  const faults = faults_of(configuration, "", members[""]);
  const readers = ["opcua", "modbus", "mqtt"].filter((reader) => reader in configuration);
  if (readers.length !== 1)
    faults.push('there must be one of "opcua", "modbus" and "mqtt": a bridge speaks with one server');
  for (const part of ["service", ...readers])
    if (!table(configuration[part])) faults.push(...faults_of(configuration[part], part, members[part]));
  const { command } = configuration;
  const driven = !table(command) && "reached" in command;
  faults.push(...faults_of_time(configuration, driven));
  if (!table(command)) faults.push(...faults_of_command(command, readers[0]));
  if (table(configuration.channels)) return faults;
  if (Object.keys(configuration.channels).length === 0) faults.push("channels: there must be one at least");
  const { every, ...value } = members.channel;
  const known = { ...value, ...(!driven && { every }), ...members[`${readers[0]}_channel`] };
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
  for (const name of POINTS.filter((name) => configuration.command?.[name]?.register !== undefined))
    configuration.command[name].type ??= "uint16";
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
