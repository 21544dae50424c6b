// The pictures of docs/tutorials/gallery.md: `npm run gallery [NAME…]` runs examples as the first lines of their project files say, in out/gallery,
// and takes the first screen of their reports. Programs built: make build; a server in Python where an example has one.
import { spawn, spawnSync } from "node:child_process";
import { cpSync, existsSync, mkdirSync, readFileSync, rmSync } from "node:fs";
import { connect } from "node:net";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { launch } from "./browser.mjs";

const root = join(dirname(fileURLToPath(import.meta.url)), "../..");
const projects = {
  beam_five: "beam_five.toml",
  beam_pictures: "beam_pictures.toml",
  driven_test: "driven_test.toml",
  calculix: "bracket.toml",
  command: "storeys.toml",
  numpy: "tower.toml",
  dolfinx: "wall.toml",
};
/** What a service has computed is written by a command of its own. */
const further = { driven_test: ["knothe export driven_test.journal -o results"] };
const screen = { width: 1220, height: 700 };

/** "#   knothe offline    bracket.toml -o bracket.h5       half a minute": what stands behind it is no part of it. */
function commandsOf(project) {
  const lines = readFileSync(project, "utf8").split("\n");
  return lines.slice(0, lines.indexOf("")).flatMap((line) => {
    const [, program, rest] = /^# {3}(knothe(?: model)? \w+|python3) +(.*)$/.exec(line) ?? [];
    return program ? [`${program} ${rest.split(/ {2,}/)[0]}`] : [];
  });
}

/** Somebody listens. */
async function served(port) {
  for (let tries = 0; tries < 240; tries += 1) {
    const socket = connect(port, "127.0.0.1");
    const answers = await new Promise((done) =>
      socket.once("connect", () => done(true)).once("error", () => done(false)),
    );
    socket.destroy();
    if (answers) return;
    await new Promise((done) => setTimeout(done, 500));
  }
  throw new Error(`nobody listens at port ${port}`);
}

async function runExample(name) {
  const project = projects[name];
  const folder = join(root, "out/gallery", name);
  rmSync(folder, { recursive: true, force: true });
  mkdirSync(dirname(folder), { recursive: true });
  cpSync(join(root, "examples", name), folder, { recursive: true });
  cpSync(join(root, "examples/umbridge"), join(root, "out/gallery/umbridge"), { recursive: true });
  const env = {
    ...process.env,
    PATH: `${join(root, "build/release/bin")}:/usr/bin:${process.env.PATH}`,
    OMP_NUM_THREADS: "1",
  };
  const running = [];
  const stop = () => running.splice(0).forEach((one) => one.kill("SIGTERM"));
  for (const command of [
    ...commandsOf(join(folder, project)),
    ...(further[name] ?? []),
    "knothe report results -o report.html",
  ]) {
    console.log(`${name}: ${command}`);
    if (/^knothe (forecast|dic|model)/.test(command)) continue; // says what the report says
    if (/ &$|^knothe serve/.test(command)) {
      running.push(spawn("sh", ["-c", `exec ${command.replace(/ &$/, "")}`], { cwd: folder, env, stdio: "ignore" }));
      await served(/^knothe/.test(command) ? 8080 : 4242);
      continue;
    }
    if (/^knothe export/.test(command)) stop();
    const { status } = spawnSync("sh", ["-c", command], { cwd: folder, env, stdio: ["ignore", "ignore", "inherit"] });
    if (status !== 0) {
      stop();
      throw new Error(`${name}: ${command}: exit status ${status}`);
    }
  }
  stop();
  return join(folder, "report.html");
}

const names = process.argv.length > 2 ? process.argv.slice(2) : Object.keys(projects);
const browser = await launch();
for (const name of names) {
  const kept = join(root, "out/gallery", name, "report.html");
  const report = process.env.KEPT && existsSync(kept) ? kept : await runExample(name);
  const page = await browser.newPage({ viewport: screen, colorScheme: "light" });
  await page.goto(`file://${report}`);
  await page.waitForTimeout(3000); // all figures are drawn after two
  const { y, height } = await page.locator(".tables").first().boundingBox();
  const clip = { x: 0, y: 0, width: screen.width, height: Math.min(screen.height, Math.ceil(y + height) + 10) };
  await page.screenshot({ path: join(root, "docs/images", `example-${name}.png`), clip });
  await page.close();
  console.log(`docs/images/example-${name}.png`);
}
await browser.close();
