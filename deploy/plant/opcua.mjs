// The nodes of an OPC UA server: samples with the time stamps of their source, and commands.
import certificate_manager from "node-opcua-certificate-manager";
import {
  AttributeIds,
  DataChangeFilter,
  DataChangeTrigger,
  DataType,
  DeadbandType,
  MessageSecurityMode,
  OPCUAClient,
  SecurityPolicy,
  TimestampsToReturn,
  UserTokenType,
} from "node-opcua-client";
import { dirname, join } from "node:path";
import { setTimeout as sleep } from "node:timers/promises";

import { secret } from "./configuration.mjs";

const PUBLISHING_MS = 250;
const QUEUED_S = 60; // what the server keeps of each node while nobody fetches it
const INTEGERS = {
  SByte: [-128, 127],
  Byte: [0, 255],
  Int16: [-32768, 32767],
  UInt16: [0, 65535],
  Int32: [-2147483648, 2147483647],
  UInt32: [0, 4294967295],
};
const SILENCE_MS = 10000; // a subscription says at least every 2.5 s that it is alive

/** Bad and Uncertain (OPC 10000-4, 7.39) are missing values, as is what is no number. */
function sample(name, { scale, offset }, { statusCode, value, sourceTimestamp, sourcePicoseconds, serverTimestamp }) {
  const stamp = sourceTimestamp
    ? sourceTimestamp.getTime() + (sourcePicoseconds ?? 0) * 1e-9
    : serverTimestamp?.getTime();
  const good = statusCode.value >>> 30 === 0 && Number.isFinite(value?.value);
  return {
    name,
    stamp,
    value: good ? scale * value.value + offset : null,
    reason: good ? "" : `${statusCode.name}, ${value?.value}`,
  };
}

const disconnect = (client) => Promise.race([client.disconnect().catch(() => {}), sleep(2000)]); // a dead server answers nothing

async function connect({ endpoint, security, user, password }, spool) {
  const secure = security && security !== "none";
  const client = OPCUAClient.create({
    applicationName: "knothe-plant",
    endpointMustExist: false,
    keepSessionAlive: true,
    connectionStrategy: { maxRetry: 0 },
    securityMode:
      { sign: MessageSecurityMode.Sign, sign_and_encrypt: MessageSecurityMode.SignAndEncrypt }[security] ??
      MessageSecurityMode.None,
    securityPolicy: secure ? SecurityPolicy.Basic256Sha256 : SecurityPolicy.None,
    // Its own key is made here at the first start; of a server's certificate, the first one is trusted.
    clientCertificateManager: new certificate_manager.OPCUACertificateManager({
      rootFolder: join(dirname(spool), "opcua-pki"),
      automaticallyAcceptUnknownCertificate: true,
    }),
  });
  await client.connect(endpoint);
  const identity = user
    ? { type: UserTokenType.UserName, userName: user, password: secret(password) ?? "" }
    : { type: UserTokenType.Anonymous };
  return { client, session: await client.createSession(identity) };
}

/** What the server remembers of a channel since then; null where it keeps no history. */
async function history(session, name, channel, since, log) {
  const samples = [];
  for (let from = since; ;) {
    const { statusCode, historyData, continuationPoint } = await session.readHistoryValue(
      channel.node,
      new Date(from),
      new Date(),
    );
    if (statusCode.value >>> 30 === 2) {
      const lost = "what it measured while nobody listened is missing";
      log(`channels.${name}: the server keeps no history (${statusCode.name}): ${lost}`);
      return null;
    }
    const found = (historyData?.dataValues ?? [])
      .filter((value) => value.sourceTimestamp)
      .map((value) => sample(name, channel, value));
    samples.push(...found);
    const last = found.at(-1)?.stamp;
    if (!continuationPoint?.length || !(last > from)) return samples;
    from = last;
  }
}

