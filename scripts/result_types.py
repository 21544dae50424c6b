#!/usr/bin/env python3
"""The fields of a step's and an inference's line as types: dashboard/src/step_fields.ts and python/knothe/_records.py, from
docs/reference/lines.schema.json (`knothe check --schema`). With --check only says whether they are current.
"""
import json
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
HEAD = "From docs/reference/lines.schema.json, by scripts/result_types.py: change knothe/record/fields.cpp, not this."
NAMES = {"typescript": {"string": "string", "boolean": "boolean", "integer": "number", "number": "number"},
         "python": {"string": "str", "boolean": "bool", "integer": "int", "number": "float"}}


def type_of(schema, language):
    if schema["type"] == "array":
        inner = type_of(schema["items"], language) if "items" in schema else {"typescript": "unknown", "python": "Any"}[language]
        return f"{inner}[]" if language == "typescript" else f"list[{inner}]"
    if schema["type"] == "object":
        return {"typescript": "Record<string, unknown>", "python": "dict[str, Any]"}[language]
    return NAMES[language][schema["type"]]


def typescript(schemas):
    lines = [f"// {HEAD}", "", "/** A step's line. */", "export interface StepFields {"]
    for name, schema in schemas["step"]["properties"].items():
        if "description" in schema:
            lines.append(f"  /** {schema['description'][0].upper()}{schema['description'][1:]}. */")
        optional = "" if name in schemas["step"]["required"] else "?"
        lines.append(f"  {name}{optional}: {type_of(schema, 'typescript')};")
    return "\n".join([*lines, "}", ""])


def python(schemas):
    lines = [f'"""The lines of results as types. {HEAD}"""', "from __future__ import annotations", "", "from typing import Any, TypedDict"]
    for name, meaning in (("step", "A step's line of `knothe assimilate`."), ("inference", "The line of `knothe infer`.")):
        lines += ["", "", f"class {name.capitalize()}Record(TypedDict, total=False):", f'    """{meaning}"""', ""]
        lines += [f"    {key}: {type_of(schema, 'python')}" for key, schema in schemas[name]["properties"].items()]
    return "\n".join([*lines, ""])


def main():
    schemas = json.loads((ROOT / "docs" / "reference" / "lines.schema.json").read_text())
    stale = []
    for path, text in ((ROOT / "dashboard" / "src" / "step_fields.ts", typescript(schemas)),
                       (ROOT / "python" / "knothe" / "_records.py", python(schemas))):
        if path.exists() and path.read_text() == text:
            continue
        stale.append(str(path.relative_to(ROOT)))
        if "--check" not in sys.argv:
            path.write_text(text)
    if stale and "--check" in sys.argv:
        sys.exit(f"{', '.join(stale)}: not what the schema says: run scripts/result_types.py")


main()
