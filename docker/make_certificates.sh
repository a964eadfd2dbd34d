#!/usr/bin/env bash
# Makes certificates for trying the secured bus: an authority of its own, and for each name a folder with ca.pem,
# own.pem and own.key, which is what router.json5 and client.json5 look for in /etc/rwa-monitor/tls.
#
#   docker/make_certificates.sh [--days N] [--host NAME]... [--owner UID:GID] FOLDER [NAME]...
#
#   FOLDER          made anew; nothing in it is ever overwritten
#   NAME            the common name, by which access_control in router.json5 distinguishes them;
#                   by default those of compose.yaml: monitor_1 monitor_2 dashboard simulated.wheel_1
#                   simulated.wheel_2. "router" is always made.
#   --days N        how long the certificates are valid; 30 by default. The authority lives as long.
#   --host NAME     a further name or IPv4 address under which the router is reached
#   --owner UID:GID who may read the private keys (needs root); 10001:10001 is the user of the image
#
# With the authority's key anybody can make themselves a wheel: keep FOLDER/authority offline, or delete it.
set -euo pipefail
umask 077

usage() { sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}" >&2; exit 2; }
wrong() { printf 'make_certificates: %s\n' "$*" >&2; exit 2; }

days=30
owner=
hosts=(router localhost 127.0.0.1)
while [[ "${1:-}" == -* ]]; do
  (($# >= 2)) || usage
  case "$1" in
    --days) days="$2" ;;
    --host) hosts+=("$2") ;;
    --owner) owner="$2" ;;
    *) usage ;;
  esac
  shift 2
done
(($#)) || usage
folder="$1"
shift
names=("$@")
((${#names[@]})) || names=(monitor_1 monitor_2 dashboard simulated.wheel_1 simulated.wheel_2)

command -v openssl >/dev/null || wrong "openssl is missing"
[[ "$days" =~ ^[1-9][0-9]{0,4}$ ]] || wrong "--days $days is no number of days"
for host in "${hosts[@]}"; do
  [[ "$host" =~ ^[A-Za-z0-9][A-Za-z0-9.-]{0,252}$ ]] || wrong "--host $host is no host name"
done
for name in "${names[@]}"; do
  # The name becomes a folder and a line of a certificate: nothing that means something there.
  [[ "$name" =~ ^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$ && "$name" != authority ]] || wrong "$name is no name of letters, digits and _.-"
done
[[ ! -e "$folder" && ! -L "$folder" ]] || wrong "$folder exists already; nothing is overwritten"
mkdir -p "$(dirname "$folder")"
mkdir "$folder"

new_key() { openssl genpkey -quiet -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out "$1"; }

# The authority may sign certificates and nothing else, and none that signs others.
mkdir "$folder/authority"
new_key "$folder/authority/ca.key"
openssl req -new -x509 -sha256 -days "$days" -key "$folder/authority/ca.key" -out "$folder/authority/ca.pem" \
  -subj "/CN=rwa-monitor test authority" -addext "basicConstraints=critical,CA:TRUE,pathlen:0" \
  -addext "keyUsage=critical,keyCertSign,cRLSign"

issue() { # NAME PURPOSE [NAMES_OF_THE_HOST]
  local own="$folder/$1" extensions
  mkdir "$own"
  new_key "$own/own.key"
  extensions="$(printf '%s\n' "basicConstraints=critical,CA:FALSE" "keyUsage=critical,digitalSignature" \
    "extendedKeyUsage=$2" ${3:+"subjectAltName=$3"})"
  openssl req -new -sha256 -key "$own/own.key" -subj "/CN=$1" |
    openssl x509 -req -sha256 -days "$days" -CA "$folder/authority/ca.pem" -CAkey "$folder/authority/ca.key" \
      -set_serial "0x$(openssl rand -hex 16)" -extfile <(printf '%s\n' "$extensions") -out "$own/own.pem" 2>/dev/null
  cp "$folder/authority/ca.pem" "$own/ca.pem"
  chmod 600 "$own/own.key"
  chmod 644 "$own/own.pem" "$own/ca.pem"
  chmod 755 "$own"
  [[ -z "$owner" ]] || chown "$owner" "$own/own.key"
}

alternatives=
for host in "${hosts[@]}"; do
  kind=DNS
  [[ "$host" =~ ^[0-9.]+$ ]] && kind=IP
  alternatives+="${alternatives:+,}$kind:$host"
done
# A leaf's certificate is good for a client only: with it nobody can pose as the router.
issue router serverAuth "$alternatives"
for name in "${names[@]}"; do
  [[ "$name" == router ]] || issue "$name" clientAuth
done
chmod 755 "$folder"
printf 'make_certificates: %s for router %s, valid for %s days; lock away %s/authority\n' \
  "$folder" "${names[*]}" "$days" "$folder" >&2
