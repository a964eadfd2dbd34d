#!/usr/bin/env bash
# Builds the image and runs all containers of compose.yaml on a machine without a Docker daemon and without an image
# registry. What stands in for what cannot be pulled: a Debian base from packages for the base image, the same Zenoh
# library in router mode, with the same router.json5, for the router's image, and Debian's PostgreSQL for that of the
# database. Commands, users, health checks, limits and mounts are read from compose.yaml. Root, and Debian's packages
# buildah, podman, runc, debootstrap and python3-yaml (or PYTHON with PyYAML).
#
#   docker/try_without_daemon.sh [SECONDS]      how long the monitors run; 60 by default, in which two windows close
#
# Everything it makes lies in one scratch folder (SCRATCH, a temporary one by default) and is removed at the end; with
# KEEP=1 the base and the image stay in SCRATCH and are used again.
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
seconds="${1:-60}"
scratch="${SCRATCH:-$(mktemp -d -t rwa-monitor-docker.XXXXXX)}"
rm -rf "$scratch"/{recordings_1,recordings_2,history,certificates,secrets}
mkdir -p "$scratch"/{recordings_1,recordings_2,history}

say() { printf 'docker: %s\n' "$*" >&2; }
fail() { say "FAILED: $*"; exit 1; }

for tool in buildah podman runc debootstrap; do
  command -v "$tool" >/dev/null || { say "$tool is missing: apt-get install buildah podman runc debootstrap"; exit 2; }
done
(($(id -u) == 0)) || { say "debootstrap and the containers need root"; exit 2; }

# An own store, so that nothing here meets the images and containers of whoever runs this. Overlays are quick but do not
# work inside every sandbox; plain copies always do.
store=(--root "$scratch/probe" --runroot "$scratch/probe-run" --storage-driver overlay)
driver=vfs
if buildah "${store[@]}" mount "$(buildah "${store[@]}" from scratch)" >/dev/null 2>&1; then driver=overlay; fi
buildah "${store[@]}" rm --all >/dev/null 2>&1 || true
store=(--root "$scratch/store-$driver" --runroot "$scratch/run" --storage-driver "$driver")
build() { buildah "${store[@]}" "$@"; }
pod() { podman "${store[@]}" --runtime runc --cgroup-manager cgroupfs --events-backend file "$@"; }
# No health check: podman keeps its time with systemd, which a sandbox does not have.
# Limits of its own: those that podman sets unasked may lie above what a sandbox allows.
run() { pod run --ulimit nofile=4096:4096 --ulimit nproc=4096:4096 --no-healthcheck --pull never "$@"; }

cleanup() {
  # One by one, the router last: podman removes none of a list in which one is missing, nor one whose network is in use.
  for name in wheel_1 wheel_2 monitor_1 monitor_2 dashboard database router; do
    pod rm --force --ignore --volumes --time 3 "rwa-$name" >/dev/null 2>&1 || true
  done
  [[ -n "${KEEP:-}" ]] || { build rmi --all --force >/dev/null 2>&1 || true; rm -rf "$scratch"; }
}
trap cleanup EXIT

