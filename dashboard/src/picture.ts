/** The picture behind the structure: fetched at the pace of live data, laid where it belongs. */
import { useEffect, useRef, useState } from "preact/hooks";
import type { Vec3 } from "./camera";

/** The structure is drawn so much through over a picture. */
export const throughPicture = 0.55;
const shortestInterval = 400;

/** The picture of a step, or the last that could be had; nothing while `step` is `undefined`. */
export function usePicture(
  step: number | undefined,
  fetchPicture: (step: number) => Promise<ImageBitmap>,
): ImageBitmap | undefined {
  const [found, setFound] = useState<ImageBitmap>();
  const busy = useRef(false);
  const wanted = useRef(step);
  wanted.current = step;
  useEffect(() => {
    const next = async (): Promise<void> => {
      const at = wanted.current;
      if (busy.current || at === undefined) return;
      busy.current = true;
      const picture = await fetchPicture(at).catch(() => undefined);
      setFound(picture);
      setTimeout(() => {
        busy.current = false;
        if (wanted.current !== at) void next();
      }, shortestInterval);
    };
    void next();
  }, [step]);
  return step === undefined ? undefined : found;
}

/** Draws `image` with its corners (top left, top right, bottom left) at these pixels. */
export function drawPicture(canvas: HTMLCanvasElement, image: ImageBitmap | undefined, corners: Vec3[], ratio: number) {
  const ctx = canvas.getContext("2d")!;
  ctx.setTransform(1, 0, 0, 1, 0, 0);
  ctx.clearRect(0, 0, canvas.width, canvas.height);
  const [origin, right, down] = corners;
  if (!image || !origin || !right || !down) return;
  const along = (to: Vec3, k: 0 | 1, size: number): number => (ratio * (to[k] - origin[k])) / size;
  const { width: w, height: h } = image;
  ctx.setTransform(
    along(right, 0, w),
    along(right, 1, w),
    along(down, 0, h),
    along(down, 1, h),
    ratio * origin[0],
    ratio * origin[1],
  );
  ctx.drawImage(image, 0, 0);
}
