// Pictures of the page for docs/reference/dashboard.md that a live test does not show: `npm run frames` writes ../docs/images/dashboard-*.png.
import { mkdirSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { MockService, Recording, verdict } from "../mock/server.mjs";
import { launch, until } from "./browser.mjs";

const images = join(dirname(fileURLToPath(import.meta.url)), "../../docs/images");
mkdirSync(images, { recursive: true });
const frames = [
  {
    name: "dashboard-field",
    start: 92,
    look: { viewport: { width: 1280, height: 1000 }, colorScheme: "dark" },
    async go(page) {
      await page.locator('#field select[aria-label="Field"]').selectOption("sensitivity:Y0");
      await page.getByRole("button", { name: "oblique" }).click();
      await page.mouse.move(5, 5);
      await page.evaluate(() => scrollBy(0, document.getElementById("field").getBoundingClientRect().top - 62));
    },
  },
  {
    name: "dashboard-phone",
    start: 60,
    look: { viewport: { width: 390, height: 806 }, isMobile: true, hasTouch: true },
    recorded: (line) => {
      if (line.step > 60) line.verdict = verdict("reject", "fit", "the data do not fit the model: the misfit grows");
    },
    async go(_page, service) {
      service.say("BIASED", "the last datum does not fit the model: χ² 212 with 58 values");
    },
  },
];

const browser = await launch();
for (const { name, start, look, recorded, go } of frames) {
  const recording = new Recording().scenario();
  if (recorded) recording.lines.forEach(recorded);
  const service = await new MockService(recording, { rate: 0, start, period: 600 }).listen();
  const context = await browser.newContext(look);
  const page = await context.newPage();
  await page.goto(service.url);
  await until(page, "#field .readout", /Sensors/);
  await go?.(page, service);
  await page.waitForTimeout(1500);
  service.lastAt = Date.now();
  service.say(service.state?.state ?? "OK", service.state?.reason ?? "");
  await page.waitForTimeout(300);
  await page.screenshot({ path: join(images, `${name}.png`) });
  await context.close();
  await service.close();
}
await browser.close();
