// A recording of `make demo-live`: pictures of the page while the simulated camera feeds the service.
// `npm run record` runs the demo itself (programs built: make build) and writes ../docs/images/live-*.png, and all of it as one that moves,
// ../docs/images/live.png.
import { spawn } from "node:child_process";
import { mkdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { animation } from "./apng.mjs";
import { launch } from "./browser.mjs";

const root = join(dirname(fileURLToPath(import.meta.url)), "../..");
const images = join(root, "docs/images");
mkdirSync(images, { recursive: true });
const kept = [12, 22, 28, 99];
// Close together where the crack runs.
const steps = [2, 6, 12, 16, 18, 20, 22, 24, 26, 28, 30, 33, 37, 42, 50, 60, 70, 80, 90, 99];
const plays = 3; // then it rests on the last picture
const delay = (step) => (step === steps.at(-1) ? 5000 : 450);
const largest = 1.5e6; // bytes, of what moves

const sleep = (ms) => new Promise((done) => setTimeout(done, ms));
const json = async (path) => {
  const answer = await fetch(new URL(path, url));
  return answer.ok ? answer.json() : undefined; // 404: no datum yet
};

rmSync(join(root, "out/live/url"), { force: true });
const demo = spawn("scripts/demo-live.sh", {
  cwd: root,
  env: { ...process.env, PORT: "0", RATE: "1" }, // slow enough to be taken step by step
  stdio: ["ignore", "inherit", "inherit"],
});
let url = "";
while (url === "") {
  if (demo.exitCode !== null) throw new Error("the demo has ended: see above");
  await sleep(50);
  try {
    url = readFileSync(join(root, "out/live/url"), "utf8").trim();
  } catch {
    // not yet written
  }
}
const browser = await launch();
const page = await browser.newPage({ viewport: { width: 1280, height: 806 } });
await page.goto(url);
const shots = [];
for (const step of steps) {
  while (((await json("/v1/state"))?.step ?? -1) < step) await sleep(20);
  shots.push(await page.screenshot());
  if (kept.includes(step)) writeFileSync(join(images, `live-${step}.png`), shots.at(-1));
}
await browser.close();
demo.kill("SIGTERM");
const moving = animation(shots, steps.map(delay), plays);
if (moving.length > largest) throw new Error(`the animation has ${moving.length} bytes, more than ${largest}`);
writeFileSync(join(images, "live.png"), moving);
console.log(`docs/images/live.png: ${steps.length} pictures, ${moving.length} bytes`);
