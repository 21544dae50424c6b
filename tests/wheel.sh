#!/usr/bin/env bash
# The wheel in environments of its own, one with the newest numpy and one with the oldest that it is for; what it depends on is from the
# Python registry. Then tests/wheel_check.py.   usage: wheel.sh WHEEL [PYTHON]
set -euo pipefail
cd "$(dirname "$0")/.."
wheel=$(realpath "${1:?usage: wheel.sh WHEEL [PYTHON]}")
python=${2:-python3}
echo "size $(stat -c %s "$wheel") bytes: $(basename "$wheel")"
for numpy in numpy 'numpy==1.26.*'; do
  environment=$(mktemp -d)
  trap 'rm -rf "$environment"' EXIT
  "$python" -m venv "$environment"
  "$environment/bin/pip" install -q "$numpy" "$wheel"
  (cd "$environment" && env -u PYTHONPATH PATH="$environment/bin:/usr/bin:/bin" "$environment/bin/python" "$OLDPWD/tests/wheel_check.py")
  rm -rf "$environment"
done
