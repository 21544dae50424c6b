#!/usr/bin/env python3
"""Manual pages and the shells' completion of the programs, made from what their --help says and nothing else.

usage: help_pages.py FOLDER PROGRAM…    writes FOLDER/NAME.1, FOLDER/completions/NAME (bash) and /_NAME (zsh) for each program
"""
import pathlib
import re
import subprocess
import sys

SOURCE = pathlib.Path(__file__).resolve().parent.parent


class Command:
    """What `program words --help` says: a text, then sections of indented lines, then commands of its own."""

    def __init__(self, program, words=()):
        self.name = " ".join([program.name, *words])
        self.words = words
        text = subprocess.run([program, *words, "--help"], check=True, capture_output=True, text=True).stdout
        head, _, rest = text.partition("Usage: ")
        self.description = head.strip()
        usage, *sections = re.split(r"\n\n(?=[A-Z][a-z]+:\n)", rest)
        self.usage = usage.strip()
        self.sections = {title: body for title, _, body in (section.partition(":\n") for section in sections)}
        self.commands = [Command(program, (*words, name)) for name, _ in self.entries("Subcommands")]

    def entries(self, section):
        """(what, its text) of each line `  -o,--output TEXT      folder`; a long one has its text on the next line."""
        joined = re.sub(r"\n {20,}", "  ", self.sections.get(section, ""))
        return [tuple((re.split(r"  +", line.strip(), maxsplit=1) + [""])[:2]) for line in joined.splitlines() if line.strip()]

    def described_options(self):
        for what, text in self.entries("Options"):
            yield from ((name, text) for name in what.split(" ")[0].split(",") if name.startswith("--"))

    def options(self):
        return [name for name, _ in self.described_options()]

    def choices(self):
        """--method: transport, grid, …"""
        for what, _ in self.entries("Options"):
            found = re.search(r"(--[\w-]+) \S*\{(.*)\}", what)
            if found:
                yield found[1], found[2].split(",")

    def all(self):
        yield self
        for command in self.commands:
            yield from command.all()


def roff(text):
    text = text.replace("\\", "\\e").replace("-", "\\-").replace("`", "\\(ga")
    return re.sub(r"^(?=[.'])", "\\\\&", text, flags=re.MULTILINE)


def shape(what):
    """`-o,--output TEXT REQUIRED` as `-o, --output TEXT`, and `FILE TEXT REQUIRED` as `FILE`."""
    if not what.startswith("-"):
        return what.split(" ")[0]
    return re.sub(r" \w+:\{", " {", what.replace(" REQUIRED", "").replace(",-", ", -").replace(" ...", "…"))


def exit_statuses():
    page = (SOURCE / "docs/reference/commands.md").read_text()
    return re.findall(r"^\| (\d+) \| (.*) \|$", page, re.MULTILINE)


def page_of(program, version):
    section = lambda title: lines.append(f".SH {title}")
    lines = [f'.TH {program.name.upper()} 1 "" "knothe {version}" "User Commands"', ".nh"]
    section("NAME")
    lines.append(roff(f"{program.name} - " + program.description.splitlines()[0].rstrip(".")))
    section("SYNOPSIS")
    lines.append(roff(program.usage))
    section("DESCRIPTION")
    lines.append(roff(program.description))
    for command in program.all():
        if command is program:
            section("OPTIONS")
        elif command.commands:
            continue  # those that it has say it all
        else:
            if command is next(one for one in program.all() if one.words and not one.commands):
                section("COMMANDS")
            lines += [".SS " + roff(command.usage.replace("[OPTIONS] ", "")), roff(command.description)]
        for what, text in [*command.entries("Positionals"), *command.entries("Options")]:
            if command is program or not what.startswith("-h"):
                lines += [".TP", roff(f"\\fB{shape(what)}\\fR").replace("\\e", "\\"), roff(text)]
        if "Example" in command.sections:
            example = "\n".join(line.removeprefix("  ") for line in command.sections["Example"].rstrip().splitlines())
            lines += [".PP", ".EX", roff(example), ".EE"]
    section("EXIT STATUS")
    for status, meaning in exit_statuses():
        lines += [".TP", f"\\fB{status}\\fR", roff(meaning.replace("`", "'"))]
    section('"SEE ALSO"')
    lines.append(roff("The package knothe-doc: tutorials, how-to guides and reference; the options of a project file are printed by "
                      "knothe check --options."))
    return "\n".join(lines) + "\n"


