#!/usr/bin/env python3
"""No class has more than 20 public functions (constructors, destructor and operators aside), and no source of the
programs more than 120 lines. The largest are printed. Constants are called k_max_… and k_min_…, not k_most_…,
k_fewest_… or k_least_….

usage: check_shape.py REPOSITORY
"""
import pathlib
import re
import sys

MAX_FUNCTIONS, MAX_LINES = 20, 120
CLASS = re.compile(r"\b(class|struct)\s+(?:KNOTHE_\w+\s+)?(\w+)(?:\s+final)?(?:\s*:\s*[^{;]+)?\s*\{")
FUNCTION = re.compile(
    r"(~?\w+|operator\s*\S+)\s*\([^()]*(?:\([^()]*\)[^()]*)*\)\s*(?:const)?\s*(?:noexcept)?\s*(?:override|final)?"
    r"\s*(?:=\s*(?:0|default|delete))?\s*(?::.*)?$", re.S)
OTHER_EXTREME = re.compile(r"\b(?:k_(?:most|fewest|least)(?:_\w+)?|[uvw]_(?:most|least))\b")


def body_of(text, start):
    """What stands in a class itself: every function's body, and every type in it, is `{}`."""
    depth, body = 1, ""
    for c in text[start:]:
        depth += {"{": 1, "}": -1}.get(c, 0)
        if depth == 0:
            return body
        if c == "{" and depth == 2:
            body += "{}"
        elif depth == 1 and c != "}":
            body += c
    return body


def public_functions(kind, name, body):
    public, count = kind == "struct", 0
    for part in re.split(r"\b(public|private|protected)\s*:(?!:)", body):
        if part in ("public", "private", "protected"):
            public = part == "public"
        elif public:
            names = (FUNCTION.search(statement.strip()) for statement in re.split(r";|\{\}", part)
                     if not re.match(r"\s*(using|friend)\b", statement))
            count += sum(1 for n in names if n and n[1].lstrip("~") != name and not n[1].startswith("operator"))
    return count


root = pathlib.Path(sys.argv[1])
aside = re.compile(r"_test\.|_bench\.|/testing/")
classes, faults = [], []
for folder in ("knothe", "apps", "python"):
    for source in sorted((root / folder).rglob("*.[ch]pp")):
        if aside.search(str(source)):
            continue
        text = re.sub(r'"(?:[^"\\\n]|\\.)*"', '""', re.sub(r"//[^\n]*", "", source.read_text()))
        for match in CLASS.finditer(text):
            if not re.search(r"enum\s*$", text[:match.start()]):
                functions = public_functions(match[1], match[2], body_of(text, match.end()))
                classes.append((functions, match[2], source.relative_to(root)))
for functions, name, source in sorted(classes, reverse=True)[:5]:
    print(f"{functions} public functions: {name} ({source})")
faults += [f"{source}: {name} has {functions} public functions, more than {MAX_FUNCTIONS}"
           for functions, name, source in classes if functions > MAX_FUNCTIONS]
for source in sorted((root / "apps").rglob("*.[ch]pp")):
    lines = len(source.read_text().splitlines())
    if lines > MAX_LINES:
        faults.append(f"{source.relative_to(root)}: {lines} lines, more than {MAX_LINES}")
for folder in ("knothe", "apps", "python"):
    for source in sorted((root / folder).rglob("*.[ch]pp")):
        faults += [f"{source.relative_to(root)}: {name}: say k_max_… or k_min_…"
                   for name in sorted(set(OTHER_EXTREME.findall(source.read_text())))]
print("\n".join(faults))
sys.exit(1 if faults else 0)
