#!/usr/bin/env bash
# Builds sdist and wheel, installs the wheel into an environment with nothing but the runtime lock, and uses it from
# another folder as a stranger would. Run by `make package`; PYTHON is the interpreter with the build tools.
set -euo pipefail
shopt -s nullglob

cd "$(dirname "${BASH_SOURCE[0]}")/.."
PYTHON="$(realpath -s "${PYTHON:-.venv/bin/python}")"
here="$PWD"
scratch="$(mktemp -d -t rwa-monitor-package.XXXXXX)"
trap 'rm -rf "$scratch"' EXIT

say() { printf 'package: %s\n' "$*" >&2; }

# ---- build: the sdist from the checkout, the wheel from the sdist ------------------------------------------------------
# The backend is in the lock, so nothing is fetched past the hashes.
"$PYTHON" -m build --no-isolation --outdir "$scratch/dist" . >"$scratch/build.log" 2>&1 || { cat "$scratch/build.log" >&2; exit 1; }
wheels=("$scratch"/dist/*.whl) sdists=("$scratch"/dist/*.tar.gz)
say "$(basename "${sdists[0]}") $(du -h "${sdists[0]}" | cut -f1), $(basename "${wheels[0]}") $(du -h "${wheels[0]}" | cut -f1)"

# Everything that the checkout's package holds is in the wheel, and nothing else but metadata.
diff <(git ls-files rwa_monitor | sort) \
  <("$PYTHON" -m zipfile -l "${wheels[0]}" | awk 'NR > 1 && $1 !~ /dist-info/ {print $1}' | sort) \
  || { say "FAILED: the wheel does not hold the files of rwa_monitor/"; exit 1; }

# ---- install: a clean environment ------------------------------------------------------------------------------------
"$PYTHON" -m venv "$scratch/env"
pip=("$scratch/env/bin/python" -m pip install --disable-pip-version-check --quiet)
"${pip[@]}" --require-hashes -r requirements.txt
"${pip[@]}" --no-deps "${wheels[0]}"
"$scratch/env/bin/python" -m pip check

# ---- licences: only such as an Apache-2.0 program may depend on ----------------------------------------------------------
# The LGPL is psycopg's, of the extra `postgresql`: it is imported as it is, and anybody can put another one in its place.
"$PYTHON" -m piplicenses --python "$scratch/env/bin/python" --from=mixed --partial-match --allow-only="$(tr '\n' ';' <<'LICENCES'
Apache
MIT
BSD
Python Software Foundation
PSF
ISC
Zlib
Mozilla Public License 2.0
LGPL-3.0
GNU Lesser General Public License v3
LICENCES
)" >"$scratch/licences.txt" || { cat "$scratch/licences.txt" >&2; exit 1; }
say "licences of $(($(wc -l <"$scratch/licences.txt") - 1)) packages allow it"

# ---- use: from a folder that knows nothing of the checkout ---------------------------------------------------------------
cd "$scratch"
unset PYTHONPATH
export PATH="$scratch/env/bin:$PATH"
version="$(basename "${wheels[0]}" | cut -d- -f2)"  # with the commit in it, unless this is a release
[[ "$(rwa-monitor --version)" == "rwa-monitor $version" ]] || { say "FAILED: $(rwa-monitor --version) is not $version"; exit 1; }
rwa-monitor doctor
rwa-monitor simulate recording --seed 1 -o day.csv
rwa-monitor diagnose day.csv --json >day.json
rwa-monitor replay --verify "$here/replay/bad_day"
python -c 'import json; lines = [json.loads(line) for line in open("day.json")]; assert lines and all("verdict" in line for line in lines), lines'
say "installed, diagnosed, replayed"
