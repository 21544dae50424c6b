#!/usr/bin/env bash
# `make demo`, then `make test`, as the README has them, from a clone of what is committed in an empty Debian 12: clock and CPU time
# of each, packages apart; that nothing of the first is compiled again by the second; and the tests that were skipped. Needs root,
# debootstrap and a mirror; 77 where one of them is missing.
#
# usage: commands_in_chroot.sh [--configure] [FOLDER_OF_THE_CHROOT]     --configure: packages and both configurations, nothing built
set -euo pipefail
tree=$(cd "$(dirname "$0")/.." && pwd)
build=yes
if [ "${1:-}" = --configure ]; then build=; shift; fi
root=$(realpath -m "${1:-$tree/build/chroot-of-commands}")
mirror=${DEBIAN_MIRROR:-http://deb.debian.org/debian}
[ "$(id -u)" -eq 0 ] && command -v debootstrap >/dev/null || { echo "not root, or no debootstrap: nothing is tried"; exit 77; }
curl -sfI "$mirror/dists/bookworm/Release" >/dev/null || { echo "$mirror does not answer: nothing is tried"; exit 77; }
if [ -z "${KNOTHE_IN_CHROOT:-}" ]; then # what is mounted below is gone with the script
  KNOTHE_IN_CHROOT=1 exec unshare --mount --propagation private "$0" ${build:---configure} "$root"
fi

fail() { echo "FAILED: $*" >&2; exit 1; }
inside() { chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive HOME=/root "$@"; }
in_clone() { inside sh -c 'cd /srv/knothe && exec "$@"' sh "$@"; }
TIMEFORMAT='%R %U %S'
timed() { # words, command: the log's end where it fails
  local what=$1 status=0 clock user system
  shift
  { time "$@" >"$root.log" 2>&1 || status=$?; } 2>"$root.time"
  read -r clock user system <"$root.time"
  awk -v w="$what" -v c="$clock" -v u="$user" -v s="$system" 'BEGIN { printf "%6.1f min by the clock, %6.1f of CPU  %s\n", c/60, (u+s)/60, w }'
  if [ $status -ne 0 ]; then tail -100 "$root.log" >&2; fail "$what"; fi
}
commands() { in_clone ninja -C build/release -t compdb | python3 -c '
import json, sys
for entry in json.load(sys.stdin):
    if entry["output"].endswith(".o"):
        print(entry["output"], entry["command"])' | sort; }

rm -rf --one-file-system "$root" "$root".{log,time,demo,test}
mkdir -p "$root.cache"
timed "debootstrap" debootstrap --variant=minbase --cache-dir="$root.cache" --include=make,git,ca-certificates bookworm "$root" "$mirror"
mount -t proc proc "$root/proc"
mount -t tmpfs tmpfs "$root/dev/shm"
git clone -q "file://$tree" "$root/srv/knothe"

timed "packages of make demo" in_clone scripts/install-dependencies.sh build
if [ $build ]; then
  timed "make demo" in_clone make demo
else
  timed "its configuration" in_clone scripts/configure.sh release -DBUILD_TESTING=OFF
fi
commands >"$root.demo"
timed "packages of make test" in_clone scripts/install-dependencies.sh build test
if [ $build ]; then
  timed "make test" in_clone make test
else
  timed "its configuration" in_clone scripts/configure.sh release -DBUILD_TESTING=ON
fi
commands >"$root.test"
again=$(comm -23 "$root.demo" "$root.test" | cut -d' ' -f1)
[ -z "$again" ] || fail "make test compiles again, after make demo: $again"
echo "$(wc -l <"$root.demo") objects of make demo, $(wc -l <"$root.test") with the tests, none of them twice"
if [ $build ]; then
  tail -1 "$root.log"
  skipped=$(sed -nE 's/^ *[0-9]+\/[0-9]+ Test +#[0-9]+: ([^ ]+) .*\*\*\*Skipped.*/\1/p' "$root/srv/knothe/build/release.test.log")
  echo "$(grep -c . <<<"$skipped") skipped:" $skipped
  timed "make check" in_clone make check
  tail -1 "$root.log"
fi
umount "$root/proc" "$root/dev/shm"
rm -rf --one-file-system "$root" "$root".{log,time,demo,test}
