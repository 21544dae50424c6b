// The page that `knothe serve` embeds, on `knothe serve` itself: numbers, fields, kill -9 and restart.
// KNOTHE is the program, KNOTHE_PROJECT a project file beside its model and data, and data.csv the same data as text.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import { readFileSync, readdirSync, rmSync } from "node:fs";
import { dirname, join } from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { compareNumbers, eventually, launch, portToComeBackTo, text, until, watchedPage } from "./browser.mjs";

const { KNOTHE: program, KNOTHE_PROJECT: project } = process.env;
const here = dirname(fileURLToPath(import.meta.url));

async function serve(port) {
  const child = spawn(program, ["serve", project, "--port", String(port)], {
    cwd: dirname(project),
    stdio: ["ignore", "pipe", "pipe"],
  });
  let said = "";
  const url = await new Promise((resolve, reject) => {
    const hear = (chunk) => {
      said += chunk;
      const found = /http:\/\/127\.0\.0\.1:\d+\//.exec(said);
      if (found) resolve(found[0]);
    };
    child.stdout.on("data", hear);
    child.stderr.on("data", hear);
    child.once("exit", (status) => reject(new Error(`knothe serve ended with ${status}: ${said}`)));
  });
  const ready = () =>
    fetch(`${url}readyz`).then(
      (r) => r.ok,
      () => false,
    );
  await eventually(ready, (is) => is, 60000);
  return {
    child,
    url,
    stop: async (signal) => (
      child.kill(signal),
      child.exitCode === null && child.signalCode === null ? once(child, "exit") : undefined
    ),
  };
}

/** Rows of `knothe`'s CSV: one measurement per time. */
function measurements() {
  const [header, ...rows] = readFileSync(join(dirname(project), "data.csv"), "utf8")
    .trim()
    .split(/\r?\n/)
    .map((r) => r.split(","));
  const [time, value] = [header.indexOf("time"), header.indexOf("value")];
  const byTime = new Map();
  for (const row of rows) byTime.set(row[time], [...(byTime.get(row[time]) ?? []), Number(row[value])]);
  return [...byTime].map(([t, values], seq) => ({ source: "camera", session: "test", seq, time: Number(t), values }));
}

