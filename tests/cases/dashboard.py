"""The page of `knothe serve`: what is committed is what its sources make; its parts; the page in headless Chromium.

Node is not needed to build knothe: where it, its locked packages or chromium are missing, these tests are skipped and say so.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

from support import exit_status

DASHBOARD = pathlib.Path(__file__).resolve().parent.parent.parent / "dashboard"
PAGES = [DASHBOARD / "dist" / name for name in ("index.html", "report.html")]
CHROMIUM = os.environ.get("KNOTHE_CHROMIUM", "/usr/bin/chromium")


def locked_packages():
    """Installs the locked npm packages if they are not there; why they cannot be, in words."""
    if not shutil.which("node") or not shutil.which("npm"):
        return "node or npm is not installed"
    lock, installed = DASHBOARD / "package-lock.json", DASHBOARD / "node_modules" / ".package-lock.json"
    if installed.exists() and installed.stat().st_mtime >= lock.stat().st_mtime:
        return None
    try:
        done = subprocess.run(["npm", "ci", "--no-audit", "--no-fund"], cwd=DASHBOARD, capture_output=True, text=True, timeout=200)
    except subprocess.TimeoutExpired:
        return "npm ci took longer than 200 s (no network?)"
    return None if done.returncode == 0 else f"npm ci failed (no network?): {done.stderr[-300:]}"


def run_part(case, part, **environment):
    missing = locked_packages()
    if not missing and part != "unit" and not os.path.exists(CHROMIUM):
        missing = f"{CHROMIUM} is not installed"
    if missing:
        case.skipTest(missing)
    done = subprocess.run(["node", "test/all.mjs", part], cwd=DASHBOARD, env={**os.environ, **environment}, capture_output=True, text=True,
                          timeout=900)
    case.assertEqual(done.returncode, 0, done.stdout[-6000:] + done.stderr[-2000:])
    return done.stdout


class Test(unittest.TestCase):
    def test_pages_are_self_contained(self):
        for page in PAGES:
            text = page.read_text(encoding="utf-8")
            self.assertIn("Content-Security-Policy", text)
            for asks_elsewhere in (r"<script[^>]*\bsrc=", r"<link[^>]*\bhref=\"(?!data:)", r"@import", r"url\(\s*['\"]?https?:"):
                self.assertIsNone(re.search(asks_elsewhere, text), f"{page}: {asks_elsewhere}")

    def test_sources_and_parts(self):
        said = run_part(self, "unit")
        for page in PAGES:
            self.assertIn(f"dist/{page.name} is up to date", said)

    def test_in_chromium(self):
        run_part(self, "page")


if __name__ == "__main__":
    sys.exit(exit_status(unittest.main(exit=False).result))
