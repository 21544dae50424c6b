// A simulated OPC UA server for the tests: numbers that change at their own rates, are stamped by their source 0.3 s
// before anyone can read them, and have a history.
//
// usage: node opcua_server.mjs PORT FOLDER, then on its standard input, as one line,
//        {NAME: {"start", "value", "rate", "every", "bad": [from, to], "uncertain": [from, to]}}
// At Unix time t, s, a node has value + rate·(t − start), every `every` s; from `bad[0]` to `bad[1]` its status is Bad
// and its value anything. With {"type"} in place of "every" a node is a number that was last written, or
// {"echo": NAME}: what another is; {"follows": NAME, "full", "values"}: the k-th of the values where the other is
// (k + 1) / their count of `full`. Writes are printed as `write NAME VALUE`.
import certificate_manager from "node-opcua-certificate-manager";
import { DataType, StatusCodes, Variant } from "node-opcua-client";
import opcua_nodesets from "node-opcua-nodesets";
import opcua_server from "node-opcua-server";
import { once } from "node:events";
import { join } from "node:path";

const DELAY_MS = 300;
const [port, folder] = process.argv.slice(2);
const keys = (name) =>
  new certificate_manager.OPCUACertificateManager({
    rootFolder: join(folder, name),
    automaticallyAcceptUnknownCertificate: true,
  });
const server = new opcua_server.OPCUAServer({
  port: Number(port),
  hostname: "127.0.0.1",
  nodeset_filename: [opcua_nodesets.nodesets.standard],
  serverCertificateManager: keys("server-pki"),
  userCertificateManager: keys("user-pki"),
  userManager: { isValidUser: (user, password) => user === "gauge" && password === "correct horse" },
});
await server.start();
console.log("listening");

const [line] = await once(process.stdin, "data");
const space = server.engine.addressSpace;
const within = (span, t) => span && t >= span[0] && t < span[1];

function status_at(node, t) {
  return within(node.bad, t)
    ? StatusCodes.BadSensorFailure
    : within(node.uncertain, t)
      ? StatusCodes.UncertainLastUsableValue
      : StatusCodes.Good;
}

/** A node that is read and written as a number. */
function add_variable(name, { type, echo, follows, full, values }) {
  numbers[name] = 0;
  const follow = () => values[Math.max(0, Math.round((numbers[follows] / full) * values.length) - 1)];
  space.getOwnNamespace().addVariable({
    browseName: name,
    nodeId: `s=${name}`,
    dataType: type,
    organizedBy: space.rootFolder.objects,
    value: {
      get: () => new Variant({ dataType: DataType[type], value: follows ? follow() : numbers[echo ?? name] }),
      set: (variant) => {
        console.log(`write ${name} ${(numbers[name] = variant.value)}`);
        return StatusCodes.Good;
      },
    },
  });
}

const numbers = {};
for (const [name, node] of Object.entries(JSON.parse(line))) {
  if (node.type) {
    add_variable(name, node);
    continue;
  }
  const variable = space.getOwnNamespace().addVariable({
    browseName: name,
    nodeId: `s=${name}`,
    dataType: "Double",
    organizedBy: space.rootFolder.objects,
    minimumSamplingInterval: 10,
  });
  space.installHistoricalDataNode(variable, { maxOnlineValues: 100000 });
  const every = 1000 * node.every;
  let next = Math.ceil((Date.now() - DELAY_MS) / every) * every;
  setInterval(() => {
    for (; next <= Date.now() - DELAY_MS; next += every) {
      const status = status_at(node, next / 1000);
      const value = status === StatusCodes.Good ? node.value + node.rate * (next / 1000 - node.start) : 1e300;
      variable.setValueFromSource(new Variant({ dataType: DataType.Double, value }), status, new Date(next));
    }
  }, 5);
}