test("the page on the real service", async (t) => {
  const data = measurements();
  let service = await serve(await portToComeBackTo());
  const browser = await launch();
  t.after(async () => {
    await browser.close();
    await service.stop("SIGKILL");
  });
  const { page, complaints } = await watchedPage(browser, { viewport: { width: 1440, height: 900 } });
  const get = async (path) => (await fetch(service.url + path)).json();
  const post = async (datum) => {
    const answer = await fetch(`${service.url}v1/measurements`, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(datum),
    });
    assert.equal(answer.status, 200, await answer.text());
  };
  // The latest line is that of the last datum, and shown.
  const shown = async (step) => {
    await eventually(
      async () => (await get("v1/state")).step,
      (now) => now === step,
      60000,
    );
    await until(page, "#step", new RegExp(`^${step}\\b`));
    await compareNumbers(page, await get("v1/state"));
  };
  const embedded = await (await fetch(service.url)).text();
  assert.ok(
    embedded === readFileSync(join(here, "../dist/index.html"), "utf8"),
    "the program embeds the committed page",
  );
  await page.goto(service.url);
  await until(page, "#state", /WAITING/);
  await until(page, "#contact", /^connected/);

  for (const [k, datum] of data.slice(0, 20).entries())
    if (k !== 10 && k !== 11) await post(k === 15 ? { ...datum, values: datum.values.map(() => null) } : datum);
  await shown(19);
  await page.locator(".scrub input").fill("15");
  await until(page, "#parameters .legend", /median –/);
  await page.locator(".scrub input").fill("12");
  await until(page, ".scrub p", /Viewing step 12 /);
  await compareNumbers(page, (await get("v1/states?from=12"))[0]);
  await page.keyboard.press("l");

  await page.locator('#field select[aria-label="Field"]').selectOption("residual");
  await until(page, "#field h2", /step 19/);
  await until(page, "#field .readout", /60 used, 0 rejected, 0 missing/);
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.locator("#field").getByRole("button", { name: "save as CSV" }).click(),
  ]);
  const rows = readFileSync(await download.path(), "utf8")
    .trim()
    .split("\r\n")
    .slice(1)
    .map((r) => r.split(","));
  assert.deepEqual(
    rows.map((r) => Number(r[7])),
    (await get("v1/field?name=residual&step=19")).values,
  );
  const { parameters } = await get("v1/description");
  await page.locator('#field select[aria-label="Field"]').selectOption(`sensitivity:${parameters[1].name}`);
  await page.waitForFunction(() => !document.querySelector("#field .none"));

  const port = new URL(service.url).port;
  await service.stop("SIGKILL");
  await until(page, "#reason", /No contact with the service/);
  assert.match(await text(page, "#state"), /NO CONTACT/);
  service = await serve(port);
  await until(page, "#contact", /^connected/);
  for (const datum of data.slice(20, 30)) await post(datum);
  await shown(29);
  const [all] = await Promise.all([page.waitForEvent("download"), page.getByText("all steps as CSV").click()]);
  const [header, ...steps] = readFileSync(await all.path(), "utf8")
    .trim()
    .split("\r\n")
    .map((r) => r.split(","));
  const lines = await get("v1/states");
  assert.deepEqual(
    steps.map((r) => Number(r[0])),
    lines.map((line) => line.step),
  );
  assert.deepEqual(
    steps.map((r) => Number(r[header.indexOf("log_evidence")])),
    lines.map((line) => line.log_evidence),
  );

  // A sensor's signal is what was sent, over the stroke of the model.
  await until(page, "#signal h2", /over the loading/);
  const signal = await get("v1/signal?sensor=3");
  const sent = [...data.keys()].filter((k) => k < 30 && ![10, 11, 15].includes(k)).map((k) => data[k].values[3]);
  assert.equal(signal.measured.value.length, sent.length);
  signal.measured.value.forEach((v, i) => assert.ok(Math.abs(v - sent[i]) < 1e-12, `${v}: ${sent[i]}`));

  const wild = { ...data[29], source: "gauges", values: data[29].values.map((v, i) => (i === 3 ? 1 : v)) };
  await post(wild);
  await until(page, "#quarantined", /^1$/);
  await until(page, "#quarantine li", /gauges, test, 29 \(step 29\): sensor 3, .* is 1 m, beyond the limit/);
  const held = page.locator("#quarantine");
  await held.getByRole("button", { name: "withdraw" }).click();
  await held.getByLabel("Your name").fill("Ada");
  await held.getByRole("button", { name: "Withdraw", exact: true }).click();
  await held.getByRole("button", { name: "Yes: withdraw" }).click();
  await held.waitFor({ state: "detached" });
  await until(page, "#logbook", /Ada.*gauges, test, 29 withdrawn from quarantine/);

  // The next specimen's test, begun on the page: it begins anew, and the one before is set beside it.
  await page.getByRole("button", { name: "begin the next specimen's test" }).click();
  await page.getByLabel("Name of the next test").fill("second");
  await page.locator("#tests").getByLabel("Your name").fill("Ada");
  await page.getByRole("button", { name: "Begin the next test" }).click();
  await page.getByRole("button", { name: "Yes: begin the next test" }).click();
  await until(page, "#test", /^second$/);
  await until(page, "#tests", /Unnamed test: 29 data, finished/);
  for (const datum of data.slice(0, 5)) await post(datum);
  await shown(4);
  await page.getByRole("button", { name: "compare" }).click();
  await until(page, "#comparison", /second: median [\d.]+[^]*unnamed test: median [\d.]+/);
  assert.equal((await get("v1/states?test=")).length, lines.length);

  // Another specimen under the page that was left open: nothing of the one before stays.
  await service.stop("SIGINT");
  const folder = dirname(project);
  for (const name of readdirSync(folder).filter((name) => name.includes(".journal")))
    rmSync(join(folder, name), { recursive: true });
  service = await serve(port);
  await until(page, "#contact", /^connected/);
  for (const datum of data.slice(0, 3)) await post(datum);
  await shown(2);
  const [fresh] = await Promise.all([page.waitForEvent("download"), page.getByText("all steps as CSV").click()]);
  assert.equal(
    readFileSync(await fresh.path(), "utf8")
      .trim()
      .split("\r\n").length,
    1 + 3,
  );
  assert.equal(await page.locator("#quarantine").count(), 0);
  assert.deepEqual(complaints, []);
});
