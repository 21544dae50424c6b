#!/usr/bin/env python3
"""The house in figures, of what git follows: production lines and casts, words of documentation, what does not go together, where
trust is set, and who knows both a map's order and its diagnostic.

usage: measure.py
"""
import pathlib
import re
import subprocess

root = pathlib.Path(__file__).resolve().parent.parent
names = subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True, check=True).stdout.split("\n")
files = [root / name for name in names if (root / name).is_file()]


def within(*folders, suffixes, aside=r"(?!)"):
    """{name: text} of what stands in these folders."""
    chosen = (file for file in files if file.suffix in suffixes and file.relative_to(root).parts[0] in folders)
    return {str(file.relative_to(root)): file.read_text() for file in chosen if not re.search(aside, str(file.relative_to(root)))}


def figure(number, text):
    print(f"{number:>9,}  {text}")


sources = within("knothe", "apps", suffixes={".cpp", ".hpp"}, aside=r"_test\.cpp$|_bench\.cpp$|/testing/")
lines = sum(text.count("\n") for text in sources.values())
casts = sum(text.count("static_cast<") for text in sources.values())
figure(lines, "production lines of C++ (knothe/ and apps/, without tests, benchmarks and testing/)")
figure(casts, f"static_casts: {1000 * casts / lines:.1f} in a thousand lines")
figure(sum(len(text.split()) for text in within("docs", suffixes={".md"}).values()), "words in docs/")

# Of the table: {F::one, {F::other, F::another}, "key", …}
table = sources.get("knothe/assimilation/update/compatibility.cpp", "")
rows = re.findall(r"\{(F::\w+),\s*\{((?:F::\w+[,\s]*)+)\}", table)
figure(len(rows), f"rows of what does not go together: {sum(others.count('F::') for _, others in rows)} pairs")

set_in = {name: len(re.findall(r"(?:\.|->)trusted\s*=(?!=)", text)) for name, text in sources.items()}
figure(sum(set_in.values()), "places that assign `trusted`: " + ", ".join(f"{n} in {name}" for name, n in set_in.items() if n))
both = [name for name, text in sources.items() if "map_order" in text and "variance_diagnostic" in text]
figure(len(both), "files that mention both map_order and variance_diagnostic: " + ", ".join(both))
