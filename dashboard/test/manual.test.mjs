// The manual as Sphinx has built it (KNOTHE_MANUAL: its folder), in headless Chromium: accessible in both themes, no wider than a phone.
import assert from "node:assert/strict";
import { test } from "node:test";
import { axeFaults, launch } from "./browser.mjs";

const pages = [
  "index",
  "tutorials/beam",
  "tutorials/gallery",
  "how-to/index",
  "explanation/method",
  "reference/project-file",
  "reference/python",
  "reference/dashboard",
];
const browser = await launch();
test.after(() => browser.close());

for (const [colorScheme, width] of [
  ["light", 1366],
  ["dark", 390],
])
  test(`${colorScheme}, ${width} px: accessible, and nothing is wider`, async () => {
    const context = await browser.newContext({ viewport: { width, height: 800 }, colorScheme });
    const page = await context.newPage();
    page.setDefaultTimeout(120000); // on a busy machine
    for (const name of pages) {
      await page.goto(`file://${process.env.KNOTHE_MANUAL}/${name}.html`);
      // Equations are typeset after the page has been loaded; what they say is added then.
      await page.waitForFunction(() =>
        [...document.querySelectorAll(".math")].every((equation) => equation.querySelector("svg[aria-label]")),
      );
      assert.equal(await page.evaluate(() => document.body.dataset.theme), colorScheme);
      assert.ok((await page.evaluate(() => document.documentElement.scrollWidth)) <= width, name);
      assert.deepEqual(await axeFaults(page), [], name);
    }
    await context.close();
  });
