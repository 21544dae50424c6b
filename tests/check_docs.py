#!/usr/bin/env python3
"""The documentation is true where a program can tell: links, anchors and named files exist, TOML parses and its keys are
options, Python compiles, lines are short, and the phrases of tests/forbidden_phrases.txt are nowhere a user reads.

usage: check_docs.py REPOSITORY
"""
import pathlib
import re
import subprocess
import sys
import textwrap
import tomllib

ROOT = pathlib.Path(sys.argv[1]).resolve()
GENERATED = "docs/reference/project-file.md"
LONGEST_LINE = 100
LONGEST_CODE = 110  # as the sources
FOLDERS = "apps|bench|cmake|dashboard|deploy|docs|examples|fuzz|knothe|scripts|studies|tests|python"
ELSEWHERE = ("dashboard/node_modules", "dashboard/out", "knothe/v1/")  # made by npm; topics of MQTT


def tracked(*patterns):
    """Files that git knows, or all that match where this is no clone (a source archive)."""
    listed = subprocess.run(["git", "-C", ROOT, "ls-files", "-co", "--exclude-standard", "--", *patterns], capture_output=True, text=True)
    if listed.returncode == 0:
        return [ROOT / name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]
    return [path for pattern in patterns for path in ROOT.rglob(pattern.split("/")[-1]) if "build" not in path.parts]


def blocks_of(text):
    """(language, content, line number of the content) of the fenced blocks."""
    for found in re.finditer(r"^ *```([^\n]*)\n(.*?)^ *```$", text, re.M | re.S):
        yield found[1].strip(), textwrap.dedent(found[2]), text[:found.start(2)].count("\n") + 1


def prose_of(text):
    """The text with fenced blocks and displayed equations blanked out, line for line."""
    return re.sub(r"^ *```[^\n]*\n.*?^ *```$|^\$\$.*?\$\$$", lambda found: "\n" * found[0].count("\n"), text, flags=re.M | re.S)


def anchors_of(text):
    """GitHub's and MyST's anchors of the headings."""
    found = {}
    for heading in re.findall(r"^#+ (.*)$", prose_of(text), re.M):
        slug = re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()).replace(" ", "-")
        count = found.get(slug, 0)
        found[slug] = count + 1
        if count:
            found[f"{slug}-{count}"] = 1
    return set(found)


def where(path, text, at):
    return f"{path.relative_to(ROOT)}:{text[:at].count(chr(10)) + 1}"


def check_links(path, text):
    plain = re.sub(r"`[^`\n]*`", lambda found: "x" * len(found[0]), prose_of(text))
    for found in re.finditer(r"\]\(<?([^)\s>]+)>?(?: \"[^\"]*\")?\)", plain):
        target, _, anchor = found[1].partition("#")
        if re.match(r"[a-z]+:", found[1]):
            continue
        other = (path.parent / target).resolve() if target else path
        if not other.exists():
            yield f"{where(path, plain, found.start())}: no file {target}"
        elif anchor and other.suffix == ".md" and anchor not in anchors_of(other.read_text()):
            yield f"{where(path, plain, found.start())}: no heading #{anchor} in {other.relative_to(ROOT)}"


def check_named_files(path, text):
    """`folder/…/file.ext` and `folder/…/` between backticks, of the repository."""
    for found in re.finditer(rf"`((?:{FOLDERS})/[\w./*{{}},-]*)`", prose_of(text)):
        name = found[1]
        choices = re.search(r"\{([^}]*)\}", name)
        for one in [name.replace(choices[0], choice) for choice in choices[1].split(",")] if choices else [name]:
            if re.search(r"NAME|LETTER|…", one) or one.startswith(ELSEWHERE):
                continue
            if not (any(ROOT.glob(one.rstrip("/"))) if "*" in one else (ROOT / one).exists() or any(ROOT.glob(one + ".*"))):
                yield f"{where(path, text, found.start())}: no file {one}"


