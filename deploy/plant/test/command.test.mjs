// usage: node --test command.test.mjs
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import test from "node:test";

import { Commander } from "../command.mjs";
import { Spool } from "../spool.mjs";

const IDENTITY = { source: "frame", session: "s", channels: {} };
const point = (node) => ({ node });
const COMMAND = {
  armed: true,
  timeout: 2,
  dead_time: 30,
  limits: { lower: 0, upper: 1, step: 0.5 },
  set_point: { ...point("set_point"), of: "time" },
  action: point("action"),
  sequence: point("sequence"),
  acknowledge: point("acknowledge"),
  heartbeat: { ...point("heartbeat"), every: 0.5 },
};
const DRIVEN = { ...COMMAND, reached: point("reached"), first: { time: 0.1, set_point: 0.1 } };

/** A machine that does at once what it is told, as long as it is well. */
class Machine {
  constructor() {
    Object.assign(this, { mute: false, refuses: null, writes: [] });
    this.numbers = { set_point: 0, action: 0, sequence: 0, acknowledge: 0, reached: 0, heartbeat: 0 };
  }

  async sample(name, { node, scale, offset }) {
    return { name, stamp: 0, value: scale * this.numbers[node] + offset };
  }

  async write(number, { node }) {
    if (this.refuses?.has(node)) return "BadUserAccessDenied";
    if (this.lost === node) throw new Error("the connection is lost");
    if (node === "sequence") assert.notEqual(number, this.numbers.sequence, "the machine sees no change");
    this.numbers[node] = number;
    if (node !== "heartbeat") this.writes.push([node, number]);
    if (node === "sequence" && !this.mute) this.numbers.acknowledge = number;
    if (node === "sequence" && !this.mute && !this.stuck) this.numbers.reached = number;
    return undefined;
  }

  /** The commands that it has had: [action, sequence number, set-point]. */
  get had() {
    const found = [];
    const now = {};
    for (const [node, number] of this.writes) {
      now[node] = number;
      if (node === "sequence") found.push([["hold", "load", "stop"][now.action], number, now.set_point]);
    }
    return found;
  }
}

const decision = (action, time, more = {}) => ({ action, time, plan: [time], message: "because", ...more });

/** A service that has decided something about the data of step k. */
function view(step, decided, { level = "ok", ...status } = {}) {
  const line = { step, time: step / 10, data: 1, decision: decided, verdict: { level, reasons: [] } };
  if (level === "reject") line.verdict.reasons = [{ level, message: "a sensor has the wrong sign" }];
  const now = { journal: "j", state: "OK", step, structure: level, pending: 0, behind: 0, data_age_s: 0, ...status };
  return { status: now, line };
}
const EMPTY = { status: { journal: "j", state: "STALE", pending: 0, behind: 0 } };

async function scene(command, work) {
  const folder = mkdtempSync(join(tmpdir(), "command-"));
  const path = join(folder, "spool.jsonl");
  const all = { machine: new Machine(), said: [], now: 1e12, path };
  all.log = (message) => all.said.push(message);
  all.start = async (changed = command) => {
    all.spool = new Spool(path, IDENTITY);
    if (!all.spool.layout) all.spool.begin({});
    all.commander = new Commander(changed, all.spool, {
      log: all.log,
      now: () => all.now,
      measure: async (_, time, command) => {
        const seq = all.spool.next;
        all.spool.add([{ seq, time, command, channels: {} }]);
        all.spool.sent({ seq });
        all.spool.sent_at = all.now;
      },
    });
    await all.commander.meet(all.machine);
  };
  /** So many looks, a heartbeat apart. */
  all.looks = async (seen, count = 1) => {
    for (let k = 0; k < count; ++k) {
      all.now += 500;
      await all.commander.tick({ ...seen, at: all.now }, all.machine);
      await all.commander.measuring;
    }
  };
  all.lines = () =>
    readFileSync(path, "utf8")
      .trim()
      .split("\n")
      .map((line) => JSON.parse(line));
  try {
    await all.start();
    await work(all);
  } finally {
    rmSync(folder, { recursive: true });
  }
}