def completion_of(program):
    """After a command that has commands, these; of its options and their values, what fits; else names of files."""
    function = "_" + program.name.replace("-", "_")
    cases, values = [], []
    for command in program.all():
        words = [one.words[-1] for one in command.commands] + command.options()
        cases.append(f'    "{" ".join(command.words)}") words="{" ".join(words)}" ;;')
        values += [f'    "{" ".join((*command.words, option))}") words="{" ".join(choices)}" ;;' for option, choices in command.choices()]
    known = "|".join(f'"{" ".join(command.words)}"' for command in program.all() if command.words)
    return f"""# bash completion of {program.name}: made from its --help
{function}() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} previous=${{COMP_WORDS[COMP_CWORD - 1]}} command="" words="" word
  for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
    case "${{command:+$command }}$word" in
      {known}) command="${{command:+$command }}$word" ;;
    esac
  done
  case "$command" in
{chr(10).join(cases)}
  esac
  case "${{command:+$command }}$previous" in
{chr(10).join(values) or "    *) ;;"}
  esac
  # Where a file is wanted, options only once they are begun.
  [[ $words == -* && $current != -* ]] && words=""
  COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o bashdefault -o default -F {function} {program.name}
"""


def zsh_words(described):
    """'name:what it is' …, as _describe has them."""
    return " ".join("'" + f"{name}:{text}".replace("'", "'\\''") + "'" for name, text in described)


def zsh_completion_of(program):
    """The same for zsh, which also shows what each word means."""
    function = "_" + program.name.replace("-", "_")
    cases, values = [], []
    for command in program.all():
        words = " ".join(command.words)
        cases.append(f'    "{words}") commands=({zsh_words(command.entries("Subcommands"))})\n'
                     f'      options=({zsh_words(command.described_options())}) ;;')
        values += [f'    "{" ".join((*command.words, option))}") values=({" ".join(choices)}) ;;' for option, choices in command.choices()]
    known = "|".join(f'"{" ".join(command.words)}"' for command in program.all() if command.words)
    return f"""#compdef {program.name}
# zsh completion of {program.name}: made from its --help
{function}() {{
  local command="" word
  local -a commands options values
  for word in "${{(@)words[2,CURRENT-1]}}"; do
    case "${{command:+$command }}$word" in
      ({known}) command="${{command:+$command }}$word" ;;
    esac
  done
  case "$command" in
{chr(10).join(cases)}
  esac
  case "${{command:+$command }}${{words[CURRENT-1]}}" in
{chr(10).join(values) or "    *) ;;"}
  esac
  if (( $#values )); then _describe value values
  elif [[ "${{words[CURRENT]}}" == -* ]]; then _describe option options
  elif (( $#commands )); then _describe command commands
  else _files
  fi
}}
{function} "$@"
"""


def main():
    folder = pathlib.Path(sys.argv[1])
    (folder / "completions").mkdir(parents=True, exist_ok=True)
    for path in map(pathlib.Path, sys.argv[2:]):
        program = Command(path)
        version = subprocess.run([path, "--version"], check=True, capture_output=True, text=True).stdout.split()[-1]
        (folder / f"{program.name}.1").write_text(page_of(program, version))
        (folder / "completions" / program.name).write_text(completion_of(program))
        (folder / "completions" / f"_{program.name}").write_text(zsh_completion_of(program))


if __name__ == "__main__":
    main()
