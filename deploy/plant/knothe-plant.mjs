#!/usr/bin/env node
// Load cells and gauges from OPC UA or Modbus/TCP to `knothe serve`: docs/how-to/plant-data.md.
//
// usage: node knothe-plant.mjs CONFIGURATION.json
// Ends with 0 once the last time of the model is stored; 2 wrong usage, 3 configuration, 4 refused by the service,
// 1 anything else.
// It may be killed at any time.
import { setTimeout as sleep } from "node:timers/promises";

import { Assembly } from "./assembly.mjs";
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

/** Reads, from a new connection where one is lost, until there is nothing to wait for. */
async function read_all(configuration, assembly, take) {
  const { read } = await import(configuration.opcua ? "./opcua.mjs" : "./modbus.mjs");
  while (!assembly.done) {
    await read(configuration, {
      since: (name) => assembly.since(name),
      gap: (name, stamp) => assembly.gap(name, stamp),
      take,
      log,
    }).catch((error) => {
      if (error instanceof ConfigurationError) throw error;
      log(`${configuration.opcua?.endpoint ?? configuration.modbus.address}: ${error.message}; tried again`);
    });
    await sleep(RETRY_MS);
  }
}

/** Sends what is in the spool, in its order. */
async function send_all(configuration, assembly, spool, service) {
  const { source, session, channels } = configuration;
  const { site } = configuration.service;
  const place = places(Object.keys(channels), spool.layout);
  const count = spool.layout.displacements + spool.layout.scalars.length;
  for (; !assembly.done || spool.waiting.length > 0 || spool.unwritten.length > 0;) {
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

async function main([path, ...others]) {
  if (!path || others.length > 0) {
    console.error("usage: node knothe-plant.mjs CONFIGURATION.json");
    return 2;
  }
  const configuration = read_configuration(path);
  const { source, session, time, channels } = configuration;
  const spool = new Spool(configuration.spool, { source, session, time, channels });
  const service = new Service(configuration.service, log);
  if (spool.repaired > 0) log(`${spool.path}: ${spool.repaired} lines that were cut short are left out`);
  if (!spool.layout) {
    const layout = await service.layout();
    places(Object.keys(channels), layout);
    spool.begin(layout);
  }
  const instants = spool.layout.times.map((t) => Date.parse(time.start) + 1000 * time.seconds * t);
  const slowest = Math.max(...Object.values(channels).map(({ every }) => every));
  const wait = 1000 * (configuration.wait ?? Math.max(1, 5 * slowest));
  const assembly = new Assembly(instants, channels, spool.next, wait);
  const [first, last] = [instants[0], instants.at(-1)].map((instant) => new Date(instant).toISOString());
  log(`${instants.length} times of the model, ${first} to ${last}; in the spool up to ${spool.next}`);
  await Promise.race([
    send_all(configuration, assembly, spool, service),
    read_all(configuration, assembly, taker(assembly, spool, instants, spool.layout)).then(() => new Promise(() => {})),
  ]);
  log("the last time of the model is stored");
  return 0;
}

main(process.argv.slice(2)).then(
  (status) => process.exit(status),
  (error) => {
    console.error(error instanceof ConfigurationError || error instanceof Refusal ? error.message : error);
    process.exit(error instanceof ConfigurationError ? 3 : error instanceof Refusal ? 4 : 1);
  },
);
