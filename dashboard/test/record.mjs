// A recording of `make demo-live`: pictures of the page while the simulated camera feeds the service.
// `npm run record` runs the demo itself (programs built: make build) and writes ../docs/images/live-*.png.
import { spawn } from "node:child_process";
import { mkdirSync, readFileSync, rmSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { launch } from "./browser.mjs";

const root = join(dirname(fileURLToPath(import.meta.url)), "../..");
const images = join(root, "docs/images");
mkdirSync(images, { recursive: true });
const steps = [12, 22, 28, 99];

const sleep = (ms) => new Promise((done) => setTimeout(done, ms));
const json = async (path) => {
  const answer = await fetch(new URL(path, url));
  return answer.ok ? answer.json() : undefined; // 404: no datum yet
};

rmSync(join(root, "out/live/url"), { force: true });
const demo = spawn("scripts/demo-live.sh", {
  cwd: root,
  env: { ...process.env, PORT: "0" },
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
for (const step of steps) {
  while (((await json("/v1/state"))?.step ?? -1) < step) await sleep(20);
  await page.screenshot({ path: join(images, `live-${step}.png`) });
}
await browser.close();
demo.kill("SIGTERM");
