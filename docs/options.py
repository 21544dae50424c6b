"""The project-file reference as pages show it: a section for each table of the file, an anchor for each option, an example.

In the repository it is one table, as `knothe check --options` prints it; the examples are those of examples/ and of the other pages.
"""
import pathlib
import re
import textwrap

HERE = pathlib.Path(__file__).resolve().parent
PAGE = "reference/project-file"
FEW = 4  # options: a smaller table stays in the one around it
LONGEST = 14  # lines of an example
# Of tables that no example and no page has.
OTHERS = {"data.sensors.*": '[data.sensors.gauge]\nkind = "strain"\nfrom = [-0.01, 0.02, 0.0]\nto = [0.01, 0.02, 0.0]',
          "serve.mqtt": '[serve.mqtt]\nbroker = "broker.example:8883"\nca = "ca.pem"'}


def rows_of(source):
    """(name, value, default, meaning) of each option."""
    for line in source.splitlines():
        found = re.match(r"\| `([^`]+)` \| (.*?) \| (.*?) \| (.*) \|$", line)
        if found:
            yield found.groups()


def tables_of(rows):
    """The options of each table by its name, "" for those of none, in order."""
    kinds = {name: value for name, value, *_ in rows}
    inner = [name for name in kinds if any(other.startswith(f"{name}.") for other in kinds)]
    large = [name for name in inner if sum(other.startswith(f"{name}.") for other in kinds) >= FEW]
    # A table of tables alone has nothing of its own to tell.
    large = [name for name in large if any(other.startswith(f"{name}.") and not other.startswith(f"{name}.*") for other in kinds)]
    tables = {"": []}
    for row in rows:
        around = [name for name in large if row[0] == name or row[0].startswith(f"{name}.")]
        tables.setdefault(max(around, key=len, default=""), []).append(row)
    roots = list(dict.fromkeys(name.split(".")[0] for name in tables))
    return {name: tables[name] for name in sorted(tables, key=lambda name: roots.index(name.split(".")[0]))}


def sources():
    """Project files, the simplest one first, then those of the pages."""
    files = sorted((HERE.parent / "examples").glob("*/*.toml"), key=lambda path: (path.name != "quick.toml", path))
    yield from (path.read_text() for path in files)
    for page in sorted(HERE.rglob("*.md")):
        for block in re.findall(r"^ *```toml\n(.*?)^ *```$", page.read_text(), re.M | re.S):
            yield textwrap.dedent(block)


def example_of(table, texts):
    """The shortest piece of a project file with at least two lines of this table; "" where none is."""
    name = re.escape(table).replace(r"\*", r"[\w-]+")
    found = []
    for text in texts:
        for block in re.findall(rf"^\[+{name}\]+[^\n]*\n(?:(?!\[)[^\n]+\n?)*", text, re.M):
            found.append(block.strip())
        around, _, last = table.rpartition(".")
        if last == "*":
            found += re.findall(rf"^\[{re.escape(around)}\][^\n]*\n[\w-]+ = \{{(?:(?!\[)[^\n]+\n?)*", text, re.M)
        elif around:
            line = re.search(rf"^\[{re.escape(around)}\][^\n]*\n(?:(?!\[)[^\n]*\n)*?({re.escape(last)} = \{{.*)$", text, re.M)
            found += [f"[{around}]\n{line[1]}"] if line else []
    whole = [block for block in found if 2 <= block.count("\n") + 1 <= LONGEST]
    return whole[0] if whole else OTHERS.get(table, "")


def section(table, rows, texts):
    own = [row for row in rows if row[0] == table]
    rest = [row for row in rows if row[0] != table]
    lines = []
    if table:
        lines += ["", f'## `[{table}]`', "", f'<span id="{table}"></span>{own[0][3] if own else ""}', ""]
        example = example_of(table, texts)
        lines += ["```toml", example, "```", ""] if example else []
    lines += ["| option | value | default | meaning |", "| --- | --- | --- | --- |"]
    for name, value, default, meaning in rest:
        lines.append(f'| <span id="{name}"></span>`{name[len(table) + 1:] if table else name}` | {value} | {default} | {meaning} |')
    return lines


def split(app, page, source):
    """Sphinx's event source-read."""
    if page != PAGE:
        return
    rows = list(rows_of(source[0]))
    head = source[0][:source[0].index("| option |")].rstrip()
    texts = list(sources())
    source[0] = "\n".join([head, ""] + [line for table, own in tables_of(rows).items() for line in section(table, own, texts)]) + "\n"


def setup(app):
    app.connect("source-read", split)
    return {"parallel_read_safe": True}
