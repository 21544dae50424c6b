// Types, the committed page, unit tests in node, then the page in headless Chromium. `node test/all.mjs unit|page|service|reports` runs a part;
// `service`, the page on the real program, `reports` and `manual` only when asked for by name: they need KNOTHE and KNOTHE_PROJECT, KNOTHE_REPORTS,
// KNOTHE_MANUAL.
import { spawnSync } from "node:child_process";
import { existsSync, readdirSync, rmSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const root = dirname(here);
const out = join(root, "out");
const part = process.argv[2] ?? "all";

function run(...command) {
  const { status } = spawnSync(process.execPath, command, { cwd: root, stdio: "inherit" });
  if (status !== 0) process.exit(status ?? 1);
}

if (part === "unit" || part === "all") {
  run(join(root, "node_modules/typescript/bin/tsc"), "--noEmit", "-p", ".");
  run("build.mjs", "--check");
  run(join(root, "node_modules/prettier/bin/prettier.cjs"), "--check", ".");
  rmSync(join(out, "unit"), { recursive: true, force: true });
  await build({
    entryPoints: readdirSync(here)
      .filter((name) => name.endsWith(".test.ts"))
      .map((name) => join(here, name)),
    outdir: join(out, "unit"),
    outExtension: { ".js": ".mjs" },
    bundle: true,
    platform: "node",
    format: "esm",
    target: "node18",
    sourcemap: "inline",
    jsx: "automatic",
    jsxImportSource: "preact",
    logLevel: "warning",
  });
  run("--enable-source-maps", "--test", ...readdirSync(join(out, "unit")).map((name) => join(out, "unit", name)));
}
if (part !== "unit") {
  if (!existsSync(process.env.KNOTHE_CHROMIUM ?? "/usr/bin/chromium")) {
    console.log("dashboard: no chromium: the page is not tested in a browser (apt-get install chromium)");
    process.exit(part === "all" ? 0 : 77);
  }
  run("--test", join(here, `${part === "all" ? "page" : part}.test.mjs`));
}
