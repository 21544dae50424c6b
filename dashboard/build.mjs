// One self-contained page: dist/index.html. `--check` only tells whether the committed page is what the sources make.
import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const largest = 80 * 1024; // bytes, gzipped: issue 7
const notice = "/* knothe (Apache 2.0); within: Preact (MIT, Jason Miller), uPlot (MIT, Leon Sorokin) */";

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
    absWorkingDir: here,
    logLevel: "warning",
  });
  return result.outputFiles[0].text.trim();
}

const script = notice + (await bundle("src/main.tsx")).replace(/<\/(script)/gi, "<\\/$1");
const style = await bundle("src/all.css");
const hash = (text) => `sha256-${createHash("sha256").update(text).digest("base64")}`;
const parts = { "%SCRIPT-HASH%": hash(script), "%STYLE-HASH%": hash(style), "%SCRIPT%": script, "%STYLE%": style };
const page = readFileSync(join(here, "src/index.html"), "utf8").replace(/%[A-Z-]+%/g, (name) => parts[name] ?? name);
const size = gzipSync(page, { level: 9 }).length;
if (size > largest) {
  console.error(`dashboard: the page is ${size} bytes gzipped, more than ${largest}`);
  process.exit(1);
}
const target = join(here, "dist/index.html");
if (process.argv.includes("--check")) {
  let committed = "";
  try {
    committed = readFileSync(target, "utf8");
  } catch {
    // Absent is different.
  }
  if (committed !== page) {
    console.error(
      "dashboard: dist/index.html is not what the sources make: run `npm run build` in dashboard/ and commit it",
    );
    process.exit(1);
  }
  console.log(`dist/index.html is up to date, ${size} bytes gzipped`);
} else {
  writeFileSync(target, page);
  console.log(`dist/index.html: ${page.length} characters, ${size} bytes gzipped`);
}
