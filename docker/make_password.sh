#!/usr/bin/env bash
# Makes the password of compose.yaml's database, as the two files that its containers read:
#
#   docker/make_password.sh [--owner UID:GID] [--database-owner UID:GID] FOLDER
#
#   FOLDER                     made anew; nothing in it is ever overwritten
#   --owner UID:GID            who may read database_pgpass, a password file of PostgreSQL's clients (needs root);
#                              10001:10001 is the user of the image
#   --database-owner UID:GID   who may read database_password (needs root); 999:999 is postgres in PostgreSQL's image
#
# The password is 256 random bits, shown nowhere.
set -euo pipefail
umask 077

usage() { sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}" >&2; exit 2; }
wrong() { printf 'make_password: %s\n' "$*" >&2; exit 2; }

owner=
database_owner=
while [[ "${1:-}" == -* ]]; do
  (($# >= 2)) || usage
  case "$1" in
    --owner) owner="$2" ;;
    --database-owner) database_owner="$2" ;;
    *) usage ;;
  esac
  shift 2
done
(($# == 1)) || usage
folder="$1"

command -v openssl >/dev/null || wrong "openssl is missing"
[[ ! -e "$folder" && ! -L "$folder" ]] || wrong "$folder exists already; nothing is overwritten"
mkdir -p "$(dirname "$folder")"
mkdir "$folder"

password="$(openssl rand -hex 32)"
printf '%s' "$password" >"$folder/database_password"
# host:port:database:user:password; clients refuse the file unless it is its owner's alone.
printf '*:*:rwa:rwa:%s\n' "$password" >"$folder/database_pgpass"
[[ -z "$owner" ]] || chown "$owner" "$folder/database_pgpass"
[[ -z "$database_owner" ]] || chown "$database_owner" "$folder/database_password"
# The files are closed to others; the folder need not be, and the containers' users must get at them.
chmod 755 "$folder"
printf 'make_password: %s\n' "$folder" >&2
