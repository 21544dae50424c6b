// What the tests in the browser share.
import assert from "node:assert/strict";
import { once } from "node:events";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { createServer } from "node:net";
import { chromium } from "playwright-core";

const patience = 60000; // on a busy machine; an idle one needs a thirtieth
const pause = () => new Promise((done) => setTimeout(done, 50));

export function launch() {
  return chromium.launch({
    executablePath: process.env.KNOTHE_CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
  });
}

/** A port that stays ours while nobody listens there: below those that the system gives to whoever asks for any. */
export async function portToComeBackTo() {
  const first = Number(readFileSync("/proc/sys/net/ipv4/ip_local_port_range", "utf8").split(/\s+/)[0]);
  for (;;) {
    const below = first > 10000 ? first - 1 - Math.floor(8000 * Math.random()) : 0;
    const server = createServer().listen(below, "127.0.0.1");
    const free = await once(server, "listening").then(
      () => true,
      () => false,
    );
    if (!free) continue;
    const { port } = server.address();
    await new Promise((resolve) => server.close(resolve));
    return port;
  }
}

/** A page whose complaints, and requests to other hosts, are in `complaints`. */
export async function watchedPage(browser, look) {
  const context = await browser.newContext({ ...look, acceptDownloads: true });
  const page = await context.newPage();
  page.setDefaultTimeout(patience);
  const complaints = [];
  page.on("pageerror", (error) => complaints.push(String(error.stack)));
  page.on("console", (message) => {
    // While the service is away, asks for a token, or has no such route, the browser itself says so.
    const expected =
      /ERR_CONNECTION_\w+|ERR_INCOMPLETE_CHUNKED|ERR_CONTENT_LENGTH_MISMATCH|ERR_EMPTY_RESPONSE|ERR_SOCKET_NOT_CONNECTED|status of 40[14]|GPU stall|GL Driver Message/;
    if (["error", "warning"].includes(message.type()) && !expected.test(message.text()))
      complaints.push(message.text());
  });
  page.on("request", (request) => {
    if (!/^(data|blob):/.test(request.url()) && new URL(request.url()).hostname !== "127.0.0.1")
      complaints.push(`went to ${request.url()}`);
  });
  return { page, context, complaints };
}

const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
/** What axe-core finds wrong with the page as it stands: rule, element, what to do. Takes paths off drawings. */
export async function axeFaults(page) {
  await page.evaluate(axe);
  // Thousands of paths carry no words, and would take a minute.
  const { violations } = await page.evaluate(() => {
    for (const path of document.querySelectorAll(".paper > *, .mesh path")) path.remove();
    return window.axe.run();
  });
  return violations.flatMap((v) => v.nodes.map((n) => `${v.id}: ${n.target.join(" ")}: ${n.failureSummary}`));
}

/** What is written, with plain blanks where no line may end. */
export const text = async (page, selector) => (await page.locator(selector).innerText()).replace(/\u00a0/g, " ").trim();
export const until = async (page, selector, expected) =>
  page.waitForFunction(
    ([s, source]) => new RegExp(source, "s").test((document.querySelector(s)?.innerText ?? "").replace(/\u00a0/g, " ")),
    [selector, expected.source],
  );
/** `look` until what it gives is `good`, and that: what is drawn comes a frame or more after what is written. */
export async function eventually(look, good, wait = patience) {
  for (const end = Date.now() + wait; ; await pause()) {
    const seen = await look();
    if (good(seen)) return seen;
    assert.ok(Date.now() < end, `still ${JSON.stringify(seen)}`);
  }
}
/** The first number in a text, and how exactly it is written. */
export function number(written) {
  const found = /[−-]?\d+(\.(\d+))?/.exec(written);
  assert.ok(found, `a number in "${written}"`);
  return { value: Number(found[0].replace("−", "-")), half: 0.5 * 10 ** -(found[2]?.length ?? 0) * (1 + 1e-9) };
}
function agree(written, expected, what) {
  const { value, half } = number(written);
  assert.ok(Math.abs(value - expected) <= half, `${what}: the page says "${written}", the service ${expected}`);
}

/** Every number of the cards at the top, as exactly as it is written there, once the page has drawn them. */
export async function compareNumbers(page, line) {
  for (const end = Date.now() + patience; ; await pause()) {
    try {
      return await compareNow(page, line);
    } catch (difference) {
      if (Date.now() > end) throw difference;
    }
  }
}
async function compareNow(page, line) {
  const factors = { m: { mm: 1e3, µm: 1e6, m: 1 }, N: { N: 1, kN: 1e-3 } };
  for (const [name, forecast] of Object.entries(line.forecast)) {
    const card = page.locator(`[data-forecast="${name}"]`);
    const shown = await card.locator(".value").innerText();
    const factor = factors[forecast.units][/[a-zµA-Z]+$/.exec(shown.trim())[0]];
    agree(shown, forecast.values[2] * factor, `median of ${name}`);
    const interval = (await card.locator(".interval").innerText()).split(":")[1].split("…");
    agree(interval[0], forecast.values[0] * factor, `lower end of ${name}`);
    agree(interval[1], forecast.values.at(-1) * factor, `upper end of ${name}`);
    for (const [side, p] of [
      ["b", forecast.probability_above_threshold],
      ["small", forecast.probability_below_threshold],
    ]) {
      if (p === undefined) continue; // recorded by an older service
      const failure = (await card.locator(`.failure ${side}`).innerText()).split(")")[1];
      if (failure.includes("<")) assert.ok(p < 1e-3);
      else if (/>\s99\.9/.test(failure)) assert.ok(p > 0.999);
      else agree(failure, 100 * p, `P of ${name}`);
    }
    assert.equal((await card.locator("h3").innerText()).includes("(past)"), forecast.past === true);
  }
  const parameters = await page.locator("[data-parameter]").all();
  assert.equal(parameters.length, line.mean.length);
  const description = await page.evaluate(async () => (await fetch("v1/description")).json());
  for (const [k, card] of parameters.entries()) {
    // Physical, where the service says in which units.
    const { value = 1, units } = description.parameters[k].reference ?? {};
    const prefixes = { GPa: 1e-9, MPa: 1e-6, kPa: 1e-3 };
    const written = await card.locator(".value").innerText();
    const factor = units && units !== "1" ? value * (prefixes[/[GMk]Pa/.exec(written)?.[0]] ?? 1) : 1;
    const values = line.quantiles.values[k].map((v) => factor * v);
    agree(written, values[2], `median of parameter ${k}`);
    const interval = (await card.locator(".interval").innerText()).split(":")[1].split("…");
    agree(interval[0], values[0], `lower end of parameter ${k}`);
    agree(interval[1], values.at(-1), `upper end of parameter ${k}`);
  }
}
