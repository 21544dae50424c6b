#!/usr/bin/env python3
"""What the packages consist of, as SPDX 2.3 (JSON) on stdout: each package with its SHA-256; what it needs at run time; what was compiled
into it, which are headers and archives of the packages that it was built with, and the parts of the page.

usage: sbom.py FOLDER    the one with *.deb and the .buildinfo
"""
import datetime
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys

SOURCE = pathlib.Path(__file__).resolve().parent.parent


def fields_of(text):
    """The fields of a Debian control file; continued lines joined."""
    return dict(re.findall(r"^([\w-]+): *(.*(?:\n .*)*)", text, re.MULTILINE))


def names_in(dependencies):
    """`a (>= 1) | b, c:any` as [[a, b], [c]]."""
    groups = [group.split("|") for group in dependencies.replace("\n", " ").split(",") if group.strip()]
    return [[re.match(r"\s*([\w.+-]+)", one)[1] for one in group] for group in groups]


def identifier(*words):
    return "SPDXRef-" + re.sub(r"[^A-Za-z0-9.-]", "-", "-".join(words))


class Document:
    def __init__(self, name, created):
        self.packages, self.relations = {}, []
        self.head = {"spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT", "name": name,
                     "documentNamespace": f"https://spdx.org/spdxdocs/{name}-{created}",
                     "creationInfo": {"created": created, "creators": ["Tool: knothe scripts/sbom.py"]}}

    def add(self, kind, name, version, locator, **more):
        key = identifier(kind, name)
        self.packages.setdefault(key, {
            "SPDXID": key, "name": name, "versionInfo": version, "downloadLocation": "NOASSERTION", "filesAnalyzed": False,
            "licenseConcluded": "NOASSERTION", "licenseDeclared": "NOASSERTION", "copyrightText": "NOASSERTION",
            "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl", "referenceLocator": locator}], **more})
        return key

    def relate(self, one, relation, other):
        self.relations.append({"spdxElementId": one, "relationshipType": relation, "relatedSpdxElement": other})

    def text(self):
        return json.dumps({**self.head, "packages": list(self.packages.values()), "relationships": self.relations}, indent=1)


def debian(document, name, version):
    return document.add("Debian", name, version, f"pkg:deb/debian/{name}@{version}?distro=bookworm")


def installed_version(name):
    done = subprocess.run(["dpkg-query", "-W", "-f", "${db:Status-Status} ${Version}", name], capture_output=True, text=True)
    status, _, version = done.stdout.partition(" ")
    return version if status == "installed" else None


def add_ours(document, paths, build_needs):
    control = {path: fields_of(subprocess.run(["dpkg-deb", "-f", path], check=True, capture_output=True, text=True).stdout) for path in paths}
    ours = {fields["Package"] for fields in control.values()}
    for path, fields in control.items():
        content = path.read_bytes()
        name, version = fields["Package"], fields["Version"]
        key = document.add("knothe", name, version, f"pkg:deb/debian/{name}@{version}?arch={fields['Architecture']}",
                           packageFileName=path.name, licenseDeclared="Apache-2.0", summary=fields["Description"].splitlines()[0],
                           checksums=[{"algorithm": "SHA256", "checksumValue": hashlib.sha256(content).hexdigest()}])
        document.relate("SPDXRef-DOCUMENT", "DESCRIBES", key)
        for group in names_in(fields.get("Pre-Depends", "") + "," + fields.get("Depends", "")):
            if group[0] in ours:
                document.relate(key, "DEPENDS_ON", identifier("knothe", group[0]))
                continue
            # The first of the alternatives that is there; else the first, of a version that is not known.
            there = [(one, installed_version(one)) for one in group if installed_version(one)] or [(group[0], "NOASSERTION")]
            document.relate(key, "DEPENDS_ON", debian(document, *there[0]))
        if fields["Architecture"] != "all":
            for need, its_version in build_needs:
                document.relate(debian(document, need, its_version), "BUILD_DEPENDENCY_OF", key)


def add_page(document):
    """What of npm is in the page of `knothe serve`, which is in the program."""
    lock = json.loads((SOURCE / "dashboard/package-lock.json").read_text())["packages"]
    for name in ("preact", "uplot"):
        part = lock[f"node_modules/{name}"]
        key = document.add("npm", name, part["version"], f"pkg:npm/{name}@{part['version']}", licenseDeclared=part.get("license", "NOASSERTION"))
        document.relate(identifier("knothe", "knothe"), "CONTAINS", key)


def main():
    folder = pathlib.Path(sys.argv[1])
    paths = sorted(folder.glob("*.deb"))
    (record,) = folder.glob("*.buildinfo")
    build = fields_of(record.read_text())
    versions = dict(re.findall(r"([\w.+-]+) \(= ([^)]+)\)", build["Installed-Build-Depends"]))
    asked = [group[0] for group in names_in(fields_of((SOURCE / "debian/control").read_text())["Build-Depends"])]
    needs = [(name, versions[name]) for name in asked if name in versions]
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH") or datetime.datetime.now().timestamp())
    created = datetime.datetime.fromtimestamp(seconds, datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    document = Document(f"knothe-{build['Version']}", created)
    add_ours(document, paths, needs)
    add_page(document)
    print(document.text())


if __name__ == "__main__":
    main()
