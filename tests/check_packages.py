"""debian/ fits the rest: versions, what is needed to build, the limits of what is linked to the library, files that it names.

usage: check_packages.py SOURCE
"""
import pathlib
import re
import sys

source = pathlib.Path(sys.argv[1])
debian = source / "debian"
wrong = []


def expect(equal, text):
    if not equal:
        wrong.append(text)


version = re.search(r"project\(knothe VERSION ([\d.]+)", (source / "CMakeLists.txt").read_text())[1]
packaged = re.match(r"knothe \((.*?)\)", (debian / "changelog").read_text())[1]
expect(packaged == version, f"debian/changelog: the newest entry is of {packaged}, CMakeLists.txt says {version}")

# Until 1.0 the binary interface is that of one minor version.
major, minor, _ = map(int, version.split("."))
limits = f"libknothe {major}.{minor} libknothe{major} (>= {major}.{minor}.0), libknothe{major} (<< {major}.{minor + 1}~)"
expect((debian / "libknothe0.shlibs").read_text().strip() == limits, f"debian/libknothe0.shlibs: should be: {limits}")

control = (debian / "control").read_text()
fields = re.search(r"^Build-Depends:(.*?)^\S", control, re.MULTILINE | re.DOTALL)[1]
asked = {name for name in re.findall(r"^ +([\w.+-]+)", fields, re.MULTILINE) if not name.startswith(("dh-sequence-", "debhelper-compat"))}
words = {line.split()[0]: set(line.split()[1:]) for line in (source / "scripts/packages.txt").read_text().splitlines() if not line.startswith("#")}
for name in sorted(asked):
    expect({"build", "package"} & words.get(name, set()), f"debian/control: {name} is not what `make packages` installs (scripts/packages.txt)")
for name in sorted(name for name, uses in words.items() if "build" in uses and name not in ("build-essential", "python3", "ccache")):
    expect(name in asked, f"debian/control: {name}, which building needs, is not among Build-Depends")

packages = re.findall(r"^Package: (.*)$", control, re.MULTILINE)
for path in debian.iterdir():
    if path.name.startswith(("knothe", "libknothe", "python3")):
        expect(path.name.rpartition(".")[0] in packages, f"debian/{path.name}: of no package of debian/control")
    if path.suffix in (".install", ".examples", ".docs", ".manpages"):
        for line in path.read_text().splitlines():
            name = line.split()[0]
            made = name.startswith(("usr/", "debian/build/"))
            expect(made or list(source.glob(name)), f"debian/{path.name}: there is no {name}")

print("\n".join(wrong) or f"debian/ fits: {len(packages)} packages of version {packaged}")
sys.exit(1 if wrong else 0)
