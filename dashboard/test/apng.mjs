// Screenshots to one animated PNG with one palette; of each frame after the first, what has changed. Needs nothing but zlib.
import { deflateSync, inflateSync } from "node:zlib";

const signature = Buffer.from([0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a]);
const table = Uint32Array.from({ length: 256 }, (_, n) => {
  let c = n;
  for (let k = 0; k < 8; k += 1) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
  return c >>> 0;
});

function chunk(name, ...parts) {
  const content = Buffer.concat([Buffer.from(name), ...parts]);
  const whole = Buffer.alloc(content.length + 8);
  whole.writeUInt32BE(content.length - 4);
  content.copy(whole, 4);
  let crc = 0xffffffff;
  for (const byte of content) crc = table[(crc ^ byte) & 255] ^ (crc >>> 8);
  whole.writeUInt32BE(~crc >>> 0, content.length + 4);
  return whole;
}

/** Big-endian, each of four bytes. */
const words = (...values) => Buffer.from(Uint32Array.from(values).buffer).swap32();

/** A screenshot, eight bits a channel, not interlaced, as 0xRRGGBB. */
export function decode(png) {
  const [width, height, channels] = [png.readUInt32BE(16), png.readUInt32BE(20), png[25] === 6 ? 4 : 3];
  const parts = [];
  for (let at = 8; at < png.length; at += 12 + png.readUInt32BE(at))
    if (png.toString("latin1", at + 4, at + 8) === "IDAT")
      parts.push(png.subarray(at + 8, at + 8 + png.readUInt32BE(at)));
  const raw = inflateSync(Buffer.concat(parts));
  const row = width * channels;
  const bytes = Buffer.alloc(height * row);
  for (let y = 0; y < height; y += 1) {
    const filter = raw[y * (row + 1)];
    for (let i = 0; i < row; i += 1) {
      const left = i < channels ? 0 : bytes[y * row + i - channels];
      const up = y === 0 ? 0 : bytes[(y - 1) * row + i];
      const corner = y === 0 || i < channels ? 0 : bytes[(y - 1) * row + i - channels];
      const [a, b, c] = [Math.abs(up - corner), Math.abs(left - corner), Math.abs(left + up - 2 * corner)];
      const paeth = a <= b && a <= c ? left : b <= c ? up : corner;
      bytes[y * row + i] = raw[y * (row + 1) + 1 + i] + [0, left, up, (left + up) >> 1, paeth][filter];
    }
  }
  const pixels = Uint32Array.from({ length: width * height }, (_, i) => bytes.readUIntBE(i * channels, 3));
  return { width, height, pixels };
}

const distance = (a, b) =>
  Math.abs((a >> 16) - (b >> 16)) + Math.abs(((a >> 8) & 255) - ((b >> 8) & 255)) + Math.abs((a & 255) - (b & 255));

/** The commonest colours, none nearer to another than it must be for `most` to be enough. */
function paletteOf(frames, most) {
  const counts = new Map();
  for (const { pixels } of frames) for (const p of pixels) counts.set(p, (counts.get(p) ?? 0) + 1);
  const common = [...counts.keys()].sort((a, b) => counts.get(b) - counts.get(a));
  for (let apart = 0; ; apart += 4) {
    const kept = [];
    for (const c of common) {
      if (kept.every((k) => distance(k, c) > apart)) kept.push(c);
      if (kept.length > most) break;
    }
    if (kept.length <= most) return kept;
  }
}

/** The smallest rectangle that holds all that differs; one pixel where nothing does. */
function changed(before, now, width) {
  let [left, top, right, bottom] = [Infinity, Infinity, -1, -1];
  now.forEach((value, i) => {
    if (value === before[i]) return;
    const [x, y] = [i % width, Math.floor(i / width)];
    [left, top, right, bottom] = [Math.min(left, x), Math.min(top, y), Math.max(right, x), Math.max(bottom, y)];
  });
  return right < 0 ? [0, 0, 1, 1] : [left, top, right - left + 1, bottom - top + 1];
}

/** `shots`: PNG files of one size; `delays`: how long each is shown, ms; `plays`: how often the whole, 0 for ever. */
export function animation(shots, delays, plays) {
  const frames = shots.map(decode);
  const { width, height } = frames[0];
  const palette = paletteOf(frames, 255);
  const clear = palette.length; // the colour of what has not changed
  const places = new Map(palette.map((c, i) => [c, i]));
  const place = (c) => {
    if (!places.has(c)) {
      let best = 0;
      palette.forEach((p, i) => distance(p, c) < distance(palette[best], c) && (best = i));
      places.set(c, best);
    }
    return places.get(c);
  };
  const parts = [
    signature,
    chunk("IHDR", words(width, height), Buffer.from([8, 3, 0, 0, 0])),
    chunk("acTL", words(frames.length, plays)),
    chunk("PLTE", Buffer.from([...palette, 0].flatMap((c) => [c >> 16, (c >> 8) & 255, c & 255]))),
    chunk("tRNS", Buffer.from([...palette.map(() => 255), 0])),
  ];
  let before = [];
  let sequence = 0;
  frames.forEach(({ pixels }, k) => {
    const now = Uint8Array.from(pixels, place);
    const [x, y, w, h] = k === 0 ? [0, 0, width, height] : changed(before, now, width);
    const rows = Buffer.alloc(h * (w + 1)); // each begins with its filter, which is none
    for (let j = 0; j < h; j += 1)
      for (let i = 0; i < w; i += 1) {
        const at = (y + j) * width + x + i;
        rows[j * (w + 1) + 1 + i] = now[at] === before[at] ? clear : now[at];
      }
    const timing = Buffer.from([delays[k] >> 8, delays[k] & 255, 1000 >> 8, 1000 & 255, 0, k === 0 ? 0 : 1]);
    parts.push(chunk("fcTL", words(sequence++, w, h, x, y), timing));
    const content = deflateSync(rows, { level: 9 });
    parts.push(k === 0 ? chunk("IDAT", content) : chunk("fdAT", words(sequence++), content));
    before = now;
  });
  return Buffer.concat([...parts, chunk("IEND")]);
}