test("each decision is sent once, in the order set-point, action, sequence number, and acknowledged", async () => {
  await scene(COMMAND, async ({ machine, looks, said, lines }) => {
    await looks(EMPTY, 2);
    assert.deepEqual(machine.had, []);
    await looks(view(1, decision("load", 0.4)), 4);
    await looks(view(1, decision("load", 0.4), { pending: 1 }), 2);
    await looks(view(4, decision("hold", 0.4)), 4);
    await looks(view(5, decision("stop", 0.4)), 4);
    await looks(view(6, decision("load", 0.6)), 4); // a stop is for good
    assert.deepEqual(machine.writes.slice(0, 3), [
      ["set_point", 0.4],
      ["action", 1],
      ["sequence", 1],
    ]);
    assert.deepEqual(machine.had, [
      ["load", 1, 0.4],
      ["hold", 2, 0.4],
      ["stop", 3, 0.4],
    ]);
    assert.equal(machine.numbers.heartbeat, 20);
    assert.ok(said.includes("command 1: load to 0.4 (because)") && said.includes("command 1 (load): acknowledged"));
    const orders = lines().filter(({ command }) => command);
    assert.deepEqual(
      orders.map(({ command, action, set_point, journal }) => [command, action, set_point, journal]),
      [
        [1, "load", 0.4, "j"],
        [2, "hold", undefined, "j"],
        [3, "stop", undefined, "j"],
      ],
    );
    assert.equal(orders[0].at, "2001-09-09T01:46:41.500Z");
  });
});

test("nothing is sent without armed", async () => {
  for (const armed of [undefined, false])
    await scene({ ...DRIVEN, armed }, async ({ machine, looks, said, lines }) => {
      await looks(EMPTY, 3);
      await looks(view(1, decision("load", 0.4)), 3);
      await looks({ trouble: "ECONNREFUSED" }, 3);
      assert.deepEqual([machine.writes, machine.numbers.heartbeat, lines().length], [[], 0, 1]);
      assert.ok(said.includes('dry run ("armed" is not true): would send load to 0.1 (the first load)'));
      assert.ok(said.includes('dry run ("armed" is not true): would send load to 0.4 (because)'));
    });
});

test("a driven test goes from the first load to the stop, measured where the machine is", async () => {
  await scene(DRIVEN, async ({ machine, looks, commander, lines }) => {
    await looks(EMPTY, 4);
    await looks(view(1, decision("load", 0.5)), 4);
    await looks(view(5, decision("hold", 0.5)), 4);
    await looks(view(5, decision("stop", 0.5)), 1);
    assert.equal(commander.stopped, false);
    await looks(view(5, decision("stop", 0.5)), 1);
    assert.equal(commander.stopped, true);
    assert.deepEqual(
      machine.had.map(([action]) => action),
      ["load", "load", "hold", "stop"],
    );
    assert.deepEqual(
      lines()
        .filter(({ channels }) => channels)
        .map(({ time, command }) => [time, command]),
      [
        [0.1, 1],
        [0.5, 2],
        [0.5, 3],
      ],
    );
  });
});

