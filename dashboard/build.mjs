// Two self-contained pages: dist/index.html, the live page, and dist/report.html, into which the program writes a report. `--check` only
// tells whether what is committed is what the sources make.
import { createHash } from "node:crypto";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { readFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const notice = "/* knothe (Apache 2.0); within: Preact (MIT, Jason Miller), uPlot (MIT, Leon Sorokin) */";

/** Of uPlot what no plot here uses is left out: calendars (model time is no date), and curves between points. */
const withoutCalendars = {
  name: "uplot",
  setup({ onLoad }) {
    onLoad({ filter: /uPlot\.esm\.js$/ }, async ({ path }) => {
      let contents = await readFile(path, "utf8");
      for (const [unused, instead] of [
        [/\bisTime (?=\?|&&)/g, "false "],
        [/^\tconst _time(AxisSplits|AxisVals|SeriesVal) .*$/gm, ""],
        [/^const \[ timeIncrs.* = genTimeStuffs.*$/gm, ""],
        [/^\tuPlot\.(fmtDate|tzDate) .*$/gm, ""],
        [/^\t\(paths\.(stepped|spline) .*$/gm, ""],
        [/^\tconst _(tzDate|fmtDate) .*$/gm, ""],
        [/^const localTz .*$/gm, ""],
      ]) {
        if (!unused.test(contents)) throw new Error(`uPlot has changed: there is no ${unused}`);
        contents = contents.replace(unused, instead);
      }
      return { contents };
    });
  },
};

async function bundle(entry) {
  const result = await build({
    entryPoints: [join(here, entry)],
    bundle: true,
    minify: true,
    write: false,
    format: "iife",
    target: "es2020",
    charset: "utf8",
    jsx: "automatic",
    jsxImportSource: "preact",
    legalComments: "none",
    plugins: [withoutCalendars],
    absWorkingDir: here,
    logLevel: "warning",
  });
  return result.outputFiles[0].text.trim();
}

const hash = (text) => `sha256-${createHash("sha256").update(text).digest("base64")}`;
const isCheck = process.argv.includes("--check");

/** Puts script and style into a page; `largest` in bytes, gzipped. */
async function make({ name, template, entry, sheet, largest }) {
  const script = notice + (await bundle(entry)).replace(/<\/(script)/gi, "<\\/$1");
  const style = await bundle(sheet);
  const parts = { "%SCRIPT-HASH%": hash(script), "%STYLE-HASH%": hash(style), "%SCRIPT%": script, "%STYLE%": style };
  const page = readFileSync(join(here, template), "utf8").replace(/%[A-Z-]+%/g, (part) => parts[part] ?? part);
  const size = gzipSync(page, { level: 9 }).length;
  if (size > largest) {
    console.error(`dashboard: ${name} is ${size} bytes gzipped, more than ${largest}`);
    process.exit(1);
  }
  const target = join(here, name);
  if (!isCheck) {
    writeFileSync(target, page);
    console.log(`${name}: ${page.length} characters, ${size} bytes gzipped`);
    return;
  }
  const committed = existsSync(target) ? readFileSync(target, "utf8") : "";
  if (committed !== page) {
    console.error(`dashboard: ${name} is not what the sources make: run \`npm run build\` in dashboard/ and commit it`);
    process.exit(1);
  }
  console.log(`${name} is up to date, ${size} bytes gzipped`);
}

await make({
  name: "dist/index.html",
  template: "src/index.html",
  entry: "src/main.tsx",
  sheet: "src/all.css",
  largest: 80 * 1024, // issue 7
});
await make({
  name: "dist/report.html",
  template: "src/report/report.html",
  entry: "src/report/main.tsx",
  sheet: "src/report/report.css",
  largest: 60 * 1024,
});
