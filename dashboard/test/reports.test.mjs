// Reports as the program writes them (KNOTHE_REPORTS: their paths, colon between), in headless Chromium: nothing is asked for outside, no
// complaint, every figure is drawn, explored and saved; without JavaScript; on a phone; on paper. Screenshots are in out/.
import assert from "node:assert/strict";
import { mkdirSync, readFileSync } from "node:fs";
import { basename, dirname, join } from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { axeFaults, launch } from "./browser.mjs";

const out = join(dirname(dirname(fileURLToPath(import.meta.url))), "out");
mkdirSync(out, { recursive: true });
const reports = (process.env.KNOTHE_REPORTS ?? "").split(":").filter(Boolean);
assert.ok(reports.length > 0, "KNOTHE_REPORTS names no report");
const screen = { width: 1366, height: 768 };
const browser = await launch();
test.after(() => browser.close());

/** The report in a window of its own; what it complained of, and asked for. */
async function open(report, look = {}) {
  const context = await browser.newContext({ viewport: screen, acceptDownloads: true, ...look });
  const page = await context.newPage();
  page.setDefaultTimeout(120000); // on a busy machine
  const complaints = [];
  page.on("pageerror", (error) => complaints.push(String(error.stack)));
  page.on("console", (message) => complaints.push(`${message.type()}: ${message.text()}`));
  page.on("request", (request) => {
    const url = request.url();
    // Maps of pictures are files beside their page.
    const beside = url.startsWith(`file://${dirname(report)}/`) && url.endsWith(".png");
    if (url !== `file://${report}` && !beside && !/^(data|blob):/.test(url)) complaints.push(`asked for ${url}`);
  });
  await page.goto(`file://${report}`);
  return { page, context, complaints };
}

/** Every figure is there: as they come into view and, after two seconds, all; or `now`, as for paper. */
const drawn = async (page, { now = false } = {}) => {
  if (now) await page.evaluate(() => dispatchEvent(new Event("beforeprint")));
  await page.waitForFunction(() =>
    [...document.querySelectorAll("figure[data-figure]")].every(
      (f) => f.querySelector(".screen") && f.querySelector(".paper svg"),
    ),
  );
};

/** Tables of which a part is out of sight. */
const movedSideways = (page) =>
  page.evaluate(() =>
    [...document.querySelectorAll(".scroll")]
      .filter((s) => s.scrollWidth > s.clientWidth)
      .map((s) => s.innerText.slice(0, 60)),
  );

/** A canvas that holds one colour alone has nothing on it. */
const bareCanvases = (page) =>
  page.evaluate(
    () =>
      [...document.querySelectorAll("figure canvas")].filter((canvas) => {
        const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        const pixels = new Uint32Array(data.buffer);
        return pixels.every((p) => p === pixels[0]);
      }).length,
  );

async function figuresAreDrawn(page, name, colorScheme) {
  assert.equal(await page.locator("figure .none").count(), 0, "a figure with nothing to draw");
  await page.screenshot({ path: join(out, `${name}-${colorScheme}.png`) });
  assert.equal(await page.evaluate(() => document.documentElement.dataset.colours), colorScheme);
  assert.equal(await bareCanvases(page), 0, "a plot without anything on it");
  assert.deepEqual(await movedSideways(page), []);
}

