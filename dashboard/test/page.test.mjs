// The built page in headless Chromium, on the mock service.
// Pictures are left in out/pictures.
import assert from "node:assert/strict";
import { mkdirSync, readFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import {
  axeFaults,
  compareNumbers,
  eventually,
  launch,
  number,
  portToComeBackTo,
  text,
  until,
  watchedPage,
} from "./browser.mjs";
import { MockService, Recording, verdict } from "../mock/server.mjs";

const here = dirname(fileURLToPath(import.meta.url));
const pictures = join(here, "../out/pictures");
mkdirSync(pictures, { recursive: true });
const desktop = { viewport: { width: 1440, height: 900 }, colorScheme: "light" };
const phone = {
  viewport: { width: 390, height: 844 },
  deviceScaleFactor: 1.5,
  isMobile: true,
  hasTouch: true,
  colorScheme: "light",
};
let browser;

before(async () => {
  browser = await launch();
});
after(() => browser?.close());

/** A page on a mock; whatever it complains about, and wherever else it goes, fails the test. */
async function open(t, options = {}, look = desktop, path = "") {
  const service = await new MockService(new Recording().scenario(), {
    rate: 0,
    start: 70,
    period: 600,
    ...options,
  }).listen(options.port ?? 0);
  const { page, context, complaints } = await watchedPage(browser, look);
  t.after(async () => {
    await context.close();
    await service.close().catch(() => {});
    assert.deepEqual(complaints, []);
  });
  await page.goto(service.url + path);
  return { page, service, context };
}

/** What is wider than the element that clips it, but for words that are for screen readers alone. */
const clipped = (page) =>
  page.evaluate(() =>
    [document.documentElement, ...document.querySelectorAll("body *:not(.hidden)")]
      .filter((e) => e === document.documentElement || getComputedStyle(e).overflowX !== "visible")
      .filter((e) => e.clientWidth > 0 && e.scrollWidth > e.clientWidth)
      .map((e) => `${e.tagName} ${e.id} ${e.className}: ${e.scrollWidth} in ${e.clientWidth} px`),
  );

test("shows the numbers that the service returns, now and back in time", async (t) => {
  const { page, service } = await open(t);
  await page.locator("[data-parameter]").first().waitFor();
  const api = async () => await (await fetch(`${service.url}v1/state`)).json();
  const line = await api();
  await until(page, "#step", new RegExp(`^${line.step}\\b`));
  await compareNumbers(page, line);
  assert.match(await text(page, "#state"), /^✓\s+OK$/);
  service.advance();
  const next = await api();
  await until(page, "#step", new RegExp(`^${next.step}\\b`));
  await compareNumbers(page, next);
  // Back in time by keys: two steps and ten steps; the banner stays with the present.
  await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("Shift+ArrowLeft");
  const past = service.known.at(-13);
  await until(page, ".scrub p", new RegExp(`Viewing step ${past.step} `));
  await compareNumbers(page, past);
  assert.match(await text(page, "#step"), new RegExp(`^${next.step}\\b`));
  await page.keyboard.press("Home");
  await until(page, ".scrub p", /Viewing step 0 /);
  await compareNumbers(page, service.known[0]);
  await page.keyboard.press("l");
  await until(page, ".scrub p", /the latest/);
});

test("where there were no data the plots have gaps, and the legend no number", async (t) => {
  const { page, service } = await open(t);
  await until(page, "#parameters .legend", /median \d/);
  const empty = service.known.find((line) => line.used === 0);
  await page.locator(".scrub input").fill(String(empty.step));
  await until(page, "#parameters .legend", /median –/);
  await until(page, "#evidence .chart + .chart .legend", /missing 60.*used 0/);
  await until(page, ".events", /No usable value from any sensor/);
});

test("survives a restart of the service: says that it lost it, comes back with Last-Event-ID, and has missed nothing", async (t) => {
  const { page, service, context } = await open(t, { start: 40, port: await portToComeBackTo() });
  await until(page, "#state", /OK/);
  service.advance();
  await until(page, "#step", new RegExp(`^${service.known.at(-1).step}\\b`));
  const { port, recording, count } = service;
  await service.close();
  await until(page, "#contact", /no contact/);
  await until(page, "#state", /^\S+\s+NO CONTACT$/);
  await until(page, "#reason", /No contact with the service for [\d.]+ s; shown is what was known then/);
  const again = await new MockService(recording, { rate: 0, start: count + 7, period: 600 }).listen(port);
  t.after(() => again.close());
  await until(page, "#state", /OK/);
  await until(page, "#step", new RegExp(`^${again.known.at(-1).step}\\b`));
  const resumed = again.requests.find((r) => r.path === "/v1/events");
  assert.equal(resumed.lastEventId, String(4294967296 + count));
  again.advance();
  await until(page, "#step", new RegExp(`^${again.known.at(-1).step}\\b`));
  const [download] = await Promise.all([page.waitForEvent("download"), page.getByText("all steps as CSV").click()]);
  const rows = readFileSync(await download.path(), "utf8")
    .trim()
    .split("\r\n")
    .slice(1);
  assert.deepEqual(
    rows.map((r) => Number(r.split(",")[0])),
    again.known.map((line) => line.step),
  );
  await context.close();
});

test("the state is said in words, with its cause; silence says which it is, and covers nothing worse", async (t) => {
  const { page, service } = await open(t);
  for (const [state, cause] of [
    ["DEGRADED", "updates are 3 data behind"],
    ["BIASED", "χ² 212 of 60 residuals"],
    ["DIVERGED", "no map could be verified"],
  ]) {
    service.lastAt = Date.now();
    service.say(state, cause);
    await until(page, "#state", new RegExp(state));
    await until(page, "#reason", new RegExp(cause.slice(1)));
    await page.waitForFunction((word) => document.title.startsWith(word), state);
  }
  service.period = 0.5; // not before: the page would say NO DATA, too, if it were slow
  service.say("BIASED", "χ² 212 of 60 residuals");
  await until(page, "#state", /BIASED\s+\S+\s+NO DATA$/);
  await until(page, "#reason", /212 of 60 residuals\. No datum for /);
  await page.screenshot({ path: join(pictures, "biased-no-data.png") });
  service.say("OK", "");
  await until(page, "#state", /^\S+\s+NO DATA$/);
  await until(page, "#reason", /No datum for .* s \(one is expected every 0\.5 s\)/);
  const age = number(await text(page, "#age")).value;
  assert.ok(age >= 2.5 && age < 60, `age ${age}`);
  service.period = 600;
  service.advance();
  await until(page, "#state", /OK/);
  service.raise({
    step: service.known.at(-1).step,
    severity: "alarm",
    kind: "bias",
    message: "the last datum does not fit",
  });
  await until(page, ".events", /The last datum does not fit/);
  await until(page, ".events", /The service became DIVERGED: no map could be verified/);
});

test("the structure has a state of its own, with its first reason; a withdrawn step is forgotten", async (t) => {
  const { page, service } = await open(t, { start: 50 });
  await until(page, "#structure", /Result: usable$/);
  const message = "the data do not fit the model: component y has the wrong sign";
  service.recording.lines[service.count].verdict = verdict("reject", "fit", message);
  service.advance();
  await until(page, "#structure", /Result: do not use/);
  await until(page, "#verdict", /^The data do not fit the model: component y has the wrong sign\.$/);
  await until(page, "#state", /OK/);
  await until(page, ".events", /component y has the wrong sign/);
  // The largest and only coloured word is that of the result.
  const look = await page.evaluate(() =>
    ["#state .word", "#structure"].map((selector) => {
      const style = getComputedStyle(document.querySelector(selector));
      return { size: parseFloat(style.fontSize), colour: style.backgroundColor };
    }),
  );
  assert.ok(look[0].size < look[1].size, JSON.stringify(look));
  assert.equal(look[0].colour, "rgb(255, 255, 255)");
  assert.deepEqual(await axeFaults(page), []);
  // No number looks as if it could be used: two digits, struck out, nothing blue.
  const shown = await page.evaluate(() => {
    const all = (selector) => [...document.querySelectorAll(`.summary.rejected ${selector}`)];
    const struck = [".value", ".interval", ".failure b", ".failure small"].flatMap(all);
    return {
      label: document.querySelector(".summary").getAttribute("aria-label"),
      struck: struck.map((e) => getComputedStyle(e).textDecorationLine),
      values: all(".value").map((e) => e.firstChild.textContent.trim()),
      bars: all(".box rect:nth-child(2)").map((e) => e.getAttribute("fill")),
      meters: all(".p").map((e) => getComputedStyle(e).filter),
    };
  });
  assert.match(shown.label, /not usable$/);
  assert.ok(shown.struck.length > 5 && shown.struck.every((line) => line === "line-through"), String(shown.struck));
  const legend = page.locator("#parameters .legend b").first();
  assert.equal(await legend.evaluate((b) => getComputedStyle(b).textDecorationLine), "line-through");
  for (const value of shown.values) assert.ok(value.replace(/[^\d]/g, "").replace(/^0+/, "").length <= 3, value);
  assert.deepEqual(new Set(shown.bars), new Set(["#5b6776"]));
  assert.ok(shown.meters.every((filter) => filter === "grayscale(1)"));
  const { step } = service.known.at(-1);
  service.withdraw();
  await until(page, "#step", new RegExp(`^${service.known.at(-1).step}\\b`));
  assert.notEqual(step, service.known.at(-1).step);
  await until(page, "#structure", /Result: usable$/);
});

test("another configuration behind the same address: what was there is forgotten", async (t) => {
  const { page, service, context } = await open(t, { start: 50, port: await portToComeBackTo() });
  await until(page, "#step", /\d/);
  const { port } = service;
  await service.close();
  const other = new Recording();
  other.description = () => ({ ...Recording.prototype.description.call(other), run: "other" });
  const again = await new MockService(other, { rate: 0, start: 3, period: 600 }).listen(port);
  t.after(() => again.close());
  await until(page, "#step", /^2\b/);
  await page.waitForFunction(() => document.querySelector(".scrub input").max === "2");
  await context.close();
});

test("another configuration that appears after the first questions is noticed", async (t) => {
  const recording = new Recording();
  let asked = 0;
  recording.description = () => {
    asked += 1;
    const description = Recording.prototype.description.call(recording);
    return asked === 1 ? description : { ...description, run: "other", site: "bridge" };
  };
  const service = await new MockService(recording, { rate: 0, start: 5, period: 600 }).listen();
  const { page, context, complaints } = await watchedPage(browser, desktop);
  t.after(() => Promise.all([context.close(), service.close()]));
  await page.goto(service.url);
  await until(page, "h1", /bridge/);
  await until(page, "#step", /^4\b/);
  assert.deepEqual(complaints, []);
});

test("several structures: the chosen one is asked for, and nothing of the other stays", async (t) => {
  const { page, service } = await open(t, {
    start: 20,
    answer(request, response) {
      const bridge = new URL(request.url, "http://localhost").searchParams.get("site") === "bridge";
      this.recording.description = () => ({
        ...Recording.prototype.description.call(this.recording),
        sites: ["beam", "bridge"],
        ...(bridge ? { site: "bridge", run: "b" } : {}),
      });
      this.count = bridge ? 4 : 20;
      return MockService.prototype.answer.call(this, request, response);
    },
  });
  await until(page, "#step", /^19\b/);
  await page.getByLabel("Structure", { exact: true }).selectOption("bridge");
  await until(page, "h1", /bridge/);
  await until(page, "#step", /^3\b/);
  assert.match(page.url(), /site=bridge/);
  await eventually(
    () => service.requests.some((r) => r.path === "/v1/events" && r.site === "bridge"), // after what is shown already
    (asked) => asked,
  );
});

test("before the first datum it says so; a model without mesh, and a service that has only lines, are said in words", async (t) => {
  const { page, service } = await open(t, { start: 0 });
  await until(page, "#reason", /^No datum yet/);
  assert.match(await text(page, "#state"), /WAITING/);
  service.advance();
  await until(page, "#state", /OK/);
  const bare = await open(t, {
    start: 5,
    answer(request, response) {
      if (/v1\/(description|mesh|status|alarms|field|observations|samples)/.test(request.url))
        return response
          .writeHead(404, { "Content-Type": "application/json" })
          .end('{"error":{"type":"NoRoute","message":"not here"}}');
      return MockService.prototype.answer.call(this, request, response);
    },
  });
  t.after(() => bare.context.close());
  await until(bare.page, "#state", /OK/);
  await until(bare.page, "#field", /has no mesh/);
  await until(bare.page, ".summary", /p0.*p1/);
});

test("a token is asked for once, sent with everything, and taken from the address", async (t) => {
  const { page, service, context } = await open(t, { token: "s3cret" });
  await page.getByRole("textbox", { name: "Token" }).fill("wrong");
  await page.keyboard.press("Enter");
  await page.getByText("does not know this token").waitFor();
  await page.getByRole("textbox", { name: "Token" }).fill("s3cret");
  await page.keyboard.press("Enter");
  await until(page, "#state", /OK/);
  const direct = await context.newPage();
  await direct.goto(`${service.url}#token=s3cret`);
  await until(direct, "#state", /OK/);
  assert.ok(!direct.url().includes("s3cret"), "the token does not stay in the address");
});

test("the picture that was measured lies behind the structure, in its place, and can be taken away", async (t) => {
  const { page, service } = await open(t, { picture: true });
  await until(page, "#field .readout", /57 used/);
  /** Grey level of the picture under a point of the frame; nothing where there is none. */
  const grey = (x, y) =>
    page.evaluate(
      ([x, y]) => {
        const ground = document.querySelector("#field .ground");
        const copy = Object.assign(document.createElement("canvas"), { width: 1, height: 1 });
        const ctx = copy.getContext("2d", { willReadFrequently: true });
        ctx.drawImage(ground, -Math.round(x * ground.width), -Math.round(y * ground.height));
        const [level, , , opacity] = ctx.getImageData(0, 0, 1, 1).data;
        return opacity ? level : undefined;
      },
      [x, y],
    );
  await page.waitForFunction(() => getComputedStyle(document.querySelector("#field canvas")).opacity === "0.55");
  const [, middle] = await eventually(
    async () => [await grey(0.3, 0.42), await grey(0.5, 0.42), await grey(0.7, 0.42)],
    ([left, middle, right]) => left < middle && middle < right, // not mirrored
  );
  assert.ok(Math.abs(middle - 100) < 6, String(middle)); // the middle of the structure is the middle of the picture
  await page.locator("#field").screenshot({ path: join(pictures, "field-picture.png") });
  await page.locator("#field").getByLabel("picture").uncheck();
  await page.waitForFunction(() => getComputedStyle(document.querySelector("#field canvas")).opacity === "1");
  await eventually(
    () => grey(0.5, 0.42),
    (level) => level === undefined,
  );
  assert.ok(service.requests.some((r) => r.path === "/v1/picture"));
});

test("a laptop's first screen: state, result, numbers; structure, measured signal and forecast", async (t) => {
  const { page } = await open(t, {}, { ...desktop, viewport: { width: 1366, height: 768 } });
  await until(page, "#field .readout", /57 used, 2 rejected, 1 missing/);
  const box = (place) => page.locator(place).first().boundingBox();
  for (const place of ["#state", "#structure", "[data-forecast]", "[data-parameter]"]) {
    const { y, height } = await box(place);
    assert.ok(y + height <= 768, `${place} ends at ${y + height}`);
  }
  // Most of what is drawn.
  for (const place of ["#field .field", "#signal canvas", "#forecast canvas"]) {
    const { y } = await box(place);
    assert.ok(y <= 768 - 200, `${place} begins at ${y}`);
  }
});

test("the field is drawn, its numbers are the service's, each panel gives PNG and CSV", async (t) => {
  const { page, service } = await open(t);
  await until(page, "#field .readout", /57 used, 2 rejected, 1 missing/);
  const colours = async () =>
    page.evaluate(async () => {
      await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
      const gl = document.querySelector("#field canvas");
      const copy = document.createElement("canvas");
      [copy.width, copy.height] = [gl.width, gl.height];
      const ctx = copy.getContext("2d");
      ctx.drawImage(gl, 0, 0);
      const { data } = ctx.getImageData(0, 0, copy.width, copy.height);
      const seen = new Set();
      let drawn = 0;
      for (let i = 0; i < data.length; i += 4)
        if (data[i + 3]) ((drawn += 1), seen.add((data[i] >> 4) * 256 + (data[i + 1] >> 4) * 16 + (data[i + 2] >> 4)));
      return { colours: seen.size, share: drawn / (data.length / 4) };
    });
  await eventually(colours, (drawn) => drawn.colours > 30 && drawn.share > 0.05);
  // Under the pointer: a value where the structure is, a sensor where one is; dragging turns it.
  await page.locator("#field .under").scrollIntoViewIfNeeded();
  const frame = await page.locator("#field .field").boundingBox();
  await page.mouse.move(frame.x + 0.25 * frame.width, frame.y + 0.46 * frame.height);
  await until(page, "#field .readout", /\|displacement\|: [\d.]+ µm at \(/);
  const picture = () => page.evaluate(() => document.querySelector("#field canvas").toDataURL());
  const before = await picture();
  await page.mouse.down();
  await page.mouse.move(frame.x + 0.35 * frame.width, frame.y + 0.5 * frame.height, { steps: 3 });
  await page.mouse.up();
  await page.waitForFunction((old) => document.querySelector("#field canvas").toDataURL() !== old, before);
  await page.locator("#field").getByRole("button", { name: "front" }).click();
  await page.waitForFunction((old) => document.querySelector("#field canvas").toDataURL() === old, before);
  for (const [key, label] of [
    ["sensitivity:Y0", "∂u/∂Y0"],
    ["residual", "residual"],
    ["bias", "model bias"],
  ]) {
    await page.keyboard.press("f");
    if (key === "residual") await page.keyboard.press("f");
    await page.waitForFunction(
      (value) => document.querySelector('#field select[aria-label="Field"]').value === value,
      key,
      label,
    );
  }
  await until(page, "#field .none", /No correction of the model's bias/);
  await page.locator('#field select[aria-label="Field"]').selectOption("residual");
  await page.waitForFunction(() => !document.querySelector("#field .none"));
  const save = async (panel, kind) => {
    const [download] = await Promise.all([
      page.waitForEvent("download"),
      page
        .locator(`#${panel}`)
        .getByRole("button", { name: `save as ${kind}` })
        .click(),
    ]);
    return readFileSync(await download.path());
  };
  const step = service.known.at(-1).step;
  const residual = await (await fetch(`${service.url}v1/field?name=residual&step=${step}`)).json();
  const rows = (await save("field", "CSV"))
    .toString()
    .trim()
    .split("\r\n")
    .slice(1)
    .map((r) => r.split(","));
  assert.deepEqual(
    rows.map((r) => r[7]),
    residual.values.map((v, k) => (residual.missing.includes(k) ? "" : String(v))),
  );
  const parameters = (await save("parameters", "CSV")).toString().trim().split("\r\n");
  assert.equal(Number(parameters.at(-1).split(",").at(-1)), service.known.at(-1).quantiles.values[1][2]);
  assert.ok(
    parameters.some((r) => /^[\d.]+,,,/.test(r)),
    "gaps are empty",
  );
  for (const panel of ["forecast", "parameters", "field", "pairs", "evidence", "timing"]) {
    const png = await save(panel, "PNG");
    assert.deepEqual([...png.subarray(1, 4)], [...Buffer.from("PNG")], panel);
    assert.ok(png.length > 5000, `${panel}: ${png.length} bytes`);
  }
});

test("keys: help, play, panels, forecasts, colours", async (t) => {
  const { page } = await open(t, { start: 30 });
  await until(page, "#state", /OK/);
  await page.keyboard.press("?");
  await page.getByText("How to read this page").waitFor();
  assert.deepEqual(await axeFaults(page), []);
  await page.keyboard.press("Escape");
  await page.getByText("How to read this page").waitFor({ state: "hidden" });
  await page.waitForFunction(() => document.activeElement === document.body);
  await page.keyboard.press("3");
  await page.waitForFunction(() => document.activeElement.id === "field");
  await page.keyboard.press("q");
  await until(page, "#forecast h2", /crack length at t = 1/);
  await page.keyboard.press("t");
  await page.keyboard.press("t");
  await page.waitForFunction(() => document.documentElement.dataset.colours === "dark");
  await page.keyboard.press("?");
  await page.getByRole("button", { name: "Close" }).click();
  await page.getByText("How to read this page").waitFor({ state: "hidden" });
  await page.waitForFunction(
    () => document.activeElement === document.body || document.activeElement.tagName === "SECTION",
  );
  // A busy machine may draw no frame in the seconds that it plays: all that was written is kept.
  await page.evaluate(() => {
    window.written = [];
    const look = () => window.written.push(document.querySelector(".scrub p")?.innerText ?? "");
    new MutationObserver(look).observe(document.body, { subtree: true, childList: true, characterData: true });
  });
  await page.keyboard.press(" ");
  await page.waitForFunction(() => window.written.some((line) => /Viewing step [1-9]/.test(line)));
  await page.keyboard.press(" ");
});

for (const [name, look] of [
  ["light", desktop],
  ["dark", { ...desktop, colorScheme: "dark" }],
  ["phone", phone],
])
  test(`picture: ${name}; nothing is wider than the screen, buttons have names`, async (t) => {
    const { page, service } = await open(t, { start: 80 }, look);
    await until(page, "#field .readout", /Sensors/);
    await until(page, "#state", /OK/);
    assert.deepEqual(await clipped(page), []);
    const nameless = await page.evaluate(() =>
      [...document.querySelectorAll("button, select, input")]
        .filter((e) => !(e.ariaLabel || e.textContent?.trim() || e.closest("label")))
        .map((e) => e.outerHTML),
    );
    assert.deepEqual(nameless, []);
    assert.deepEqual(await axeFaults(page), []);
    service.lastAt = Date.now();
    service.say("OK", "");
    await page.waitForTimeout(300);
    await page.screenshot({ path: join(pictures, `${name}.png`), fullPage: true });
  });

test("an alarm is acknowledged, and a note written at the step that is looked at", async (t) => {
  const { page, service } = await open(t);
  await page.locator("[data-parameter]").first().waitFor();
  service.raise({ step: 40, severity: "alarm", kind: "sensors", message: "a grip has slipped", raised_at: 1.795e9 });
  await until(page, "#events", /1 not acknowledged/);
  await page.locator("#events .answer").click();
  await page.getByLabel("Your name").first().fill("Ada");
  await page.getByLabel("comment").fill("seen");
  await page.getByRole("button", { name: "Acknowledge", exact: true }).click();
  await until(page, "#events", /acknowledged by Ada.*: seen/);
  assert.doesNotMatch(await text(page, "#events"), /not acknowledged/);
  assert.equal(service.alarms[0].acknowledged.by, "Ada");
  await page.getByRole("button", { name: /A grip has slipped/ }).dispatchEvent("click");
  assert.equal(await page.locator("#logbook").getByLabel("Your name").inputValue(), "Ada");
  await page.getByLabel("note at step 40").fill("a crack is heard");
  await page.getByRole("button", { name: "Write" }).click();
  await until(page, "#logbook", /Ada.*a crack is heard/);
  assert.deepEqual(
    [service.logbook[1].time, service.logbook[1].text],
    [service.known.find((line) => line.step === 40).time, "a crack is heard"],
  );
  // It is marked in the plots, and its words are in the legend of its time.
  await until(page, "#parameters .legend", /✎ Ada: a crack is heard/);
  await page.locator(".scrub input").fill("44");
  await page.waitForFunction(() => !/✎/.test(document.querySelector("#parameters .legend").textContent));
  // A sensor is switched off from the step that is looked at, then on again as if it had never been off.
  await page.getByRole("button", { name: "switch a sensor off" }).click();
  await page.locator("#logbook").getByLabel("Sensor", { exact: true }).fill("12");
  await page.locator("#logbook").getByLabel("why").fill("came loose");
  await page.screenshot({ path: join(pictures, "sensor-form.png"), fullPage: true });
  assert.deepEqual(await axeFaults(page), []);
  await page.getByRole("button", { name: "Switch off", exact: true }).click();
  await until(page, "#switched-off", /^sensor 12$/);
  await until(page, "#logbook", /sensor 12 switched off from t = .* on: came loose/);
  await until(page, "#parameters .legend", /✎ Ada: sensor 12 off: came loose/);
  await page.keyboard.press("l");
  await page.screenshot({ path: join(pictures, "logbook.png"), fullPage: true });
  await page.getByRole("button", { name: "switch it on" }).click();
  await page.getByRole("button", { name: "Switch on", exact: true }).click();
  await page.waitForFunction(() => !document.querySelector("#switched-off"));
  assert.deepEqual(
    service.logbook.slice(2).map((e) => [e.kind, e.sensor, e.time]),
    [
      ["sensor_off", 12, service.known.find((line) => line.step === 44).time],
      ["sensor_on", 12, service.known[0].time],
    ],
  );
});

test("alarms of one kind are one entry, acknowledged together, and read out", async (t) => {
  const { page, service } = await open(t);
  await page.locator("[data-parameter]").first().waitFor();
  const alarm = { severity: "alarm", kind: "sensors" };
  service.raise({ ...alarm, step: 40, message: "sensor 3 is 1 m, beyond the limit of 39 mm" });
  service.raise({ ...alarm, step: 41, message: "sensor 3 is 1.2 m, beyond the limit of 39 mm" });
  service.raise({ ...alarm, step: 42, message: "a grip has slipped" });
  await until(page, "#events", /3 not acknowledged/);
  assert.equal(await page.locator("#announced").getAttribute("aria-live"), "assertive");
  await until(page, "#announced", /^alarm at step 42: A grip has slipped$/);
  const group = page.locator("#events .events > li").filter({ hasText: "beyond the limit" });
  assert.equal(await group.count(), 1);
  assert.match(await group.innerText(), /step 41.*sensor 3 is 1\.2\sm.*1 earlier one/is);
  await group.getByRole("button", { name: "acknowledge all 2" }).click();
  await group.getByLabel("Your name").fill("Ada");
  await group.getByRole("button", { name: "Acknowledge all 2" }).click();
  await until(page, "#events", /1 not acknowledged/);
  assert.deepEqual(
    service.alarms.map((a) => a.acknowledged?.by),
    ["Ada", "Ada", undefined],
  );
});

test("data in quarantine are released or withdrawn, after a question", async (t) => {
  const { page, service } = await open(t);
  const held = (seq) => ({ source: "camera", session: "s", seq, step: 40, reason: "sensor 3 is 1 m" });
  service.held = [held(7), held(8)];
  service.say("OK", "");
  await until(page, "#quarantine", /2 data are stored.*camera, s, 8.*camera, s, 7/);
  const decide = async (seq, action) => {
    const entry = page.locator("#quarantine li").filter({ hasText: `camera, s, ${seq}` });
    await entry.getByRole("button", { name: action.toLowerCase() }).click();
    await entry.getByLabel("Your name").fill("Ada");
    await entry.getByLabel("why").fill("checked");
    await entry.getByRole("button", { name: action, exact: true }).click();
    await entry.getByRole("button", { name: `Yes: ${action.toLowerCase()}` }).click();
  };
  await decide(8, "Release");
  await until(page, "#quarantine", /1 datum is stored/);
  await page.locator("#quarantine").screenshot({ path: join(pictures, "quarantine.png") });
  assert.deepEqual(await axeFaults(page), []);
  await decide(7, "Withdraw");
  await page.waitForFunction(() => !document.querySelector("#quarantine"));
  assert.ok(service.requests.some((r) => r.path === "/v1/quarantine" && r.method === "POST"));
  assert.ok(service.requests.some((r) => r.path === "/v1/withdraw"));
  await until(page, "#logbook", /Ada.*camera, s, 8 released from quarantine: checked/);
  await until(page, "#logbook", /Ada.*camera, s, 7 withdrawn from quarantine: checked/);
});

test("a sensor's signal beside its prediction, over the loading; another is chosen", async (t) => {
  const { page, service } = await open(t);
  await until(page, "#signal h2", /Measured and predicted, over the loading/);
  await until(page, "#signal .legend", /posterior mean.*forecast.*measured/);
  const save = page.locator("#signal").getByRole("button", { name: "save as CSV" });
  const [download] = await Promise.all([page.waitForEvent("download"), save.click()]);
  const [header, ...rows] = readFileSync(await download.path(), "utf8")
    .trim()
    .split("\r\n");
  assert.match(header, /^imposed displacement \[mm\],/);
  assert.equal(rows.length, service.recording.steps);
  await page.locator("#signal select").selectOption("5");
  const name = `u_${"xyz"[service.recording.sensors[5].component]} of sensor 5`;
  await page.locator(`#signal [aria-label^="${name} [µm] over imposed displacement"]`).waitFor();
});

test("the next specimen's test is begun, after a question, and the page begins anew", async (t) => {
  const { page, service } = await open(t, { start: 60 });
  await page.locator("[data-parameter]").first().waitFor();
  await until(page, "#tests", /Unnamed test: running/);
  await page.getByRole("button", { name: "begin the next specimen's test" }).click();
  await page.getByLabel("Name of the next test").fill("b 2");
  await page.locator("#tests").getByLabel("Your name").fill("Ada");
  await page.getByRole("button", { name: "Begin the next test" }).click();
  assert.equal(await page.locator(".confirm").count(), 0, "a name with a blank is refused by the form");
  await page.getByLabel("Name of the next test").fill("b-2");
  await page.getByRole("button", { name: "Begin the next test" }).click();
  await until(page, ".confirm", /Is the next specimen in place\? The unnamed test is finished, .*test "b-2"/);
  await page.screenshot({ path: join(pictures, "next-test.png"), fullPage: true });
  assert.deepEqual(await axeFaults(page), []);
  await page.getByRole("button", { name: "No", exact: true }).click();
  assert.equal(service.test, "");
  await page.getByRole("button", { name: "Begin the next test" }).click();
  await page.getByRole("button", { name: "Yes: begin the next test" }).click();
  await until(page, "#test", /^b-2$/);
  await until(page, "#step", /^–/);
  await until(page, "#tests", /Unnamed test: 60 data, finished.*b-2: begun .*running/);
  await until(page, "#logbook", /Ada.* began this test/);
  service.advance();
  await until(page, "#step", /^0\b/);
  for (let k = 0; k < 40; k += 1) service.advance();
  await page.getByRole("button", { name: "compare" }).click();
  await until(page, "#comparison h2", /Comparison with the unnamed test/);
  await until(page, "#comparison", /b-2: median [\d.]+[^]*unnamed test: median [\d.]+/);
  assert.equal(await page.locator("#comparison .chart").count(), 5, "two parameters, three forecasts");
  await until(page, "#comparison .numbers", /Y0 \[J\/m³\]\s+[\d.]+ ± [\d.]+\s+[\d.]+ ± [\d.]+\s+.*σ\)\s+[\d.]+ %/);
  assert.equal(await page.locator("#comparison .numbers tbody tr").count(), 5);
  await page.waitForTimeout(500);
  await page.locator("#comparison").screenshot({ path: join(pictures, "comparison.png") });
  assert.deepEqual(await axeFaults(page), []);
  await page.setViewportSize({ width: 390, height: 844 });
  await page.waitForTimeout(500);
  assert.deepEqual(await clipped(page), []);
  await page.locator("#comparison").screenshot({ path: join(pictures, "comparison-phone.png") });
  await page.setViewportSize({ width: 1440, height: 900 });
  await page.locator("#comparison").getByRole("button", { name: "close" }).click();
  await page.waitForFunction(() => !document.querySelector("#comparison"));
  await page.getByRole("button", { name: "go back to it" }).click();
  await page.getByRole("button", { name: "Go back", exact: true }).click();
  await until(page, ".confirm", /Test "b-2" is left/);
  await page.getByRole("button", { name: "Yes: go back" }).click();
  await page.waitForFunction(() => !document.querySelector("#test"));
  await page.screenshot({ path: join(pictures, "gone-back.png"), fullPage: true });
});

test("on a phone, alarms come right below the banner", async (t) => {
  const { page, service } = await open(t, {}, phone);
  await page.locator("[data-parameter]").first().waitFor();
  service.raise({ step: 40, severity: "alarm", kind: "sensors", message: "a grip has slipped" });
  await until(page, "#events", /A grip has slipped/);
  const top = async (name) => (await page.locator(name).boundingBox()).y;
  assert.ok((await top(".banner")) < (await top("#events")));
  assert.ok((await top("#events")) < (await top(".scrub")));
  assert.ok((await top(".scrub")) < (await top("#forecast")));
  await page.screenshot({ path: join(pictures, "phone-alarms.png") });
});
