// usage: node --test spool.test.mjs
import assert from "node:assert/strict";
import { appendFileSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import test from "node:test";

import { Spool } from "../spool.mjs";

const IDENTITY = { source: "frame", session: "s", time: {}, channels: {} };
const HEAD = JSON.stringify({ identity: IDENTITY, layout: { times: [0, 1, 2, 3, 4] } });
const datum = (seq) => ({ seq, time: seq, channels: { 0: { value: 0.5 * seq, stamps: [seq] } } });
const seqs = (spool) => spool.waiting.map(({ seq }) => seq);

function in_a_folder(work) {
  const folder = mkdtempSync(join(tmpdir(), "spool-"));
  try {
    work(join(folder, "spool.jsonl"));
  } finally {
    rmSync(folder, { recursive: true });
  }
}

/** A disk that takes `bytes` of the next line, and then nothing until it is mended. */
function failing(spool, bytes) {
  const append = spool.append;
  spool.append = function (entry) {
    this.torn = true;
    appendFileSync(this.file, (JSON.stringify(entry) + "\n").slice(0, bytes));
    throw new Error("ENOSPC");
  };
  return () => (spool.append = append);
}

test("a disk that is full for a while loses nothing, and leaves no half line behind", () => {
  const whole = JSON.stringify(datum(2)).length + 1;
  for (let bytes = 0; bytes < whole; ++bytes)
    in_a_folder((path) => {
      writeFileSync(path, HEAD + "\n");
      const spool = new Spool(path, IDENTITY);
      spool.add([datum(0), datum(1)]);
      const mend = failing(spool, bytes);
      assert.throws(() => spool.add([datum(2), datum(3)]), /ENOSPC/);
      assert.throws(() => spool.sent(datum(0)), /ENOSPC/);
      assert.deepEqual(seqs(spool), [0, 1]);
      mend();
      spool.add([datum(4)]);
      spool.sent(datum(0));
      assert.deepEqual(seqs(spool), [1, 2, 3, 4]);
      const again = new Spool(path, IDENTITY);
      assert.deepEqual([seqs(again), again.next, again.repaired], [[1, 2, 3, 4], 5, 0]);
    });
});

test("a line torn at every byte, with another behind it, is left out", () => {
  const torn = JSON.stringify(datum(1));
  for (let bytes = 1; bytes < torn.length; ++bytes)
    in_a_folder((path) => {
      writeFileSync(path, [HEAD, JSON.stringify(datum(0)), torn.slice(0, bytes) + JSON.stringify(datum(2)), '{"sent":0}', ""].join("\n"));
      const spool = new Spool(path, IDENTITY);
      assert.deepEqual([seqs(spool), spool.repaired], [[2], 1]);
    });
  in_a_folder((path) => {
    writeFileSync(path, HEAD + "\n" + torn + "\n" + torn.slice(0, 20)); // and at the end
    assert.deepEqual(seqs(new Spool(path, IDENTITY)), [1]);
    assert.equal(readFileSync(path, "utf8"), HEAD + "\n" + torn + "\n");
    writeFileSync(path, HEAD + "\nnothing of ours\n");
    assert.throws(() => new Spool(path, IDENTITY), /:2: error: not a line of a spool/);
  });
});
