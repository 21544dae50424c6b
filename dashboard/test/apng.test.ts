// An animation that is played by the rules of the format shows the pictures that it was made of.
import assert from "node:assert/strict";
import { test } from "node:test";
import { deflateSync, inflateSync } from "node:zlib";
// @ts-expect-error: plain JavaScript, as the recorder runs it
import { animation, decode } from "./apng.mjs";

const [width, height] = [23, 17];

/** A PNG of RGB pixels with a filter of its own in each row. */
function png(colour: (x: number, y: number) => number): Buffer {
  const rgb = Array.from({ length: height }, (_, y) =>
    Array.from({ length: width }, (_, x) => colour(x, y)).flatMap((c) => [c >> 16, (c >> 8) & 255, c & 255]),
  );
  const paeth = (a: number, b: number, c: number): number => {
    const p = a + b - c;
    const [pa, pb, pc] = [Math.abs(p - a), Math.abs(p - b), Math.abs(p - c)];
    return pa <= pb && pa <= pc ? a : pb <= pc ? b : c;
  };
  const rows = rgb.flatMap((row, y) => {
    const filter = y % 5;
    return [
      filter,
      ...row.map((v, i) => {
        const [a, b, c] = [row[i - 3] ?? 0, rgb[y - 1]?.[i] ?? 0, rgb[y - 1]?.[i - 3] ?? 0];
        return (v - [0, a, b, Math.floor((a + b) / 2), paeth(a, b, c)][filter]!) & 255;
      }),
    ];
  });
  const chunk = (name: string, content: Buffer): Buffer => {
    const length = Buffer.alloc(4);
    length.writeUInt32BE(content.length);
    return Buffer.concat([length, Buffer.from(name), content, Buffer.alloc(4)]);
  };
  const header = Buffer.alloc(13);
  header.writeUInt32BE(width);
  header.writeUInt32BE(height, 4);
  header.set([8, 2], 8);
  return Buffer.concat([Buffer.alloc(8), chunk("IHDR", header), chunk("IDAT", deflateSync(Buffer.from(rows)))]);
}

/** The pictures that a player shows, and how long. */
function played(file: Buffer): { shown: number[][]; delays: number[]; plays: number } {
  const chunks: [string, Buffer][] = [];
  for (let at = 8; at < file.length; at += 12 + file.readUInt32BE(at))
    chunks.push([file.toString("latin1", at + 4, at + 8), file.subarray(at + 8, at + 8 + file.readUInt32BE(at))]);
  const only = (name: string): Buffer => chunks.find(([n]) => n === name)![1];
  const [colours, opacity] = [only("PLTE"), only("tRNS")];
  const canvas = Array.from({ length: width * height }, () => -1);
  const [shown, delays]: [number[][], number[]] = [[], []];
  let control: Buffer = Buffer.alloc(0);
  for (const [name, content] of chunks) {
    if (name === "fcTL") control = content;
    if (name !== "IDAT" && name !== "fdAT") continue;
    const [w, h, x, y] = [4, 8, 12, 16].map((i) => control.readUInt32BE(i)) as [number, number, number, number];
    const rows = inflateSync(name === "IDAT" ? content : content.subarray(4));
    for (let j = 0; j < h; j += 1)
      for (let i = 0; i < w; i += 1) {
        const index = rows[j * (w + 1) + 1 + i]!;
        if (opacity[index] === 255) canvas[(y + j) * width + x + i] = colours.readUIntBE(3 * index, 3);
      }
    shown.push([...canvas]);
    delays.push(control.readUInt16BE(20) / control.readUInt16BE(22));
  }
  assert.equal(only("acTL").readUInt32BE(0), shown.length);
  return { shown, delays, plays: only("acTL").readUInt32BE(4) };
}

const pixels = (colour: (x: number, y: number) => number): number[] =>
  Array.from({ length: width * height }, (_, i) => colour(i % width, Math.floor(i / width)));

test("every frame is the picture it was made of", () => {
  const pictures = [0, 1, 1, 2].map(
    (k) => (x: number, y: number) => (x > 3 * k && y > 2 ? 0x0072b2 : 0xff0000 + 16 * y + (x % 3)),
  );
  pictures.forEach((p) => assert.deepEqual([...decode(png(p)).pixels], pixels(p)));
  const { shown, delays, plays } = played(animation(pictures.map(png), [100, 250, 40, 2000], 3));
  assert.deepEqual(shown, pictures.map(pixels));
  assert.deepEqual(delays, [0.1, 0.25, 0.04, 2]);
  assert.equal(plays, 3);
});

test("more colours than a palette holds: each becomes one that is near", () => {
  const picture = (x: number, y: number): number => ((x * 11) << 16) + ((y * 15) << 8) + ((x * y) % 256);
  const { shown } = played(animation([png(picture)], [100], 0));
  pixels(picture).forEach((p, i) => {
    for (const shift of [16, 8, 0]) {
      const off = Math.abs(((p >> shift) & 255) - ((shown[0]![i]! >> shift) & 255));
      assert.ok(off <= 24, `${off}`);
    }
  });
});