# ---- the base --------------------------------------------------------------------------------------------------------
base=localhost/rwa-monitor-base
if ! build inspect --type image "$base" >/dev/null 2>&1; then
  say "making a base from Debian's packages"
  debootstrap --variant=minbase --include=python3,python3-venv,ca-certificates bookworm "$scratch/base" >"$scratch/base.log"
  rm -rf "$scratch"/base/var/cache/apt/archives/*.deb
  # The certificates this machine trusts, for pip: a network that inspects its traffic is then no obstacle.
  cp /etc/ssl/certs/ca-certificates.crt "$scratch/base/etc/ssl/certs/ca-certificates.crt"
  printf '[global]\ncert = /etc/ssl/certs/ca-certificates.crt\n' >"$scratch/base/etc/pip.conf"
  container="$(build from scratch)"
  build add --quiet "$container" "$scratch/base" / >/dev/null
  build config --env PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$container"
  build commit --quiet --rm "$container" "$base" >/dev/null
  rm -rf "$scratch/base"
fi

# ---- the image -------------------------------------------------------------------------------------------------------
say "building docker/Dockerfile"
build bud --isolation chroot --pull-never --format docker --layers --build-arg BASE="$base" \
  --ignorefile .dockerignore --file docker/Dockerfile --tag rwa-monitor . >"$scratch/build.log" 2>&1 \
  || { tail -n 30 "$scratch/build.log" >&2; fail "the build"; }

# PostgreSQL as its image has it: programs in the PATH, 999 as the user, a folder for its socket.
database_image=localhost/rwa-monitor-postgresql
if ! build inspect --type image "$database_image" >/dev/null 2>&1; then
  say "making an image of Debian's PostgreSQL"
  container="$(build from --pull-never "$base")"
  # shellcheck disable=SC2016
  build run --isolation chroot "$container" -- sh -c '
    set -e
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq && apt-get install -qq --no-install-recommends postgresql >/dev/null
    useradd --uid 999 --user-group --no-create-home database
    install -d -o database -g database -m 3777 /var/run/postgresql
    ln -s /usr/lib/postgresql/*/bin/* /usr/local/bin/
    apt-get clean; rm -rf /var/lib/apt/lists/*' >"$scratch/postgresql.log" 2>&1 \
    || { tail -n 20 "$scratch/postgresql.log" >&2; fail "the image of the database"; }
  build commit --quiet --rm "$container" "$database_image" >/dev/null
fi

user="$(run --rm --network none --entrypoint id rwa-monitor -u)"
[[ "$user" == 10001 ]] || fail "runs as user $user, not as 10001"
run --rm --network none --read-only --cap-drop all rwa-monitor --help >/dev/null || fail "rwa-monitor --help"
say "built; runs as user $user; --help answers"

# ---- what compose.yaml has of a service, one word a line ------------------------------------------------------------
# So that what is tried is what is shipped. Volumes with a name are folders in the scratch folder, and so are certificates
# and secrets.
compose() { # command|health|options SERVICE
  "${PYTHON:-python3}" - "$scratch" "$@" <<'END'
import re, sys, yaml
scratch, what, name = sys.argv[1:]
text = open("docker/compose.yaml", encoding="utf-8").read()
service = yaml.safe_load(re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", text))["services"][name]
if what == "command":
    words = service["command"]
elif what == "health":
    kind, *words = service["healthcheck"]["test"]
    words = ["sh", "-c", *words] if kind == "CMD-SHELL" else words
else:
    words = [f"--user={service['user']}", f"--memory={service['mem_limit']}", f"--pids-limit={service['pids_limit']}"]
    words += ["--read-only", "--read-only-tmpfs=false"] if service["read_only"] else []
    words += [f"--cap-drop={one}" for one in service["cap_drop"]]
    words += [f"--security-opt={one.split(':')[0]}" for one in service["security_opt"]]
    words += [f"--tmpfs={one}" for one in service["tmpfs"]]
    words += [f"--env={key}={value}" for key, value in service.get("environment", {}).items()]
    words += [f"--volume={scratch}/secrets/{one}:/run/secrets/{one}:ro" for one in service.get("secrets", [])]
    for volume in service["volumes"]:
        source, target = volume.removeprefix("./").split(":", 1)
        folder = "docker" if source.endswith((".json5", ".toml")) else scratch
        words.append(f"--volume={folder}/{source}:{target}")
print("\n".join(words))
END
}

start() { # SERVICE IMAGE [ENTRYPOINT ARGUMENT...]; without them what compose.yaml has
  local name="$1" image="$2" options arguments entrypoint=()
  mapfile -t options < <(compose options "$name" | sed "s#^--volume=docker/#--volume=$PWD/docker/#" | grep -v "$unlimited")
  ((${#options[@]})) || fail "no options for $name in docker/compose.yaml (PyYAML missing?)"
  if (($# > 2)); then
    entrypoint=(--entrypoint "$3")
    arguments=("${@:4}")
  else
    mapfile -t arguments < <(compose command "$name")
  fi
  # All share the router's network, which has only a loopback: the name "router" leads there.
  local network=container:rwa-router
  [[ "$name" != router ]] || network=none
  run --detach --name "rwa-$name" --network "$network" --volume "$scratch/hosts:/etc/hosts:ro" "${options[@]}" \
    "${entrypoint[@]}" "$image" "${arguments[@]}" >/dev/null || fail "the start of $name"
}

healthy() { # SERVICE SECONDS: until its health check in compose.yaml passes
  local name="$1" test until=$((SECONDS + $2))
  mapfile -t test < <(compose health "$name")
  until pod exec "rwa-$name" "${test[@]}" >/dev/null 2>&1; do
    ((SECONDS < until)) || { pod logs --tail 20 "rwa-$name" >&2; fail "$name is not healthy after $2 s"; }
    sleep 1
  done
  say "$name is healthy"
}

ill() { # SERVICE SECONDS: until its health check fails
  local name="$1" test until=$((SECONDS + $2))
  mapfile -t test < <(compose health "$name")
  while pod exec "rwa-$name" "${test[@]}" >/dev/null 2>&1; do
    ((SECONDS < until)) || fail "the health check of $name still passes after $2 s"
    sleep 1
  done
}

# ---- all containers --------------------------------------------------------------------------------------------------
docker/make_certificates.sh --owner 10001:10001 "$scratch/certificates"
docker/make_password.sh --owner 10001:10001 --database-owner 999:999 "$scratch/secrets"
chown 10001:10001 "$scratch"/recordings_{1,2}
chown 999:999 "$scratch/history"
printf '127.0.0.1 localhost router\n' >"$scratch/hosts"
unlimited=NONE
if ! run --rm --network none --memory 64m --pids-limit 64 --entrypoint id rwa-monitor >/dev/null 2>"$scratch/limits.log"; then
  unlimited='^--\(memory\|pids-limit\)='
  say "NOT TRIED: limits of memory and processes, which this machine does not let containers have"
fi

router_py='
import signal, sys, zenoh
with zenoh.open(zenoh.Config.from_file("/etc/zenoh/router.json5")):
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    signal.pause()
'
# What the image of PostgreSQL does at its first start.
# shellcheck disable=SC2016
database_sh='
  set -e
  data=/var/lib/postgresql/data
  initdb -D "$data" -U "$POSTGRES_USER" --pwfile "$POSTGRES_PASSWORD_FILE" --auth scram-sha-256 --locale C.UTF-8 >/tmp/log
  echo "CREATE DATABASE $POSTGRES_DB;" | postgres --single -D "$data" postgres >>/tmp/log
  exec postgres -D "$data" -c listen_addresses=127.0.0.1 -c unix_socket_directories=/var/run/postgresql
'
start router rwa-monitor python3 -c "$router_py"
start database "$database_image" sh -c "$database_sh"
healthy router 60
healthy database 60
start dashboard rwa-monitor
start monitor_1 rwa-monitor
start monitor_2 rwa-monitor
healthy monitor_1 120
healthy monitor_2 120
start wheel_1 rwa-monitor
start wheel_2 rwa-monitor
healthy wheel_1 60
healthy wheel_2 60
healthy dashboard 60
all=(router database dashboard monitor_1 monitor_2 wheel_1 wheel_2)
say "all ${#all[@]} containers run for $seconds s"
sleep "$seconds"

for name in "${all[@]}"; do
  [[ "$(pod inspect --format '{{.State.Running}}' "rwa-$name")" == true ]] \
    || { pod logs --tail 20 "rwa-$name" >&2; fail "$name ended by itself"; }
  healthy "$name" 10
  pod exec "rwa-$name" grep -Eq '^[^ ]+ / [^ ]+ ro[, ]' /proc/mounts || fail "$name can write in its root"
  # shellcheck disable=SC2016
  pod exec "rwa-$name" sh -c '
    test "$(id -u)" != 0 && grep -q "^NoNewPrivs:[[:space:]]*1$" /proc/1/status &&
    ! grep -E "^Cap(Prm|Eff|Bnd|Amb):" /proc/1/status | grep -vq "0000000000000000$"' \
    || fail "$name is root, has a capability or can gain one"
done
say "all still run and are healthy; none is root, has a capability or can write in its root"

# ---- the page and its database ---------------------------------------------------------------------------------------
pod exec rwa-dashboard python3 -c '
import json, sys, urllib.request
for wheel in ("wheel_1", "wheel_2"):
    address = f"http://127.0.0.1:8750/api/wheels/simulated/{wheel}/windows"
    with urllib.request.urlopen(address, timeout=10) as answer:
        if "window_start_ns" not in answer.read().decode():
            sys.exit(f"the page has no window of {wheel}")
' || { pod logs --tail 20 rwa-dashboard >&2; fail "the page"; }
# shellcheck disable=SC2016
kept="$(pod exec rwa-database sh -c 'PGPASSWORD="$(cat /run/secrets/database_password)" psql -h 127.0.0.1 -U rwa -At \
  -F " " -c "SELECT wheel, count(*) FROM diagnoses GROUP BY wheel ORDER BY wheel"')" || fail "the database"
[[ "$kept" == wheel_1\ *wheel_2\ * ]] || fail "the database holds windows of: $kept"
pod exec rwa-database psql -h 127.0.0.1 -U rwa -w -c "SELECT 1" >/dev/null 2>&1 && fail "the database asks for no password"
say "the page shows both wheels; windows in the database: ${kept//$'\n'/, }"

# ---- health checks detect a monitor that stands still, a database that is gone ------------------------------------
pod kill --signal STOP rwa-monitor_1 >/dev/null
pod stop --time 10 rwa-database >/dev/null 2>&1
ill monitor_1 40
ill dashboard 40
pod kill --signal CONT rwa-monitor_1 >/dev/null
healthy monitor_1 40
say "a monitor that stood still and a page without its database were seen to be ill"

# ---- a clean stop, and recordings that replay ------------------------------------------------------------------------
stop_cleanly() { # SERVICE
  local began took_ms status
  began=$(date +%s%N)
  pod stop --time 10 "rwa-$1" >/dev/null
  took_ms=$((($(date +%s%N) - began) / 1000000))
  status="$(pod inspect --format '{{.State.ExitCode}}' "rwa-$1")"
  [[ "$status" == 0 ]] || { pod logs --tail 20 "rwa-$1" >&2; fail "$1 ended with $status on SIGTERM"; }
  say "$1 stopped on SIGTERM within $took_ms ms, the container's own time included"
}

replayed() { # SHARD WHEEL: its recordings as one chain, read-only as for somebody else's, hold that wheel and no other
  local folder="$scratch/recordings_$1" wheels
  run --rm --network none --volume "$folder:/recordings:ro" rwa-monitor replay /recordings --verify \
    || { pod logs --tail 20 "rwa-monitor_$1" >&2; fail "replay --verify of shard $1"; }
  wheels="$(run --rm --network none --volume "$folder:/recordings:ro" --entrypoint python3 rwa-monitor -c '
import pathlib
from mcap.reader import make_reader
found = set()
for path in pathlib.Path("/recordings").glob("*.mcap"):
    with path.open("rb") as file:
        found |= {c.topic.split("/")[2] for c in make_reader(file).get_summary().channels.values() if c.topic.endswith("/diagnosis")}
print(*sorted(found))')"
  [[ "$wheels" == "$2" ]] || fail "shard $1 diagnosed $wheels, not $2"
}

stop_cleanly monitor_1
stop_cleanly monitor_2
replayed 1 wheel_2
replayed 2 wheel_1
stop_cleanly dashboard
say "passed: both shards' recordings replayed and verified, each with its own wheel"
