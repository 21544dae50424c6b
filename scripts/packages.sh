#!/usr/bin/env bash
# Debian packages of the tree, into build/packages: with what is not committed, without what git ignores. Then lintian.
set -euo pipefail
cd "$(dirname "$0")/.."
version=$(sed -nE '1s/.*\((.*)\).*/\1/p' debian/changelog)
source=build/packages/knothe-$version
rm -rf "$source"
rm -f build/packages/*.{deb,buildinfo,changes}
mkdir -p "$source"
if [ -e .git ]; then
  git ls-files -z --cached --others --exclude-standard | while IFS= read -r -d '' file; do [ ! -e "$file" ] || printf '%s\0' "$file"; done
else # of the source archive
  find . -path ./build -prune -o -path ./out -prune -o -type f -print0
fi | tar --null -T - -c | tar -x -C "$source"
# debhelper gives the compiler a home of its own.
if command -v ccache >/dev/null; then CCACHE_DIR=$(ccache -k cache_dir) && export CCACHE_DIR; fi
export DEB_BUILD_OPTIONS="parallel=${JOBS:-$(nproc)} ${DEB_BUILD_OPTIONS:-}"
(cd "$source" && dpkg-buildpackage -us -uc -b)
lintian --fail-on error,warning --tag-display-limit 0 --allow-root build/packages/*.changes
ls -sh1 build/packages/*.deb