test("what the machine does not acknowledge is followed by a hold, until somebody has looked", async () => {
  await scene(COMMAND, async ({ machine, looks, said, start, spool, path }) => {
    machine.mute = true;
    const seen = view(1, decision("load", 0.4));
    await looks(seen, 5);
    assert.deepEqual(machine.had, [["load", 1, 0.4]]);
    await looks(seen, 1);
    assert.deepEqual(machine.had.slice(1), [["hold", 2, 0.4]]);
    assert.ok(
      said.some((line) => line.startsWith("ALARM: command 1 (load) is not acknowledged within 2 s; held until")),
    );
    assert.ok(machine.numbers.heartbeat > 0);
    await looks(seen, 6);
    const beats = machine.numbers.heartbeat;
    await looks(seen, 3); // not even the hold: its own watchdog has to do it
    assert.equal(machine.numbers.heartbeat, beats);
    assert.ok(
      said.includes("ALARM: command 2 (hold) is not acknowledged within 2 s: there is no heartbeat until it is"),
    );
    machine.numbers.acknowledge = 2; // late
    await looks(seen, 2);
    assert.equal(machine.numbers.heartbeat, beats + 2);
    await looks(view(2, decision("load", 0.5)), 5);
    await start();
    await looks(view(2, decision("load", 0.5)), 5);
    assert.equal(machine.had.length, 2);
    machine.mute = false;
    new Spool(path, IDENTITY).write({ released: new Date(1e12).toISOString() });
    await start();
    await looks(view(2, decision("load", 0.5)), 5);
    assert.deepEqual(machine.had.slice(2), [["load", 3, 0.5]]);
  });
});

