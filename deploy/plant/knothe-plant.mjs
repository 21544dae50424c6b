#!/usr/bin/env node
// Load cells and gauges from OPC UA, Modbus/TCP or MQTT to `knothe serve` (docs/how-to/plant-data.md), and its decisions
// to the test machine (docs/how-to/drive-a-machine.md).
//
// usage: node knothe-plant.mjs CONFIGURATION.json [--release]
// Ends with 0 once the last time of the model is stored, or the test has stopped; 2 wrong usage, 3 configuration,
// 4 refused by the service, 1 anything else. --release: somebody has looked at a machine that is held; ends at once.
// It may be killed at any time.
import { setTimeout as sleep } from "node:timers/promises";

import { Assembly } from "./assembly.mjs";
import { Commander } from "./command.mjs";
import { ConfigurationError, read_configuration } from "./configuration.mjs";
import { Refusal, Service, places } from "./service.mjs";
import { Spool } from "./spool.mjs";

const RETRY_MS = 1000;
const AHEAD_MS = 60000; // a stamp further in the future is that of a wrong clock

const said = new Map(); // the same about the same thing is said once
function log(message, about = "") {
  if (said.get(about) !== message) console.error(`${new Date().toISOString()} ${message}`);
  said.set(about, message);
}

/** What a reader calls with each sample. */
function taker(assembly, spool, instants, layout) {
  return ({ name, stamp, value, reason }) => {
    if (!(stamp <= Date.now() + AHEAD_MS))
      return log(`channels.${name}: a time stamp in the future, or none: ignored`, name);
    const gap = assembly.gap(name, stamp);
    if (gap) log(`channels.${name}: no sample for ${gap / 1000} s, or more: missing there`, `gap ${name}`);
    log(value === null ? `channels.${name}: missing (${reason})` : `channels.${name}: measured`, name);
    const data = assembly.add(name, stamp, value).map(({ seq, channels }) => {
      return { seq, time: layout.times[seq], instant: new Date(instants[seq]).toISOString(), channels };
    });
    let next = spool.unwritten.length > 0 ? spool.unwritten.at(-1).seq + 1 : spool.next;
    for (const { seq } of data) {
      if (seq > next) log(`times ${layout.times[next]} to ${layout.times[seq - 1]}: nothing was measured`);
      next = seq + 1;
    }
    keep(spool, data);
  };
}

/** In the spool, or in memory while the disk does not take it. */
function keep(spool, data = []) {
  try {
    spool.add(data);
    if (said.has(spool.path)) log("the spool is written again", spool.path);
  } catch (error) {
    log(`${spool.path}: ${error.message}: kept in memory, and written again`, spool.path);
  }
}

const address_of = ({ opcua, modbus, mqtt }) => opcua?.endpoint ?? modbus?.address ?? mqtt.broker;
const client = ({ opcua, modbus }) => import(opcua ? "./opcua.mjs" : modbus ? "./modbus.mjs" : "./mqtt.mjs");

/** Does `work` until it says that it is done, again where a connection is lost, unless it is time to end. */
async function persist(configuration, work, ending = () => false) {
  for (;;) {
    try {
      if (await work(await client(configuration))) return;
    } catch (error) {
      if (error instanceof ConfigurationError) throw error;
      if (ending()) return;
      log(`${address_of(configuration)}: ${error.message}; tried again`);
    }
    await sleep(RETRY_MS);
  }
}

/** Reads by the clock until there is nothing to wait for. */
function read_all(configuration, assembly, take) {
  return persist(configuration, async ({ read }) => {
    if (assembly.done) return true;
    await read(configuration, {
      since: (name) => assembly.since(name),
      gap: (name, stamp) => assembly.gap(name, stamp),
      take,
      log,
    });
  });
}

/** Of a driven test: one datum, of what the channels have now. */
async function measure(configuration, spool, machine, time, command) {
  const { channels } = configuration;
  const samples = await Promise.all(Object.entries(channels).map((channel) => machine.sample(...channel)));
  for (const { name, value, reason } of samples)
    log(value === null ? `channels.${name}: missing (${reason})` : `channels.${name}: measured`, name);
  const good = samples.filter(({ value }) => value !== null);
  if (good.length === 0) return log(`time ${time}: nothing was measured; tried again`, "measure");
  const found = Object.fromEntries(samples.map(({ name, value, stamp }) => [name, { value, stamps: [stamp] }]));
  keep(spool, [{ seq: spool.next, time, instant: new Date().toISOString(), command, channels: found }]);
}

/** What the service says, or what is in the way for as long as the time-out. */
function viewer(service, timeout) {
  let answered = Date.now();
  return async () => {
    try {
      const view = await service.look(1000 * timeout);
      answered = Date.now();
      return view;
    } catch (error) {
      return Date.now() - answered >= 1000 * timeout ? { trouble: error.message } : {};
    }
  };
}

/** Decisions go to the machine until `finished()`, or until it was told that the bridge ends. */
function command_all(configuration, commander, service, finished) {
  const { timeout = 2, heartbeat } = configuration.command;
  const look = viewer(service, timeout);
  const work = async ({ open_machine }) => {
    const machine = await open_machine(configuration);
    try {
      await commander.meet(machine);
      log("the machine answers");
      while (!finished() && !commander.ended) {
        const due = Date.now() + 1000 * heartbeat.every;
        const view = await look();
        await Promise.race([machine.lost, commander.tick(view, machine)]);
        await sleep(Math.max(0, due - Date.now()));
      }
      return true;
    } finally {
      await machine.close();
    }
  };
  return persist(configuration, work, () => commander.ending);
}