async function figuresAreNumberedAndSaved(page) {
  const captions = await page.locator("figcaption b").allInnerTexts();
  assert.deepEqual(
    captions,
    captions.map((_, i) => `Figure ${i + 1}.`),
  );
  const figure = page.locator("figure[data-figure]").first();
  await figure.scrollIntoViewIfNeeded();
  const content = {};
  for (const format of ["SVG", "PNG", "CSV"]) {
    const [download] = await Promise.all([
      page.waitForEvent("download"),
      figure.getByRole("button", { name: new RegExp(`${format}$`) }).click({ force: true }),
    ]);
    content[format] = readFileSync(await download.path());
    content.name = download.suggestedFilename();
  }
  assert.match(content.SVG.toString(), /^<svg xmlns="http:\/\/www\.w3\.org\/2000\/svg"/);
  assert.equal(content.PNG.subarray(1, 4).toString(), "PNG");
  assert.match(content.CSV.toString(), /\r\n/);
  // What is taken away from a result that is not simply usable says so.
  const doubted = page.locator(":is(.result.caution, .result.reject) .word", { hasText: "Result: " });
  if (await doubted.count()) {
    const words = (await doubted.innerText()).trim();
    assert.ok(content.SVG.toString().includes(`>${words}</text>`), words);
    assert.ok(content.name.includes(words.replace("Result: ", "")), content.name);
  } else assert.doesNotMatch(content.SVG.toString(), />Result: /);
}

async function cursorGivesValuesAndDraggingZooms(page) {
  const plot = page.locator("figure .u-over").first();
  await plot.scrollIntoViewIfNeeded();
  const { x, y, width, height } = await plot.boundingBox();
  await page.mouse.move(x + width / 2, y + height / 2);
  const legend = page.locator("figure:has(.u-over) .legend").first();
  await page.waitForFunction(
    (l) => /\d/.test([...l.querySelectorAll("b")].map((b) => b.textContent).join("")),
    await legend.elementHandle(),
  );
  const ticks = () =>
    page
      .locator("figure canvas")
      .first()
      .evaluate((c) => c.toDataURL().length);
  const before = await ticks();
  await page.mouse.move(x + 0.3 * width, y + height / 2);
  await page.mouse.down();
  await page.mouse.move(x + 0.6 * width, y + height / 2, { steps: 4 });
  await page.mouse.up();
  await page.waitForFunction(
    ([c, n]) => c.toDataURL().length !== n,
    [await page.locator("figure canvas").first().elementHandle(), before],
  );
}

async function fitsOnPaper(page, name) {
  const pdf = await page.pdf({ format: "A4", path: join(out, `${name}.pdf`) });
  const pages = pdf.toString("latin1").match(/\/Type\s*\/Page[^s]/g).length;
  const most = name.startsWith("study") ? 20 : 8; // a dozen figures of the paper
  assert.ok(pages <= most, `${pages} pages, more than ${most}`);
}

/** What the first screen has: the result, what was measured, what was found, the parameters. */
const firstScreens = {
  assimilation: ['[data-figure="specimen"] svg', '[data-figure="measured:0"] canvas', '[data-figure="load"] canvas'],
  inference: ['[data-figure="observations"] canvas', '[data-figure="pairs"] svg'],
};
async function firstScreen(page, kind) {
  for (const place of [".result .word", ...firstScreens[kind], ".tables table tbody tr"]) {
    const { y, height } = await page.locator(place).first().boundingBox();
    assert.ok(y >= 0 && y + height <= screen.height, `${place} ends at ${y + height}`);
  }
}

async function sliderMovesTheShape(page) {
  // The shape of the specimen is that of another time.
  const shape = () => page.locator('[data-figure="specimen"] .mesh').innerHTML();
  const last = await shape();
  await page.locator(".steps input").fill("0");
  await page.waitForFunction(
    (before) => document.querySelector('[data-figure="specimen"] .mesh').innerHTML !== before,
    last,
  );
}

