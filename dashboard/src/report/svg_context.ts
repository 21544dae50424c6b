/** The few calls of a canvas that pairs are drawn with, written down as SVG. */
import { svg, tag, text } from "./chart_svg";
import type { Theme } from "../colour";

interface State {
  clip: string | undefined;
  transform: string;
}

export class SvgContext {
  fillStyle = "#000";
  strokeStyle = "#000";
  lineWidth = 1;
  font = "12px system-ui";
  textAlign = "start";
  private dash: number[] = [];
  private path = "";
  private content = "";
  private clips = 0;
  private state: State = { clip: undefined, transform: "" };
  private readonly saved: State[] = [];

  constructor(private readonly name: string) {}

  document(width: number, height: number, theme: Theme, title: string): string {
    return svg(width, height, theme, title, this.content);
  }
  clearRect(): void {
    this.content = "";
  }
  save(): void {
    this.saved.push({ ...this.state });
  }
  restore(): void {
    this.state = this.saved.pop() ?? this.state;
  }
  translate(x: number, y: number): void {
    this.state.transform += `translate(${x.toFixed(1)} ${y.toFixed(1)}) `;
  }
  rotate(angle: number): void {
    this.state.transform += `rotate(${((180 * angle) / Math.PI).toFixed(1)}) `;
  }
  setLineDash(dash: number[]): void {
    this.dash = dash;
  }
  beginPath(): void {
    this.path = "";
  }
  moveTo(x: number, y: number): void {
    this.path += `M${x.toFixed(1)} ${y.toFixed(1)}`;
  }
  lineTo(x: number, y: number): void {
    this.path += `${this.path ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`;
  }
  closePath(): void {
    this.path += "Z";
  }
  rect(x: number, y: number, w: number, h: number): void {
    this.path += `M${x.toFixed(1)} ${y.toFixed(1)}h${w.toFixed(1)}v${h.toFixed(1)}h${(-w).toFixed(1)}Z`;
  }
  /** A whole circle. */
  arc(x: number, y: number, r: number): void {
    this.path += `M${(x - r).toFixed(1)} ${y.toFixed(1)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`;
  }
  clip(): void {
    this.state.clip = `${this.name}${(this.clips += 1)}`;
    this.content += tag("clipPath", { id: this.state.clip }, tag("path", { d: this.path }));
  }
  stroke(): void {
    this.add(
      tag("path", {
        d: this.path,
        fill: "none",
        stroke: this.strokeStyle,
        "stroke-width": this.lineWidth,
        ...this.dashes(),
      }),
    );
  }
  fill(): void {
    this.add(tag("path", { d: this.path, fill: this.fillStyle }));
  }
  strokeRect(x: number, y: number, width: number, height: number): void {
    this.add(
      tag("rect", { x, y, width, height, fill: "none", stroke: this.strokeStyle, "stroke-width": this.lineWidth }),
    );
  }
  fillRect(x: number, y: number, width: number, height: number): void {
    this.add(tag("rect", { x, y, width, height, fill: this.fillStyle }));
  }
  fillText(words: string, x: number, y: number): void {
    const size = /(\d+)px/.exec(this.font)?.[1] ?? "12";
    const anchor = { center: "middle", right: "end" }[this.textAlign] ?? "start";
    this.add(
      text(x, y, words, this.fillStyle, {
        "font-size": size,
        "text-anchor": anchor,
        ...(/^600/.test(this.font) ? { "font-weight": 600 } : {}),
      }),
    );
  }
  private dashes(): Record<string, string> {
    return this.dash.length ? { "stroke-dasharray": this.dash.join(" ") } : {};
  }
  private add(element: string): void {
    const { clip, transform } = this.state;
    this.content +=
      clip || transform
        ? tag("g", { "clip-path": clip && `url(#${clip})`, transform: transform.trim() || undefined }, element)
        : element;
  }
}
