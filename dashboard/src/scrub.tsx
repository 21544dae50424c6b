/** Back in time: a slider over all steps, with what happened marked on it. */
import { useEffect, useRef, useState } from "preact/hooks";
import type { Theme } from "./colour";
import { clock, timeWords } from "./format";
import type { Event, StepLine } from "./types";

interface Props {
  lines: readonly StepLine[];
  version: number;
  chosen: number | undefined;
  line: StepLine | undefined;
  timeUnits: string | undefined;
  events: readonly Event[];
  theme: Theme;
  choose: (step: number | undefined) => void;
  playing: boolean;
  setPlaying: (playing: boolean) => void;
}

export function Scrub({ lines, version, chosen, line, timeUnits, events, theme, choose, playing, setPlaying }: Props) {
  const track = useRef<HTMLCanvasElement>(null);
  const [width, setWidth] = useState(600);
  const first = lines[0]?.step ?? 0;
  const last = lines[lines.length - 1]?.step ?? 0;
  useEffect(() => {
    const observer = new ResizeObserver(() => setWidth(track.current!.clientWidth));
    observer.observe(track.current!);
    return () => observer.disconnect();
  }, []);
  useEffect(
    () => paint(track.current!, width, lines, events, theme, first, last),
    [version, width, theme, events, first, last],
  );
  const past = chosen !== undefined;
  return (
    <section class={`scrub ${past ? "past" : ""}`} aria-label="Time">
      <button
        type="button"
        onClick={() => setPlaying(!playing)}
        aria-label={playing ? "Stop" : "Play the steps"}
        title="Space"
        disabled={lines.length < 2}
      >
        {playing ? "❚❚" : "▶"}
      </button>
      <div class="track">
        <canvas ref={track} aria-hidden="true" />
        <input
          type="range"
          min={first}
          max={Math.max(last, first + 1)}
          step={1}
          value={line?.step ?? last}
          disabled={lines.length < 2}
          aria-label="Step shown"
          aria-valuetext={line ? `step ${line.step} of ${last}, ${past ? "in the past" : "the latest"}` : "no step yet"}
          onInput={(e) => {
            const wanted = Number(e.currentTarget.value);
            const nearest = lines.reduce(
              (best, l) => (Math.abs(l.step - wanted) < Math.abs(best.step - wanted) ? l : best),
              lines[0]!,
            );
            choose(nearest.step === last ? undefined : nearest.step);
          }}
        />
      </div>
      <button type="button" class={past ? "" : "on"} onClick={() => choose(undefined)} aria-pressed={!past} title="L">
        {past ? "back to live" : "● live"}
      </button>
      <p>
        {past && line
          ? `Viewing step ${line.step} (${timeWords(line.time, timeUnits)}${clockOf(line)}), ${last - line.step} steps before the latest.`
          : line
            ? `Step ${line.step}, ${timeWords(line.time, timeUnits)}${clockOf(line)}: the latest.`
            : "No step yet."}
      </p>
    </section>
  );
}

function clockOf(line: StepLine): string {
  return line.received_at === undefined ? "" : `, ${clock(line.received_at)}`;
}

/** Used steps dark, steps without data empty; below it, marks of warnings and alarms. */
function paint(
  canvas: HTMLCanvasElement,
  width: number,
  lines: readonly StepLine[],
  events: readonly Event[],
  theme: Theme,
  first: number,
  last: number,
): void {
  const ratio = devicePixelRatio;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(22 * ratio);
  const ctx = canvas.getContext("2d")!;
  ctx.scale(ratio, ratio);
  const knob = 8;
  const at = (step: number): number => knob + ((step - first) / Math.max(1, last - first)) * (width - 2 * knob);
  const half = Math.max(1, (width - 2 * knob) / Math.max(1, last - first)) / 2 + 0.3;
  for (const line of lines) {
    if (line.used === 0) continue;
    ctx.fillStyle = line.trusted ? theme.blue : theme.orange;
    ctx.globalAlpha = line.trusted ? 0.45 : 1;
    ctx.fillRect(at(line.step) - half, 9, 2 * half, 4);
  }
  ctx.globalAlpha = 1;
  for (const event of events) {
    if (event.severity === "info") continue;
    ctx.fillStyle = event.severity === "alarm" ? theme.red : theme.orange;
    ctx.beginPath();
    ctx.moveTo(at(event.step), 15);
    ctx.lineTo(at(event.step) - 4, 21.5);
    ctx.lineTo(at(event.step) + 4, 21.5);
    ctx.fill();
  }
}