/** Sends what is in the spool, in its order. */
async function send_all(configuration, finished, spool, service) {
  const { source, session, channels } = configuration;
  const { site } = configuration.service;
  const place = places(Object.keys(channels), spool.layout);
  const count = spool.layout.displacements + spool.layout.scalars.length;
  for (; !finished() || spool.waiting.length > 0 || spool.unwritten.length > 0;) {
    const datum = spool.waiting[0];
    if (!datum) {
      if (spool.unwritten.length > 0) keep(spool);
      await sleep(20);
      continue;
    }
    const values = new Array(count).fill(null);
    for (const [name, { value }] of Object.entries(datum.channels)) values[place[name]] = value;
    const key = { ...(site && { site }), source, session, seq: datum.seq };
    const { quarantined, reason } = await service.store({ ...key, time: datum.time, values });
    if (quarantined) log(`time ${datum.time}: in quarantine: ${reason}`);
    try {
      spool.sent(datum);
    } catch (error) {
      log(`${spool.path}: ${error.message}: may be sent again`, spool.path);
      spool.waiting.shift();
    }
  }
}

/** Data that go by the clock: those who read and send them, and whether all of them are in the spool. */
function by_the_clock(configuration, spool) {
  const { time, channels } = configuration;
  const instants = spool.layout.times.map((t) => Date.parse(time.start) + 1000 * time.seconds * t);
  const slowest = Math.max(...Object.values(channels).map(({ every }) => every));
  const wait = 1000 * (configuration.wait ?? Math.max(1, 5 * slowest));
  const assembly = new Assembly(instants, channels, spool.next, wait);
  const [first, last] = [instants[0], instants.at(-1)].map((instant) => new Date(instant).toISOString());
  log(`${instants.length} times of the model, ${first} to ${last}; in the spool up to ${spool.next}`);
  const reading = read_all(configuration, assembly, taker(assembly, spool, instants, spool.layout));
  return { reading: reading.then(() => new Promise(() => {})), finished: () => assembly.done };
}

/** The first load of a driven test must be one of the model's times. */
function check_first({ command }, { times }) {
  if (!command?.first) return;
  const { time } = command.first;
  const nearest = times.reduce((best, one) => (Math.abs(one - time) < Math.abs(best - time) ? one : best));
  if (Math.abs(nearest - time) > 1e-6 * (times.at(-1) - times[0]))
    throw new ConfigurationError(
      `error: command.first.time: ${time} is no time of the model; the nearest is ${nearest}`,
    );
  command.first.time = nearest;
}

function open_spool(configuration) {
  const { source, session, time, channels } = configuration;
  const spool = new Spool(configuration.spool, { source, session, ...(time && { time }), channels });
  if (spool.repaired > 0) log(`${spool.path}: ${spool.repaired} lines that were cut short are left out`);
  return spool;
}

async function main([path, option, ...others]) {
  if (!path || others.length > 0 || ![undefined, "--release"].includes(option)) {
    console.error("usage: node knothe-plant.mjs CONFIGURATION.json [--release]");
    return 2;
  }
  const configuration = read_configuration(path);
  const spool = open_spool(configuration);
  if (option === "--release") {
    spool.write({ released: new Date().toISOString() });
    return 0;
  }
  const service = new Service(configuration.service, log);
  if (!spool.layout) {
    const layout = await service.layout();
    places(Object.keys(configuration.channels), layout);
    check_first(configuration, layout);
    spool.begin(layout);
  }
  check_first(configuration, spool.layout);
  const { command } = configuration;
  const commander =
    command &&
    new Commander(command, spool, {
      log,
      tell: (text) => service.note(configuration.source, text),
      measure: (...what) => measure(configuration, spool, ...what),
    });
  const data = configuration.time ? by_the_clock(configuration, spool) : { finished: () => commander.stopped };
  const sent = () => data.finished() && spool.waiting.length + spool.unwritten.length === 0;
  let refusal;
  const sending = send_all(configuration, data.finished, spool, service);
  if (!commander) await Promise.race([data.reading, sending]);
  else {
    for (const signal of ["SIGTERM", "SIGINT"])
      process.on(signal, () => (commander.ending = `the bridge is stopped (${signal})`));
    sending.catch((error) => {
      refusal = error;
      commander.ending = error.message;
    });
    const told = command_all(configuration, commander, service, () => sent() && commander.settled);
    await Promise.race([data.reading, told].filter(Boolean));
  }
  if (refusal) throw refusal;
  log(commander?.ending ?? (commander?.driven ? "the test has stopped" : "the last time of the model is stored"));
  return commander?.ending ? 130 : 0;
}

main(process.argv.slice(2)).then(
  (status) => process.exit(status),
  (error) => {
    console.error(error instanceof ConfigurationError || error instanceof Refusal ? error.message : error);
    process.exit(error instanceof ConfigurationError ? 3 : error instanceof Refusal ? 4 : 1);
  },
);
