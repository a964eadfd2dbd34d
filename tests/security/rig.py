"""A secured bus over real sockets: certificates by the script, a router in its own process, the shipped files."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import trustme

from rwa_monitor.monitor.bus import BusOptions
from tests.monitor.processes import ROUTER, script
from tests.monitor.support import free_port

DOCKER: Final = Path(__file__).parents[2] / "docker"
TLS_FOLDER: Final = "/etc/rwa-monitor/tls"  # where the shipped files look for certificates
PLACEHOLDER: Final = "0.0.0.0:7447"  # where the shipped router listens
NAMES: Final = ("monitor", "monitor_2", "dashboard", "simulated.wheel_1", "simulated.wheel_2", "somebody")


def make_certificates(folder: Path, *names: str) -> subprocess.CompletedProcess[str]:
    """Run the script that is shipped."""
    command = [str(DOCKER / "make_certificates.sh"), str(folder), *names]
    # In a locale that every machine has: bash warns of one that is not installed.
    environment = {**os.environ, "LC_ALL": "C"}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def certificates(folder: Path) -> Path:
    done = make_certificates(folder, *NAMES)
    assert done.returncode == 0, done.stderr
    return folder


def configured(shipped: str, own: Path, target: Path, **changes: str) -> Path:
    """Write a shipped configuration with another folder of certificates, and other changes."""
    text = (DOCKER / shipped).read_text(encoding="utf-8")
    for old, new in {TLS_FOLDER: str(own), **changes}.items():
        assert old in text
        text = text.replace(old, new)
    target.write_text(text, encoding="utf-8")
    return target


@contextmanager
def router(own: Path, scratch: Path) -> Iterator[int]:
    """Run the shipped router on a free port of loopback; gives the port."""
    port = free_port()
    config = configured("router.json5", own, scratch / f"router-{port}.json5", **{PLACEHOLDER: f"127.0.0.1:{port}"})
    with script(ROUTER, config.read_text(encoding="utf-8")):
        yield port


def leaf(own: Path, port: int, scratch: Path) -> BusOptions:
    """Return the bus options of a client with the certificate in `own`, by the shipped client configuration."""
    config = configured("client.json5", own, scratch / f"{own.parent.name}-{own.name}-{port}.json5")
    return BusOptions(config=config, connect=(f"tls/localhost:{port}",))


def issued(authority: Path, folder: Path, name: str, **terms: object) -> Path:
    """Make a folder with a certificate for `name` on other terms (expired, …), signed with an authority's key."""
    folder.mkdir()
    ca = trustme.CA.from_pem((authority / "ca.pem").read_bytes(), (authority / "ca.key").read_bytes())
    certificate = ca.issue_cert("localhost", common_name=name, **terms)  # type: ignore[arg-type]
    (folder / "own.key").write_bytes(certificate.private_key_pem.bytes())
    (folder / "own.pem").write_bytes(certificate.cert_chain_pems[0].bytes())
    (folder / "ca.pem").write_bytes((authority / "ca.pem").read_bytes())
    return folder
