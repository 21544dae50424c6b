/** Pictures to take away: title, legend and plot on one canvas. */
import type { LegendEntry } from "./chart";
import { through, type Theme } from "./colour";

interface Composition {
  title: string;
  legend: LegendEntry[];
  picture: HTMLCanvasElement;
  theme: Theme;
  ratio: number;
}

export function composePng({ title, legend, picture, theme, ratio }: Composition): Promise<Blob> {
  const canvas = document.createElement("canvas");
  const width = picture.width;
  const ctx = canvas.getContext("2d")!;
  const font = (size: number, weight = 400): string => `${weight} ${size * ratio}px system-ui, sans-serif`;
  ctx.font = font(12);
  const places = layLegend(ctx, legend, width, ratio);
  const rows = (places[places.length - 1]?.row ?? -1) + 1;
  const head = title ? 34 : 8;
  const top = (head + rows * 18) * ratio;
  canvas.width = width;
  canvas.height = top + picture.height + 6 * ratio;
  ctx.fillStyle = theme.panel;
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.fillStyle = theme.text;
  ctx.font = font(14, 600);
  ctx.fillText(title, 10 * ratio, 22 * ratio);
  ctx.font = font(12);
  for (const { entry, x, row } of places) {
    const y = (head + 10 + row * 18) * ratio;
    ctx.fillStyle = entry.look === "band" ? through(entry.colour, entry.opacity ?? 0.3) : entry.colour;
    const thin = entry.look === "line" || entry.look === "dash";
    ctx.fillRect(x, y - (thin ? 5 : 9) * ratio, 16 * ratio, (thin ? 2 : 10) * ratio);
    ctx.fillStyle = theme.text;
    ctx.fillText(text(entry), x + 21 * ratio, y);
  }
  ctx.drawImage(picture, 0, top);
  return blobOf(canvas);
}

/** Pictures one below the other. */
export async function stackPng(blobs: readonly Blob[], theme: Theme): Promise<Blob> {
  const pictures = await Promise.all(blobs.map((blob) => createImageBitmap(blob)));
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(1, ...pictures.map((p) => p.width));
  canvas.height = Math.max(
    1,
    pictures.reduce((sum, p) => sum + p.height, 0),
  );
  const ctx = canvas.getContext("2d")!;
  ctx.fillStyle = theme.panel;
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  let y = 0;
  for (const picture of pictures) {
    ctx.drawImage(picture, 0, y);
    y += picture.height;
  }
  return blobOf(canvas);
}

function text(entry: LegendEntry): string {
  return entry.value === undefined ? entry.label : `${entry.label} ${entry.value}`;
}

function layLegend(ctx: CanvasRenderingContext2D, legend: LegendEntry[], width: number, ratio: number) {
  let x = 10 * ratio;
  let row = 0;
  return legend.map((entry) => {
    const w = ctx.measureText(text(entry)).width + 38 * ratio;
    if (x + w > width && x > 10 * ratio) {
      x = 10 * ratio;
      row += 1;
    }
    const place = { entry, x, row };
    x += w;
    return place;
  });
}

export function blobOf(canvas: HTMLCanvasElement): Promise<Blob> {
  return new Promise((resolve, reject) =>
    canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("no picture"))), "image/png"),
  );
}

export function save(blob: Blob, name: string): void {
  const link = document.createElement("a");
  const address = URL.createObjectURL(blob);
  link.setAttribute("href", address);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

export function saveText(text: string, name: string): void {
  save(new Blob([text], { type: "text/csv" }), name);
}