test("a decision that is too old is not sent", async () => {
  await scene(COMMAND, async ({ machine, looks, said }) => {
    const seen = view(1, decision("load", 0.4), { data_age_s: undefined }); // the service was started again
    seen.line.received_at = 1e9 - 40;
    await looks(seen);
    assert.match(
      said[0],
      /^command 1: hold \(the decision \(load\) is 40.5 s old, dead_time is 30 s: somebody has to look/,
    );
    seen.line.received_at = 1e9 - 20;
    seen.line.data = 2;
    await looks(seen, 2);
    assert.deepEqual(machine.had[1], ["load", 2, 0.4]);
  });
  await scene(COMMAND, async ({ machine, looks, said }) => {
    await looks(view(1, decision("load", 0.4), { data_age_s: 31 }), 3);
    assert.deepEqual(machine.had, [["hold", 1, undefined]]);
    assert.ok(said.at(-2).includes("hold (the decision (load) is 31.0 s old, dead_time is 30 s: somebody has to look"));
    await looks(view(2, decision("load", 0.5)), 3);
    assert.deepEqual(machine.had[1], ["load", 2, 0.5]);
    await looks(view(2, decision("load", 0.5), { pending: 3 }), 62); // the data go on, the decisions do not
    assert.deepEqual(machine.had.slice(2), [["hold", 3, 0.5]]);
    await looks(view(5, decision("load", 0.6)), 2);
    assert.deepEqual(machine.had.slice(3), [["load", 4, 0.6]]);
  });
  await scene(DRIVEN, async ({ machine, looks, lines, said }) => {
    await looks(EMPTY, 3);
    for (let data = 1; data < 8; ++data) {
      const late = view(1, decision("load", 0.4), { data_age_s: 31 });
      late.line.data = data;
      await looks(late, 4);
    }
    const actions = machine.had.map(([action]) => action);
    assert.deepEqual(actions, ["load", "hold", "hold", "hold", "hold", "hold", "hold", "hold"]);
    // Measured once again, three times; then somebody has to look.
    assert.equal(lines().filter(({ channels }) => channels).length, 4);
    assert.ok(said.some((line) => line.includes("it was measured 3 times again: somebody has to look")));
  });
});

test("a set-point outside the limits is not sent", async () => {
  for (const [time, text] of [
    [1.2, "the set-point 1.2 is outside command.limits, 0 to 1"],
    [NaN, "the set-point NaN is outside command.limits, 0 to 1"],
    [0.6, "the set-point 0.6 is a step of 0.6 from 0, more than command.limits.step, 0.5"],
  ])
    await scene(COMMAND, async ({ machine, looks, said }) => {
      await looks(view(1, decision("load", time)), 3);
      assert.deepEqual(machine.had, [["hold", 1, undefined]]);
      assert.ok(said.includes(`command 1: hold (ALARM: ${text}: somebody has to look)`), said.join("\n"));
      await looks(view(2, decision("load", 0.5)), 3);
      assert.deepEqual(machine.had[1], ["load", 2, 0.5]);
    });
  await scene({ ...COMMAND, set_point: point("set_point") }, async ({ machine, looks, said }) => {
    await looks(view(1, decision("load", 0.2)), 3);
    assert.deepEqual(machine.had, [["hold", 1, undefined]]);
    assert.match(said.join("\n"), /the decision has no load, as the model does not know what is imposed/);
    await looks(view(2, decision("load", 0.2, { load: 0.3 })), 3);
    assert.deepEqual(machine.had[1], ["load", 2, 0.3]);
  });
});

test("the raw set-point is that of its scale", async () => {
  const set_point = { ...COMMAND.set_point, scale: 1e-3, offset: 0.1 };
  await scene({ ...COMMAND, set_point }, async ({ machine, looks }) => {
    await looks(view(1, decision("load", 0.4)), 2);
    assert.ok(Math.abs(machine.numbers.set_point - 300) < 1e-9);
  });
});

test("reject, and a service that is gone or has gone wrong, hold", async () => {
  const load = (step) => view(step, decision("load", 0.1 * step));
  for (const [seen, text, beats] of [
    [{ trouble: "ECONNREFUSED" }, "held: the service does not answer: ECONNREFUSED", false],
    [view(1, decision("hold", 0.1, { plan: [] }), { level: "reject" }), "command 2: hold (because; ", true],
    [view(2, undefined, { level: "reject" }), "held: the service decides nothing: the project has no [decide]", true],
    [
      view(2, undefined, { level: "reject", pending: 1 }),
      "held: the verdict is reject: a sensor has the wrong sign",
      true,
    ],
    [view(2, decision("load", 0.2), { structure: undefined }), "held: the verdict is not known", false],
    [
      view(2, decision("load", 0.2), { journal: "k" }),
      "held: the service serves another test, or another journal",
      true,
    ],
    [view(2, decision("load", 0.2), { state: "DIVERGED", reason: "no" }), "held: the service is DIVERGED: no", true],
  ])
    await scene(COMMAND, async ({ machine, looks, said }) => {
      await looks(load(1), 3);
      const before = machine.numbers.heartbeat;
      await looks({}, 2); // it did not answer, for less than the time-out
      assert.deepEqual([machine.had.length, machine.numbers.heartbeat], [1, before]);
      await looks(seen, 3);
      assert.deepEqual(machine.had.slice(1), [["hold", 2, 0.1]], text);
      assert.equal(machine.numbers.heartbeat, before + (beats ? 3 : 0), text);
      if (text.startsWith("held")) assert.ok(said.includes(text), said.join("\n"));
      await looks(load(3), 3);
      assert.deepEqual(machine.had.slice(2), [["load", 3, 0.1 * 3]], text);
    });
});

test("what a hold cut short is sent again under another number, once it may", async () => {
  await scene(DRIVEN, async ({ machine, looks, lines }) => {
    await looks(EMPTY, 3);
    const seen = view(1, decision("load", 0.5));
    await looks(seen, 1);
    machine.numbers.reached = 1; // it is on its way
    await looks({ trouble: "ECONNREFUSED" }, 3);
    await looks(seen, 4);
    assert.deepEqual(machine.had, [
      ["load", 1, 0.1],
      ["load", 2, 0.5],
      ["hold", 3, 0.5],
      ["load", 4, 0.5],
    ]);
    await looks({ trouble: "ECONNREFUSED" }, 3); // measured already
    await looks(seen, 3);
    assert.deepEqual(machine.had.slice(4), [["hold", 5, 0.5]]);
    assert.deepEqual(
      lines()
        .filter(({ channels }) => channels)
        .map(({ command }) => command),
      [1, 4],
    );
  });
});

test("killed at any write, it sends nothing twice", async () => {
  for (const torn of ["set_point", "action", "sequence"])
    await scene(COMMAND, async (all) => {
      const { machine, looks, start, said, lines } = all;
      await looks(view(1, decision("load", 0.2)), 3);
      machine.lost = torn;
      const seen = view(2, decision("load", 0.4));
      await assert.rejects(looks(seen), /the connection is lost/);
      machine.lost = null;
      await start();
      await looks(seen, 3);
      assert.deepEqual(machine.had, [
        ["load", 1, 0.2],
        ["load", 3, 0.4],
      ]);
      assert.ok(said.includes("command 2 (load) did not get to the machine"));
      assert.equal(lines().filter(({ dropped }) => dropped === 2).length, 1);
      await start();
      await looks(seen, 3);
      assert.equal(machine.had.length, 2);
      assert.equal(said.filter((line) => line === "command 3 (load): confirmed").length, 1);
    });
  await scene(COMMAND, async ({ machine, looks, start, said }) => {
    machine.mute = true; // killed between the write and its acknowledgement
    const seen = view(1, decision("load", 0.2));
    await looks(seen);
    machine.numbers.acknowledge = 1;
    await start();
    await looks(seen, 3);
    assert.deepEqual(machine.had, [["load", 1, 0.2]]);
    assert.ok(said.includes("command 1 (load): acknowledged"));
  });
});

test("a machine that was started again, or that refuses, is left alone", async () => {
  await scene(COMMAND, async ({ machine, looks, said }) => {
    await looks(view(1, decision("load", 0.2)), 3);
    machine.numbers.sequence = machine.numbers.acknowledge = 0;
    await looks(view(2, decision("load", 0.4)), 5);
    assert.match(
      said.join("\n"),
      /the machine's sequence number is 0, not 1: it was started again, or another program/,
    );
    assert.deepEqual(machine.had.slice(1), [["hold", 2, 0.2]]);
  });
  for (const refuses of [["set_point"], ["set_point", "action"]])
    await scene(COMMAND, async ({ machine, looks, said, lines }) => {
      machine.refuses = new Set(refuses);
      await looks(view(1, decision("load", 0.2)), 9);
      assert.match(
        said.join("\n"),
        /ALARM: command.set_point: the machine refuses 0.2: BadUserAccessDenied; held until/,
      );
      assert.deepEqual(machine.had, refuses.length === 1 ? [["hold", 2, undefined]] : []);
      assert.ok(lines().length < 9);
    });
});

test("a machine that was started again goes on from its own number, once somebody has looked", async () => {
  for (const [command, seen] of [
    [COMMAND, view(2, decision("hold", 0.2))],
    [DRIVEN, view(2, decision("load", 0.4))],
  ])
    await scene(command, async ({ machine, looks, path, start }) => {
      await looks(EMPTY, 3);
      await looks(view(1, decision("load", 0.2)), 3);
      await looks(seen, 3);
      for (const sets of [() => 0, () => 20, (number) => number + 1]) {
        const sequence = sets(machine.numbers.sequence);
        machine.numbers.sequence = machine.numbers.acknowledge = machine.numbers.reached = sequence;
        const before = machine.had.length;
        await looks(view(3, decision("load", 0.45)), 4);
        assert.ok(machine.had.length <= before + 1);
        new Spool(path, IDENTITY).write({ released: new Date(1e12).toISOString() });
        await start();
        await looks(view(4, decision("load", 0.5 + 0.001 * sequence)), 4);
        assert.deepEqual([machine.had.at(-1)[0], machine.numbers.acknowledge], ["load", machine.had.at(-1)[1]]);
      }
    });
});

test("a sequence number that does not stay where it was written holds, and is not written for ever", async () => {
  await scene(COMMAND, async ({ machine, looks, said }) => {
    const write = machine.write.bind(machine);
    machine.write = async (number, where) => {
      const refusal = await write(number, where);
      machine.numbers.sequence = 0;
      return refusal;
    };
    await looks(view(1, decision("load", 0.2)), 9);
    assert.deepEqual(
      machine.had.map(([action]) => action),
      ["load", "hold"],
    );
    assert.match(said.join("\n"), /the machine's sequence number is 0, not 1: .*; held until somebody has looked/);
  });
});

test("a load that is taken and never done is held after its time", async () => {
  await scene({ ...DRIVEN, travel: 10 }, async ({ machine, looks, said }) => {
    machine.stuck = true;
    await looks(EMPTY, 20);
    assert.equal(machine.had.length, 1);
    await looks(EMPTY, 4);
    assert.deepEqual(
      machine.had.map(([action]) => action),
      ["load", "hold"],
    );
    assert.ok(said.some((line) => line.startsWith("ALARM: command 1 (load) is not done within 10 s; held until")));
  });
});

test("by the clock, a rejection holds as often as it comes", async () => {
  await scene(COMMAND, async ({ machine, looks, said }) => {
    await looks(view(1, decision("load", 0.2)), 3);
    for (let step = 2; step < 8; ++step)
      await looks(view(step, decision("hold", 0.2, { plan: [] }), { level: "reject" }), 3);
    assert.deepEqual(machine.had.map(([action]) => action).slice(1), Array(6).fill("hold"));
    assert.ok(!said.some((line) => line.includes("measured")));
  });
});

test("after a rejection it is measured three times again", async () => {
  await scene(DRIVEN, async ({ machine, looks, lines }) => {
    await looks(EMPTY, 3);
    for (let data = 1; data < 9; ++data) {
      const seen = view(1, decision("hold", 0.1, { plan: [] }), { level: "reject" });
      seen.line.data = data;
      await looks(seen, 4);
    }
    assert.equal(lines().filter(({ channels }) => channels).length, 4);
    await looks(view(1, decision("load", 0.2)), 4); // the bad datum was withdrawn
    assert.deepEqual(machine.had.at(-1).slice(0, 1), ["load"]);
  });
});

test("somebody who has looked may have it measured three times more", async () => {
  await scene(DRIVEN, async ({ looks, lines, path, start }) => {
    const reject = async (data) => {
      const seen = view(1, decision("hold", 0.1, { plan: [] }), { level: "reject" });
      seen.line.data = data;
      await looks(seen, 4);
    };
    await looks(EMPTY, 3);
    for (let data = 1; data < 6; ++data) await reject(data);
    new Spool(path, IDENTITY).write({ released: new Date(1e12).toISOString() });
    await start();
    for (let data = 5; data < 12; ++data) await reject(data);
    assert.equal(lines().filter(({ channels }) => channels).length, 7);
  });
});

test("what was decided before the last datum was stored, or before all were withdrawn, moves nothing", async () => {
  await scene(DRIVEN, async (all) => {
    const { machine, looks } = all;
    await looks(EMPTY, 3);
    all.spool.sent_at = all.now + 600; // the answer to a question that was asked earlier
    await looks(view(1, decision("load", 0.3)));
    assert.equal(machine.had.length, 1);
    await looks(view(1, decision("load", 0.4)), 3);
    await looks(EMPTY, 3);
    assert.deepEqual(machine.had, [
      ["load", 1, 0.1],
      ["load", 2, 0.4],
    ]);
  });
});

test("a bridge that ends tells the machine", async () => {
  await scene(COMMAND, async ({ machine, looks, commander }) => {
    await looks(view(1, decision("load", 0.2)), 3);
    commander.ending = "the bridge is stopped (SIGTERM)";
    await looks(view(1, decision("load", 0.2)), 1);
    assert.ok(!commander.ended);
    await looks(view(1, decision("load", 0.2)), 2);
    assert.ok(commander.ended);
    assert.deepEqual(machine.had.slice(1), [["hold", 2, 0.2]]);
  });
});

test("numbers begin again at 1 after 65535", async () => {
  await scene(COMMAND, async ({ machine, looks, start }) => {
    machine.numbers.sequence = 65534; // of an earlier session
    await start();
    await looks(view(1, decision("load", 0.2)), 3);
    await looks(view(2, decision("load", 0.3)), 3);
    assert.deepEqual(
      machine.had.map(([, number]) => number),
      [65535, 1],
    );
  });
});
