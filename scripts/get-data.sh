#!/bin/bash
# Downloads the recorded data of the examples and tests from their public sources, and checks them by SHA-256.
#
#   scripts/get-data.sh [FOLDER]           into FOLDER; default: $KNOTHE_DATA, else ../shared/data beside the source folder
#   scripts/get-data.sh --check [FOLDER]   only checks what is there
#
# They are not part of knothe: each source has a licence of its own. the crack growth records need Rscript (Debian: r-base-core).
set -euo pipefail

funambule=https://raw.githubusercontent.com/marc-l-m-francois/Funambule/acb7ed0ce12946d22fa1e06f6a9aaa1c3dd6e9c9
pypd=https://raw.githubusercontent.com/mark-hobbs/pypd/61b1323340782a657b5f6c5b395c9a6ac8d81152
virkler=https://raw.githubusercontent.com/cran/BaPreStoPro/f3e8f06b07ec4b4ca0be9de3d481734d5e154c31

# path, SHA-256, address
files="
concrete_bending/IMG_0155.tif 32df6c2bbc02f1522690a172d6b718a374b773879b6726bdfca0efa8e6951a32 $funambule/Images/DIC_examples/Flexion_3_points_beton/IMG_0155.tif
concrete_bending/IMG_0160.tif 690913d747dd20071251b793b25a3de610a903641959429289b3736e2daaf782 $funambule/Images/DIC_examples/Flexion_3_points_beton/IMG_0160.tif
concrete_bending/IMG_0179.tif 2f325fabf967bb78b7a0e30cf26323af947177b0085ee50e784f605e0ac41659 $funambule/Images/DIC_examples/Flexion_3_points_beton/IMG_0179.tif
gregoire_half_notched/load_cmod_envelope.csv 8ed1d576805116a7b7482e9b82de042c68563f543183b61e1db4ba8505f1038f $pypd/examples/data/half_notched_beam.csv
virkler_crack_growth/virkler_specimens_01_48.csv 85fa349c857afaf5471fb264f30c3ae5fc2c13fb594fa3c316462f2684b5fad8 $virkler/data/Virkler.RData
"

check_only=false
if [ "${1:-}" = --check ]; then
  check_only=true
  shift
fi
source_folder=$(cd "$(dirname "$0")/.." && pwd)
folder=${1:-${KNOTHE_DATA:-$source_folder/../shared/data}}

is_right() {  # FILE SHA-256
  [ "$(sha256sum < "$1" | cut -d' ' -f1)" = "$2" ]
}

table_of_r() {  # FROM.RData TO.csv: the first column the crack length, then the cycles of the first 48 specimens
  command -v Rscript > /dev/null || { echo "get-data: $2 needs Rscript (Debian: r-base-core)" >&2; return 1; }
  Rscript -e 'a <- commandArgs(TRUE); e <- new.env(); d <- as.data.frame(get(load(a[1], e)[1], e))[, 1:49]
              names(d) <- c("CrackLength", paste0("CycleCount", 1:48)); options(scipen = 20)
              write.table(d, a[2], sep = ",", quote = FALSE, row.names = FALSE)' "$1" "$2"
}

fetch() {  # ADDRESS TO
  curl --fail --silent --show-error --location --output "$2" "$1" || return 1
  case $1 in *.RData) mv "$2" "$2.RData" && table_of_r "$2.RData" "$2" ;; esac
}

failed=0
while read -r path sum address; do
  [ -n "$path" ] || continue
  target=$folder/$path
  if [ -e "$target" ] && is_right "$target" "$sum"; then
    echo "$path: there, checksum right"
  elif [ -e "$target" ]; then
    echo "get-data: $target: the checksum is wrong: expected SHA-256 $sum; remove the file to have it downloaded" >&2
    failed=1
  elif $check_only; then
    echo "get-data: $target is missing" >&2
    failed=1
  else
    mkdir -p "$(dirname "$target")"
    part=$target.part
    if fetch "$address" "$part" && is_right "$part" "$sum"; then
      mv "$part" "$target"
      echo "$path: downloaded, checksum right"
    else
      echo "get-data: $path: not got from $address, or with another checksum than $sum; what came is in $part" >&2
      failed=1
    fi
    rm -f "$part.RData"
  fi
done <<< "$files"
exit $failed