/** Of what is rejected no number looks as if it could be used; what was measured does. */
async function rejectedIsStruck(page) {
  const seen = await page.evaluate(() => {
    const figures = '[data-figure="load"], [data-figure^="parameter:"], [data-figure^="forecast:"]';
    const all = (selector) =>
      [...document.querySelectorAll(figures)].flatMap((figure) => [...figure.querySelectorAll(selector)]);
    const style = (elements, name) => [...new Set(elements.map((e) => getComputedStyle(e)[name]))];
    return {
      numbers: style(all(".legend b:not(.fact)"), "textDecorationLine"),
      plots: style(all("canvas"), "filter"),
      cells: style([...document.querySelectorAll(".tables td:not(:first-child)")], "textDecorationLine"),
      measured: style([...document.querySelectorAll('[data-figure^="measured:"] .fact')], "textDecorationLine"),
    };
  });
  assert.deepEqual(seen, {
    numbers: ["line-through"],
    plots: ["grayscale(1)"],
    cells: ["line-through"],
    measured: ["none"],
  });
}

for (const report of reports) {
  const name = basename(report) === "index.html" ? basename(dirname(report)) : basename(report, ".html");
  const kind = /\{"kind":"(\w+)"/.exec(readFileSync(report, "utf8"))[1];

  // Opening and drawing a report takes most of the time: what can be seen on one page is.
  test(`${name}, light`, async (t) => {
    const { page, context, complaints } = await open(report, { colorScheme: "light" });
    await drawn(page);
    await t.test("every figure is drawn", () => figuresAreDrawn(page, name, "light"));
    if (firstScreens[kind]) await t.test("first screen", () => firstScreen(page, kind));
    if (kind === "assimilation") await t.test("the slider", () => sliderMovesTheShape(page));
    if (await page.locator("html.rejected").count())
      await t.test("nothing rejected looks usable", () => rejectedIsStruck(page));
    await t.test("figures are numbered, and saved as SVG, PNG and CSV", () => figuresAreNumberedAndSaved(page));
    await t.test("on paper it has few pages", () => fitsOnPaper(page, name));
    await t.test("the cursor gives values, and dragging zooms", () => cursorGivesValuesAndDraggingZooms(page));
    // The last one: it takes paths off.
    await t.test("accessible", async () => assert.deepEqual(await axeFaults(page), []));
    assert.deepEqual(complaints, [], "nothing is complained of, or asked for");
    await context.close();
  });

  test(`${name}, dark: every figure is drawn, accessible, nothing is asked for`, async () => {
    const { page, context, complaints } = await open(report, { colorScheme: "dark" });
    await drawn(page, { now: true });
    await figuresAreDrawn(page, name, "dark");
    assert.deepEqual(await axeFaults(page), []);
    assert.deepEqual(complaints, []);
    await context.close();
  });

  test(`${name}: without JavaScript the numbers and tables read, and no place for a figure is left`, async () => {
    const { page, context } = await open(report, { javaScriptEnabled: false });
    assert.match(await page.locator("h1").innerText(), /\w/);
    assert.ok((await page.locator("table td").count()) > 2);
    assert.equal(await page.locator("figure:visible").count(), 0);
    assert.equal(await page.locator(".scriptless:visible").count(), 1);
    const result = page.locator(".result .word");
    if (await result.count())
      assert.match(
        await result.innerText(),
        /^(Result: (usable|usable with caveats|do not use)|\d+ of \d+ dofs chosen)$/,
      );
    await context.close();
  });

  test(`${name}: nothing is wider than a phone, and no table is moved sideways`, async () => {
    const { page, context } = await open(report, { viewport: { width: 390, height: 844 } });
    await drawn(page, { now: true });
    assert.ok((await page.evaluate(() => document.documentElement.scrollWidth)) <= 390);
    assert.deepEqual(await movedSideways(page), []);
    // Where a table has become a list, every number has its header's words.
    const unnamed = await page.evaluate(() =>
      [...document.querySelectorAll(".wide td:not(:first-child):not(:empty)")]
        .map((td) => getComputedStyle(td, "::before").content)
        .filter((words) => !/[\p{L}\d]/u.test(words)),
    );
    assert.deepEqual(unnamed, []);
    await page.screenshot({ path: join(out, `${name}-phone.png`), fullPage: true });
    assert.deepEqual(await axeFaults(page), []);
    await context.close();
  });
}
