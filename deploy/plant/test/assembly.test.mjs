// usage: node --test assembly.test.mjs
import assert from "node:assert/strict";
import test from "node:test";

import { Assembly } from "../assembly.mjs";

const CHANNELS = { fast: { every: 0.1 }, slow: { every: 1 } };
const values = (data) => data.map(({ seq, channels }) => [seq, channels.fast?.value, channels.slow?.value]);

/** Feeds [name, stamp, value] one after the other; the data that come out, with the stamp at which they did. */
function fed(assembly, samples) {
  return samples.flatMap(([name, stamp, value]) =>
    values(assembly.add(name, stamp, value)).map((datum) => [stamp, ...datum]),
  );
}

test("channels of their own rates meet at the model's times, on straight lines", () => {
  const assembly = new Assembly([1050, 2000], CHANNELS, 0, 5000);
  const samples = [
    ["slow", 500, 5],
    ["fast", 1000, 10],
    ["fast", 1100, 20],
    ["slow", 1500, 15],
    ["fast", 1950, 0],
    ["fast", 2000, 7],
  ];
  assert.deepEqual(fed(assembly, samples), [[1500, 0, 15, 10.5]]);
  assert.deepEqual(fed(assembly, [["slow", 2500, 25]]), [[2500, 1, 7, 20]]); // at 2000 `fast` was measured, not interpolated
  assert.equal(assembly.done, true);
});

test("a bad neighbour makes a value missing; samples too far apart say nothing", () => {
  const assembly = new Assembly([1050, 1150, 1250, 1900, 2000], { fast: { every: 0.1 } }, 0, 1000);
  const samples = [
    ["fast", 1000, 1],
    ["fast", 1100, null],
    ["fast", 1200, 3],
    ["fast", 1300, 4],
    ["fast", 1960, 5],
    ["fast", 2010, 6],
  ];
  const found = samples.flatMap((sample) => values(assembly.add(...sample)).map(([seq, value]) => [seq, value]));
  assert.deepEqual(found, [
    [0, null],
    [1, null],
    [2, 3.5],
    [4, 5.8],
  ]); // at 1900 nothing: no datum
});

test("a silent channel is waited for, and then left out", () => {
  const assembly = new Assembly([1000, 1100], CHANNELS, 0, 300);
  const fast = (stamp) => ["fast", stamp, stamp];
  assert.deepEqual(fed(assembly, [fast(950), fast(1050), fast(1150), fast(1250), fast(1300)]), []);
  assert.deepEqual(fed(assembly, [fast(1301)]), [[1301, 0, 1000, undefined]]);
  // Its sample for a time that is closed comes too late; that for the next one does not.
  assert.deepEqual(
    fed(assembly, [
      ["slow", 990, 1],
      ["slow", 1200, 22],
    ]),
    [[1200, 1, 1100, 1 + (21 * 110) / 210]],
  );
});

test("what is not newer is ignored, and what is in the spool is not made again", () => {
  const assembly = new Assembly([1000, 1100], { fast: { every: 0.1 } }, 1, 300);
  assert.equal(assembly.since("fast"), 1100 - 250);
  assert.deepEqual(
    fed(assembly, [
      ["fast", 950, 1],
      ["fast", 1050, 2],
      ["fast", 1050, 9],
      ["fast", 1000, 9],
    ]),
    [],
  );
  assert.equal(assembly.since("fast"), 1050);
  assert.deepEqual(assembly.add("fast", 1100, 3), [{ seq: 1, channels: { fast: { value: 3, stamps: [1100] } } }]);
});
