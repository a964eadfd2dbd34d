#!/usr/bin/env bash
# Builds the image and runs the three containers of compose.yaml on a machine without a Docker daemon and without an
# image registry: a Debian base from packages stands in for the base image, and the same Zenoh library in router mode,
# with the same router.json5, for the router's image. Root, and Debian's packages buildah, podman, runc and debootstrap.
#
#   docker/try_without_daemon.sh [SECONDS]      how long the monitor runs; 60 unless told, in which two windows close
#
# Everything it makes lies in one scratch folder (SCRATCH, a temporary one unless told) and is removed at the end; with
# KEEP=1 the base and the image stay in SCRATCH and are used again.
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
seconds="${1:-60}"
scratch="${SCRATCH:-$(mktemp -d -t rwa-monitor-docker.XXXXXX)}"
rm -rf "$scratch/recordings" "$scratch/certificates"
mkdir -p "$scratch/recordings"

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
  for name in simulator monitor router; do pod rm --force --ignore --time 3 "rwa-$name" >/dev/null 2>&1 || true; done
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

user="$(run --rm --network none --entrypoint id rwa-monitor -u)"
[[ "$user" == 10001 ]] || fail "runs as user $user, not as 10001"
run --rm --network none rwa-monitor --help >/dev/null || fail "rwa-monitor --help"
say "built; runs as user $user; --help answers"

# ---- router, simulator, monitor --------------------------------------------------------------------------------------
# The arguments are read from compose.yaml, so that what is tried is what is shipped.
arguments() {
  "${PYTHON:-python3}" -c '
import sys, yaml
print("\n".join(yaml.safe_load(open("docker/compose.yaml"))["services"][sys.argv[1]]["command"]))' "$1"
}
mapfile -t simulate < <(arguments simulator)
mapfile -t monitor < <(arguments monitor)
((${#simulate[@]} && ${#monitor[@]})) || fail "no arguments in docker/compose.yaml (PyYAML missing?)"

router_py='
import signal, sys, zenoh
with zenoh.open(zenoh.Config.from_file("/etc/zenoh/router.json5")):
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    print("router is up", flush=True)
    signal.pause()
'
# All three share the router's network, which has only a loopback: the name "router" leads there.
printf '127.0.0.1 localhost router\n' >"$scratch/hosts"
on_bus=(--volume "$scratch/hosts:/etc/hosts:ro")
docker/make_certificates.sh --owner 10001:10001 "$scratch/certificates"
own() { printf '%s' "--volume=$scratch/certificates/$1:/etc/rwa-monitor/tls:ro"; }
on_bus+=(--volume "$PWD/docker/client.json5:/etc/rwa-monitor/client.json5:ro")
run --detach --name rwa-router --network none "${on_bus[@]}" "$(own router)" \
  --volume "$PWD/docker/router.json5:/etc/zenoh/router.json5:ro" --entrypoint python3 rwa-monitor -c "$router_py" >/dev/null
for _ in {1..50}; do
  pod logs rwa-router 2>/dev/null | grep -q "router is up" && break
  sleep 0.2
done

chown 10001:10001 "$scratch/recordings"
on_bus+=(--network container:rwa-router)
run --detach --name rwa-monitor "${on_bus[@]}" "$(own monitor)" --volume "$scratch/recordings:/recordings" \
  rwa-monitor "${monitor[@]}" >/dev/null
run --detach --name rwa-simulator "${on_bus[@]}" "$(own simulated.wheel_1)" \
  --volume "$PWD/docker/scenario.toml:/etc/rwa-monitor/scenario.toml:ro" rwa-monitor "${simulate[@]}" >/dev/null
say "router, simulator and monitor run for $seconds s"
sleep "$seconds"

for name in router simulator monitor; do
  [[ "$(pod inspect --format '{{.State.Running}}' "rwa-$name")" == true ]] \
    || { pod logs --tail 20 "rwa-$name" >&2; fail "the $name ended by itself"; }
done

# ---- a clean stop, and a recording that replays ----------------------------------------------------------------------
began=$(date +%s%N)
pod stop --time 10 rwa-monitor >/dev/null
took_ms=$((($(date +%s%N) - began) / 1000000))
status="$(pod inspect --format '{{.State.ExitCode}}' rwa-monitor)"
[[ "$status" == 0 ]] || { pod logs --tail 20 rwa-monitor >&2; fail "the monitor ended with $status on SIGTERM"; }
say "the monitor stopped on SIGTERM within $took_ms ms, the container's own time included"

mapfile -t files < <(find "$scratch/recordings" -name '*.mcap' -size +0 | sort)
((${#files[@]})) || { pod logs --tail 20 rwa-monitor >&2; fail "nothing was recorded"; }
# As one chain; read-only, as for a recording that somebody else keeps.
run --rm --network none --volume "$scratch/recordings:/recordings:ro" rwa-monitor replay /recordings --verify \
  || { pod logs --tail 20 rwa-monitor rwa-simulator >&2; fail "replay --verify"; }
say "passed: ${#files[@]} recording(s) replayed and verified"
