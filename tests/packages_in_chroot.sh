#!/usr/bin/env bash
# The packages in an empty Debian 12, as who installs them has them: the older ones installed, journals written, upgraded, the session
# of docs/how-to/install.md, Python, a program of the library, the instruction sets, removed, purged. Needs root, debootstrap and a
# mirror, and some minutes; 77 where one of them is missing.
#
# usage: packages_in_chroot.sh [FOLDER_OF_PACKAGES [FOLDER_OF_THE_CHROOT]]
set -euo pipefail
tree=$(cd "$(dirname "$0")/.." && pwd)
packages=$(realpath "${1:-$tree/build/packages}")
root=$(realpath -m "${2:-$tree/build/chroot}")
mirror=${DEBIAN_MIRROR:-http://deb.debian.org/debian}
[ "$(id -u)" -eq 0 ] && command -v debootstrap >/dev/null || { echo "not root, or no debootstrap: nothing is tried"; exit 77; }
curl -sfI "$mirror/dists/bookworm/Release" >/dev/null || { echo "$mirror does not answer: nothing is tried"; exit 77; }
ls "$packages"/knothe_*.deb >/dev/null 2>&1 || { echo "no packages in $packages: make packages" >&2; exit 1; }
if [ -z "${KNOTHE_IN_CHROOT:-}" ]; then # what is mounted below is gone with the script
  KNOTHE_IN_CHROOT=1 exec unshare --mount --propagation private "$0" "$packages" "$root"
fi

started=$(date +%s.%N)
step() { printf '%6.1f s  %s\n' "$(bc <<<"$(date +%s.%N) - $started")" "$*"; }
fail() { echo "FAILED: $*" >&2; exit 1; }
inside() { chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive HOME=/root "$@"; }
inside_as() { inside setpriv --reuid="$1" --regid="$1" --init-groups "${@:2}"; } # user, command
quietly() { "$@" >"$root.log" 2>&1 || { tail -40 "$root.log" >&2; fail "$*"; }; }
install_packages() { quietly inside sh -c "cd $1 && apt-get install -y --no-install-recommends ${*:2}"; } # folder, names

empty_debian() {
  rm -rf --one-file-system "$root" "$root".{log,url}
  mkdir -p "$root.cache"
  quietly debootstrap --variant=minbase --cache-dir="$root.cache" bookworm "$root" "$mirror"
  mount -t proc proc "$root/proc"
  mount -t tmpfs tmpfs "$root/dev/shm"
  mkdir "$root/before" "$root/now"
  cp "$packages"/*.deb "$root/now"
  step "an empty Debian: $(du -shx "$root" | cut -f1)"
}

# The same packages with a lower version: what an upgrade goes through is the installing, and the journals.
older_packages() {
  local package folder=$root.older version
  version=$(dpkg-deb -f "$(echo "$packages"/knothe_*.deb)" Version)
  for package in "$packages"/*.deb; do
    rm -rf "$folder"
    dpkg-deb -R "$package" "$folder"
    sed -i "s/^Version: .*/&~before/; s/(= $version)/(= $version~before)/g; s/(>= $version)/(>= $version~before)/g" "$folder/DEBIAN/control"
    dpkg-deb -Znone -b "$folder" "$root/before" >/dev/null
  done
  rm -rf "$folder"
}

# A service as the unit runs it: user, folder, project file of /etc/knothe.
serve() { # name
  rm -f "$root.url"
  inside_as knothe sh -c "cd /var/lib/knothe && echo \$\$ >pid && exec knothe serve /etc/knothe/$1.toml --port 0" >"$root.url" 2>"$root.log" &
  until [ -s "$root.url" ]; do kill -0 $! || { cat "$root.log"; fail "knothe serve $1"; }; sleep 0.1; done
  url=$(cat "$root.url")
  until curl -sf "${url}readyz" >/dev/null; do sleep 0.1; done
}
stop() {
  [ ! -e "$root/var/lib/knothe/pid" ] || kill -INT "$(cat "$root/var/lib/knothe/pid")"
  rm -f "$root/var/lib/knothe/pid"
  wait
}

replay() { # name: the lines without what is measured of time
  inside_as knothe knothe replay "/var/lib/knothe/$1.journal" --project "/etc/knothe/$1.toml" --json |
    sed -E 's/"(elapsed[a-z_]*|wall_clock)":(\{[^}]*\}|[^,}]*)//g'
}

written_by_the_older_ones() {
  local name session
  cp "$tree"/tests/cases/made_by_0.1.0/{model,data}.h5 "$root/var/lib/knothe"
  cp "$tree/tests/cases/made_by_0.1.0/project.journal" "$root/var/lib/knothe/first.journal"
  cp "$tree/tests/cases/journal_of_schema_4/project.journal" "$root/var/lib/knothe/fourth.journal"
  for name in first fourth; do
    session=$([ $name = first ] && echo a || echo b)
    sed -E "s#\"(model|data)\.h5\"#\"/var/lib/knothe/\1.h5\"#; s#\"project.journal\"#\"/var/lib/knothe/$name.journal\"#" \
      "$tree/tests/cases/made_by_0.1.0/project.toml" >"$root/etc/knothe/$name.toml"
    inside chown -R knothe:knothe /var/lib/knothe
    serve $name
    curl -sf "${url}v1/withdraw" -H 'Content-Type: application/json' -d '{"source":"daq","session":"'$session'","seq":7}' | grep -q '"withdrawn":true' ||
      fail "$name: the datum is not withdrawn"
    stop
    replay $name >"$root.$name.before"
    [ "$(wc -l <"$root.$name.before")" -gt 3 ] || fail "$name: too few lines"
  done
}

read_by_the_newer_ones() {
  local name
  for name in first fourth; do
    replay $name | cmp - "$root.$name.before" || fail "$name: the journal reads differently"
    serve $name
    curl -sf "${url}v1/status" | grep -q '"withdrawn":1\|"records"' || fail "$name: no status"
    stop
  done
}

installed_session() {
  local block
  block=$(sed -n '/^```bash/,/^```/p;/^```$/q' "$tree/docs/how-to/install.md" | sed '/^```/d')
  quietly inside sh -c "cd /now && $(head -1 <<<"$block" | sed 's/ install/ install -y --no-install-recommends/; s/sudo //')"
  inside useradd --create-home --home-dir /srv/engineer engineer
  tail -n +2 <<<"$block" >"$root/srv/engineer/session"
  quietly inside_as engineer sh -c 'cd ~engineer && HOME=$PWD sh -e session'
  grep -q "<svg" "$root/srv/engineer/report.html" || fail "the session of docs/how-to/install.md leaves no report"
}

instruction_sets() {
  local mask expected found supported loader=/lib64/ld-linux-x86-64.so.2
  for expected in "x86-64-v4 AVX-512" "x86-64-v3 AVX2" "none SSE2"; do
    mask=${expected% *}
    if [ "$mask" != none ]; then
      ls -d "$root"/usr/lib/*/knothe/glibc-hwcaps/"$mask" >/dev/null 2>&1 || { echo "          the packages have no $mask"; continue; }
      supported=$(inside $loader --help)
      grep -q "$mask (supported" <<<"$supported" || { echo "          this machine has no $mask"; continue; }
    fi
    found=$(inside $loader --glibc-hwcaps-mask "$mask" /usr/bin/knothe doctor | head -1) || true
    grep -q "${expected#* }" <<<"$found" || fail "with $mask not ${expected#* }: $found"
  done
  echo "          taken here: $(inside knothe doctor | head -1 || true)"
}

purged() {
  quietly inside sh -c "apt-get remove -y $ours"
  [ -e "$root/var/lib/knothe/first.journal" ] && [ -e "$root/etc/knothe/first.toml" ] || fail "removing took a journal or a project file"
  [ ! -e "$root/usr/bin/knothe" ] || fail "the program is still there"
  quietly inside apt-get purge -y knothe
  rm -rf "$root/before" "$root/now" "$root/srv/engineer"
  left=$(inside find / -xdev -iname '*knothe*' -not -path '/proc/*')
  [ -z "$left" ] || fail "left after purging: $left"
  ! inside dpkg-query -W -f '${Package}\n' 2>/dev/null | grep knothe || fail "dpkg still knows them"
  inside id knothe >/dev/null || fail "the user is gone"
}

# As docs/tutorials/notebooks.md says it: those of the package, without a browser.
notebooks() {
  local notebook
  install_packages /now ./knothe-offline_*.deb
  quietly inside apt-get install -y --no-install-recommends jupyter-nbconvert python3-ipykernel python3-matplotlib python3-xarray python3-h5netcdf
  inside sh -c 'mkdir -p /tmp/examples && cp -r /usr/share/doc/knothe/examples/. /tmp/examples'
  for notebook in "$tree"/examples/notebooks/*.ipynb; do
    quietly inside sh -c "cd /tmp/examples/notebooks && python3 -m nbconvert --to notebook --execute --output-dir /tmp $(basename "$notebook")"
    step "$(basename "$notebook")"
  done
  inside sh -c 'rm -rf /tmp/*'
}

trap stop EXIT
ours="knothe knothe-offline libknothe0 libknothe-dev python3-knothe knothe-doc"
empty_debian
older_packages
quietly inside apt-get update
step "the older packages are made"
install_packages /before ./knothe_*.deb
step "apt install ./knothe_*.deb"
written_by_the_older_ones
step "journals of 0.1.0 and of schema 4 are served"
install_packages /now ./knothe_*.deb
read_by_the_newer_ones
step "upgraded: the journals read the same"
inside systemd-analyze verify --man=no knothe@beam.service || fail "the unit"
quietly inside apt-get install -y --no-install-recommends nodejs
inside systemd-analyze verify --man=no knothe-plant@beam.service || fail "the unit of the bridge"
step "systemd-analyze verify has nothing to say of the units"
status=0
inside node /usr/share/knothe/plant/knothe-plant.mjs /dev/null >"$root.log" 2>&1 || status=$?
[ $status -eq 3 ] || { cat "$root.log"; fail "the bridge, without a configuration, ends with $status"; }
step "the bridge runs"
instruction_sets
step "each instruction set has its code"
installed_session
step "the session of docs/how-to/install.md"
install_packages /now ./python3-knothe_*.deb ./libknothe0_*.deb ./libknothe-dev_*.deb ./knothe-doc_*.deb g++ pkg-config
inside python3 -c 'import knothe; found = knothe.infer(lambda p: [p[0]], {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0); print("         ", found)'
quietly inside sh -c 'cd /tmp && g++ -std=c++20 /usr/share/doc/libknothe-dev/examples/map_of_a_density.cpp -o map $(pkg-config --cflags --libs knothe) && ./map'
grep -q trusted "$root.log" || fail "the program of the library"
inside test -f /usr/share/doc/knothe/html/index.html || fail "no documentation"
inside bash -c '. /usr/share/bash-completion/completions/knothe; COMP_WORDS=(knothe assi); COMP_CWORD=1; _knothe; [ "${COMPREPLY[*]}" = assimilate ]' || fail "completion"
quietly inside apt-get install -y --no-install-recommends zsh
inside zsh -fc 'autoload -Uz compinit && compinit && (( $+_comps[knothe] )) && (( $+_comps[knothe-offline] ))' || fail "zsh does not find the completion"
step "Python, a program of the library, pages, completion"
notebooks
purged
step "removed: journals stay; purged: nothing stays but the user"
umount "$root/proc" "$root/dev/shm"
rm -rf --one-file-system "$root" "$root".{log,url,first.before,fourth.before}
