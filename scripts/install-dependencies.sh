#!/usr/bin/env bash
# install-dependencies.sh WORD…: installs the Debian packages that scripts/packages.txt lists for one of these words and that
# are missing; quick when all are there.
set -euo pipefail
cd "$(dirname "$0")"
missing=()
optional=()
while read -r package words; do
  [[ $package != \#* ]] || continue
  for word in "$@"; do
    [[ " $words " == *" $word "* ]] || continue
    # Where node comes from NodeSource, Debian's npm would be in conflict with it.
    case $package in nodejs | npm) ! command -v npm >/dev/null || continue ;; esac
    [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" = installed ] && break
    if [[ " $words " == *" optional "* ]]; then optional+=("$package"); else missing+=("$package"); fi
    break
  done
done <packages.txt
if [ $((${#missing[@]} + ${#optional[@]})) -eq 0 ]; then
  exit 0
fi
echo "knothe: installing $((${#missing[@]} + ${#optional[@]})) packages: ${missing[*]} ${optional[*]}"
as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || {
    echo "knothe: not root and no sudo: install these packages yourself" >&2
    [ ${#missing[@]} -eq 0 ] && exit 0 || exit 1
  }
  as_root=(sudo)
fi
export DEBIAN_FRONTEND=noninteractive
install() { "${as_root[@]}" apt-get install -y -q --no-install-recommends "$@"; }
if [ ${#missing[@]} -gt 0 ]; then
  "${as_root[@]}" apt-get update -q
  install "${missing[@]}"
fi
if [ ${#optional[@]} -gt 0 ]; then
  { [ ${#missing[@]} -gt 0 ] || "${as_root[@]}" apt-get update -q; } && install "${optional[@]}" ||
    echo "knothe: without ${optional[*]}, which could not be installed" >&2
fi
