#!/usr/bin/env bash
# A release of the commit that is checked out, in build/release-VERSION: packages, source archive, what is in them (SPDX), and the
# SHA-256 of all of these.
set -euo pipefail
cd "$(dirname "$0")/.."
if [ -n "$(git status --porcelain)" ]; then
  echo "release.sh: there are changes that are not committed: commit or stash them first" >&2
  exit 1
fi
python3 tests/check_packages.py .
version=$(sed -nE '1s/.*\((.*)\).*/\1/p' debian/changelog)
out=build/release-$version
rm -rf "$out"
mkdir -p "$out"
scripts/packages.sh
cp build/packages/*.deb "$out"
git archive --format=tar --prefix="knothe-$version/" HEAD | gzip -9n >"$out/knothe-$version.tar.gz"
python3 scripts/sbom.py build/packages >"$out/knothe-$version.spdx.json"
(cd "$out" && sha256sum -- * >SHA256SUMS.new && mv SHA256SUMS.new SHA256SUMS)
ls -sh1 "$out"
if grep -q "^## $version (in development)" CHANGELOG.md; then
  echo "Not yet for others: CHANGELOG.md calls $version in development (CONTRIBUTING.md, Releasing)."
fi
