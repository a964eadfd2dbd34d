#!/usr/bin/env bash
# Prints the Python that the environment is made with: the first on the PATH that is new enough and can make one.
# PYTHON=/path/to/python decides for itself.
set -u

good='import sys, venv, ensurepip; sys.exit(not (3, 11) <= sys.version_info[:2])'

for candidate in "${PYTHON:-}" python3 python3.13 python3.12 python3.11 python3.14 python; do
  [ -n "$candidate" ] || continue
  if command -v "$candidate" >/dev/null 2>&1 && "$candidate" -c "$good" >/dev/null 2>&1; then
    command -v "$candidate"
    exit 0
  fi
  if [ "$candidate" = "${PYTHON:-}" ]; then
    echo "rwa-monitor: PYTHON=$PYTHON is not a Python 3.11 or newer with venv" >&2
    exit 2
  fi
done

{
  echo "rwa-monitor needs Python 3.11 or newer with its venv module, and found none on the PATH."
  echo "On Debian and Ubuntu: apt-get install python3-venv; elsewhere see python.org. Or say PYTHON=/path/to/python3."
} >&2
exit 2
