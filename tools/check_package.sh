#!/usr/bin/env bash
# Builds the sdist, from it the wheel, and tries both ways in which a stranger installs, in an environment with nothing
# but the runtime lock: the wheel, and `pip install .` in the unpacked sdist. (The third way, the editable installation of
# a checkout, is `make venv-runtime`, which every other target stands on.) Used from another folder, as a stranger would.
# Run by `make package`; PYTHON is the interpreter with the build tools.
set -euo pipefail
shopt -s nullglob

cd "$(dirname "${BASH_SOURCE[0]}")/.."
PYTHON="$(realpath -s "${PYTHON:-.venv/bin/python}")"
here="$PWD"
scratch="$(mktemp -d -t rwa-monitor-package.XXXXXX)"
trap 'rm -rf "$scratch"' EXIT

say() { printf 'package: %s\n' "$*" >&2; }

# Runs a command silently; what it printed is shown if it fails.
quiet() { "$@" >"$scratch/build.log" 2>&1 || { cat "$scratch/build.log" >&2; exit 1; }; }

# ---- build: the sdist from the checkout, the wheel from the unpacked sdist ----------------------------------------------
# The backend and its tools are in the lock, so nothing is fetched past the hashes.
quiet "$PYTHON" -m build --sdist --no-isolation --outdir "$scratch/dist" .
sdists=("$scratch"/dist/*.tar.gz)
mkdir "$scratch/source"
tar -xzf "${sdists[0]}" --strip-components=1 -C "$scratch/source"

"$PYTHON" -m venv "$scratch/env"
pip=("$scratch/env/bin/python" -m pip --disable-pip-version-check)
"${pip[@]}" install --quiet --require-hashes -r requirements.txt
quiet "${pip[@]}" wheel --no-deps --no-build-isolation --wheel-dir "$scratch/dist" "$scratch/source"
wheels=("$scratch"/dist/*.whl)
say "$(basename "${sdists[0]}") $(du -h "${sdists[0]}" | cut -f1), $(basename "${wheels[0]}") $(du -h "${wheels[0]}" | cut -f1)"

# The sdist holds all of the checkout's package; the wheel has the kernels compiled in the place of their sources, and
# nothing else but metadata.
diff <(git ls-files rwa_monitor CMakeLists.txt | sort) \
  <(cd "$scratch/source" && find rwa_monitor CMakeLists.txt -type f | sort) \
  || { say "FAILED: the sdist does not hold the files of rwa_monitor/"; exit 1; }
diff <({ git ls-files rwa_monitor | grep -vE '^rwa_monitor/kernels/(onboard/|.*\.[ch]pp$)'; echo "rwa_monitor/kernels/_kernels.so"; } | sort) \
  <("$PYTHON" -m zipfile -l "${wheels[0]}" | awk 'NR > 1 && $1 !~ /dist-info/ {print $1}' \
    | sed 's|/_kernels\.[^/]*\.so$|/_kernels.so|' | sort) \
  || { say "FAILED: the wheel does not hold the files of rwa_monitor/ and its compiled kernels"; exit 1; }

# ---- install ---------------------------------------------------------------------------------------------------------
"${pip[@]}" install --quiet --no-deps "${wheels[0]}"
"${pip[@]}" check

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

# ---- use: from a folder without the checkout ---------------------------------------------------------------
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

# ---- from source: the kernels that the wheel was built with are there, and are not compiled again -----------------------
quiet "${pip[@]}" uninstall --yes rwa-monitor
quiet "${pip[@]}" install --no-deps --no-build-isolation "$scratch/source"
[[ "$(rwa-monitor --version)" == "rwa-monitor $version" ]] || { say "FAILED: $(rwa-monitor --version) from source is not $version"; exit 1; }
rwa-monitor diagnose day.csv --json | cmp - day.json || { say "FAILED: installed from source it diagnoses otherwise"; exit 1; }
say "installed from source, diagnosed the same"