async function subscribe(session, channels, take) {
  const subscription = await session.createSubscription2({
    requestedPublishingInterval: PUBLISHING_MS,
    requestedLifetimeCount: 1000,
    requestedMaxKeepAliveCount: 10,
    maxNotificationsPerPublish: 0,
    publishingEnabled: true,
    priority: 1,
  });
  for (const [name, channel] of Object.entries(channels)) {
    const item = await subscription.monitor(
      { nodeId: channel.node, attributeId: AttributeIds.Value },
      // A value that stays the same is a sample too, if it has a new time stamp.
      {
        samplingInterval: 1000 * channel.every,
        queueSize: Math.ceil(QUEUED_S / channel.every),
        discardOldest: true,
        filter: new DataChangeFilter({
          trigger: DataChangeTrigger.StatusValueTimestamp,
          deadbandType: DeadbandType.None,
          deadbandValue: 0,
        }),
      },
      TimestampsToReturn.Both,
    );
    if (item.statusCode.value >>> 30 === 2)
      throw new Error(`channels.${name}: the server refuses to watch "${channel.node}": ${item.statusCode.name}`);
    item.on("changed", (value) => take(sample(name, channel, value)));
  }
  return subscription;
}

/** Runs until the connection is lost, which it throws. */
export async function read({ opcua, channels, spool }, { since, gap, take, log }) {
  const { client, session } = await connect(opcua, spool);
  let waiting = []; // samples that came while the history is read: it goes first
  let remembers = false;

  /** What the server remembers of all channels together, in its order, then what came meanwhile; how much that is. */
  async function catch_up() {
    const since_then = ([name, channel]) => history(session, name, channel, since(name), log);
    const past = await Promise.all(Object.entries(channels).map(since_then));
    remembers = past.some((samples) => samples !== null);
    const samples = past.flatMap((samples) => samples ?? []).sort((a, b) => a.stamp - b.stamp);
    const all = [...samples, ...waiting];
    waiting = null;
    all.forEach(take);
    return samples.length;
  }

  let alive = Date.now();
  let watchdog, reject;
  const lost = new Promise((_, rejects) => (reject = rejects));
  lost.catch(() => {}); // it is waited for below
  const fail = (event) => reject(new Error(`the connection is lost (${event.replaceAll("_", " ")})`));
  try {
    for (const event of ["connection_lost", "close"]) client.on(event, () => fail(event));
    const subscription = await subscribe(session, channels, (one) => {
      if (waiting) return waiting.push(one);
      if (!remembers || !gap(one.name, one.stamp)) return take(one);
      waiting = [one]; // the server was too busy to tell all that it has
      catch_up().catch(reject);
    });
    for (const event of ["keepalive", "received_notifications"]) subscription.on(event, () => (alive = Date.now()));
    subscription.on("terminated", () => fail("subscription_terminated"));
    watchdog = setInterval(() => Date.now() - alive > SILENCE_MS && fail("silence"), 1000);
    log(`${opcua.endpoint}: connected; ${await catch_up()} samples of its history`);
    await lost;
  } finally {
    clearInterval(watchdog);
    await disconnect(client);
  }
}

/** Single nodes of the machine, read and written when they are asked for. */
export async function open_machine({ opcua, spool }) {
  const { client, session } = await connect(opcua, spool);
  const types = new Map();
  const lost = new Promise((_, reject) => {
    for (const event of ["connection_lost", "close"])
      client.on(event, () => reject(new Error(`the connection is lost (${event.replaceAll("_", " ")})`)));
  });
  lost.catch(() => {}); // it is waited for elsewhere
  return {
    async sample(name, channel) {
      const found = await session.read({ nodeId: channel.node, attributeId: AttributeIds.Value });
      types.set(channel.node, found.value?.dataType);
      return { ...sample(name, channel, found), stamp: found.sourceTimestamp?.getTime() ?? Date.now() };
    },
    /** Why the server does not take a number for a node that was read, in words, or undefined. */
    async write(number, { node }) {
      const dataType = types.get(node);
      const decimal = dataType === DataType.Float || dataType === DataType.Double;
      const value = decimal ? number : Math.round(number);
      const [lowest, highest] = INTEGERS[DataType[dataType]] ?? [Infinity, -Infinity];
      if (!decimal && !(value >= lowest && value <= highest)) return `${number} is no ${DataType[dataType]}`;
      const status = await session.write({
        nodeId: node,
        attributeId: AttributeIds.Value,
        value: { value: { dataType, value } },
      });
      return status.value >>> 30 === 0 ? undefined : status.name;
    },
    lost,
    close: () => disconnect(client),
  };
}