def check_references_to_pages():
    """Every page or picture of docs/ that a source, a script or an example names."""
    for path in tracked("*"):
        if path.suffix not in (".hpp", ".cpp", ".py", ".ts", ".tsx", ".mjs", ".json", ".toml", ".txt", ".cmake", ".sh", ".md", ""):
            continue
        try:
            text = path.read_text()
        except UnicodeDecodeError:
            continue
        for found in re.finditer(r"\bdocs/[\w/-]+\.(?:md|png|svg)\b", text):
            if not (ROOT / found[0]).exists():
                yield f"{where(path, text, found.start())}: no page {found[0]}"


def option_patterns():
    """The options of the project file, `*` for a name; a table that passes its content on is allowed to hold anything."""
    table = (ROOT / GENERATED).read_text()
    options = dict(re.findall(r"^\| `([^`]+)` \| (.*?) \| ", table, re.M))
    return [re.compile(re.escape(name).replace(r"\*", r"[^.]+") + (r"(\..*)?" if "table" in value else "")) for name, value in options.items()]


def keys_of(table, before=""):
    for key, value in table.items():
        if isinstance(value, dict) and value:
            yield from keys_of(value, f"{before}{key}.")
        else:
            yield before + key


def check_blocks(path, text, options):
    for language, content, line in blocks_of(text):
        place = f"{path.relative_to(ROOT)}:{line}"
        if language == "toml":
            try:
                for key in keys_of(tomllib.loads(content)):
                    if not any(option.fullmatch(key) for option in options):
                        yield f"{place}: {key} is no option of a project file"
            except tomllib.TOMLDecodeError as error:
                yield f"{place}: not TOML: {error}"
        if language in ("python", "py"):
            try:
                compile(content, place, "exec")
            except SyntaxError as error:
                yield f"{place}: not Python: {error}"


def check_lines(path, text):
    for number, (line, prose) in enumerate(zip(text.splitlines(), prose_of(text).splitlines()), 1):
        longest = LONGEST_LINE if prose else LONGEST_CODE
        if len(line) > longest and not line.lstrip().startswith(("|", "![", "```")) and "](" not in line:
            yield f"{path.relative_to(ROOT)}:{number}: {len(line)} characters, more than {longest}"


def said_in(path, text):
    """What a user reads of a file: all of a page, the string literals of a source (neighbours joined)."""
    if path.suffix in (".cpp", ".hpp"):
        joined = re.sub(r'"\s*\n\s*"', "", re.sub(r"^\s*//.*$", "", text, flags=re.M))
        return "\n".join(re.findall(r'"(?:[^"\\\n]|\\.)*"', joined)) + "\n".join(re.findall(r'R"\w*\((.*?)\)\w*"', text, re.S))
    return text


def check_phrases():
    phrases = [line for line in (ROOT / "tests/forbidden_phrases.txt").read_text().splitlines() if line and not line.startswith("#")]
    rules = [(phrase, better, re.compile(r"(?<![\w-])" + r"\s+".join(map(re.escape, phrase.split())) + r"(?![\w-])", re.I))
             for phrase, _, better in (line.partition(" -> ") for line in phrases)]
    read = tracked("*.md", "docs/*", "knothe/*.cpp", "knothe/*.hpp", "python/*.py", "python/*.cpp", "python/*.hpp", "apps/*.cpp", "apps/*.hpp", "dashboard/src/*", "examples/*", "scripts/*")
    for path in read:
        if path.suffix in (".png", ".svg") or path.name.endswith("_test.cpp"):
            continue
        said = said_in(path, path.read_text())
        for phrase, better, rule in rules:
            if rule.search(said):
                yield f'{path.relative_to(ROOT)}: "{phrase}"; rather: {better}'


def main():
    options = option_patterns()
    faults = []
    pages = [path for path in tracked("*.md", "docs/*.md") if path.suffix == ".md"]
    for path in pages:
        text = path.read_text()
        faults += [*check_links(path, text), *check_named_files(path, text), *check_blocks(path, text, options)]
        if str(path.relative_to(ROOT)) != GENERATED:
            faults += check_lines(path, text)
    faults += [*check_references_to_pages(), *check_phrases()]
    print("\n".join(dict.fromkeys(faults)) or f"{len(pages)} pages, all true as far as a program can tell")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
