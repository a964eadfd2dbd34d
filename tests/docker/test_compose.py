"""The containers as compose.yaml has them: each may do little, none shares who it is, and the parts fit each other.

Only the files are read here; docker/try_without_daemon.sh builds the image and runs all of it.
"""

import json
import os
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import pytest
import yaml
import zenoh

from tests.program import run
from tests.security.rig import DOCKER, make_certificates

TEXT: Final = (DOCKER / "compose.yaml").read_text(encoding="utf-8")
COMPOSE: Final[dict[str, Any]] = yaml.safe_load(TEXT)
SERVICES: Final[dict[str, dict[str, Any]]] = COMPOSE["services"]
# What an image is named by: a variable that may name another, and its name, tag and digest.
PINNED: Final = re.compile(r"\$\{([A-Z]+)_IMAGE:-([a-z/]+):([0-9][a-z0-9.-]*)@(sha256:[0-9a-f]{64})\}")
OURS: Final = [name for name, service in SERVICES.items() if service["image"] == "rwa-monitor"]


def of_command(command: str) -> list[str]:
    return [name for name in OURS if SERVICES[name]["command"][0] == command]


def option(name: str, wanted: str) -> str | None:
    words = SERVICES[name]["command"]
    return words[words.index(wanted) + 1] if wanted in words else None


def volumes(name: str) -> dict[str, str]:
    """Return where what is mounted: the source by the target."""
    return {volume.split(":")[1]: volume.split(":")[0] for volume in SERVICES[name]["volumes"]}


# ---- each container may do little ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SERVICES)
def test_a_container_may_do_little(name: str) -> None:
    service = SERVICES[name]
    assert service["read_only"] is True
    assert (service["cap_drop"], service["security_opt"]) == (["ALL"], ["no-new-privileges:true"])
    assert service.keys().isdisjoint({"cap_add", "privileged"})
    assert all({"noexec", "nosuid", "nodev"} < set(tmpfs.split(":")[1].split(",")) for tmpfs in service["tmpfs"])
    assert re.fullmatch(r"[1-9][0-9]*:[1-9][0-9]*", service["user"])  # not root, and a number
    assert re.fullmatch(r"[1-9][0-9]*[mg]", service["mem_limit"])
    assert service["pids_limit"] > 0
    assert service["healthcheck"]["test"][0] in ("CMD", "CMD-SHELL")
    assert {"interval", "timeout", "retries", "start_period"} < service["healthcheck"].keys()
    assert all(port.startswith("127.0.0.1:") for port in service.get("ports", []))
    # The page is bound to loopback by the program itself; nothing else sees the machine's own network.
    assert service.get("network_mode") == ("host" if name == "dashboard" else None)
    # Its configuration cannot be changed by it.
    assert all(volume.endswith(":ro") for volume in service["volumes"] if volume.startswith("."))
    assert PINNED.fullmatch(service["build"]["args"]["BASE"] if name in OURS else service["image"])


def test_user_and_base_of_the_image_are_those_that_compose_names() -> None:
    image = dict(re.findall(r"^(USER |ARG BASE=)(\S+)$", (DOCKER / "Dockerfile").read_text("utf-8"), re.MULTILINE))
    assert {SERVICES[name]["user"] for name in OURS} == {image["USER "]}
    assert SERVICES["monitor_1"]["build"]["args"]["BASE"] == f"${{PYTHON_IMAGE:-{image['ARG BASE=']}}}"


def test_the_command_that_pins_the_images_names_them_as_they_are() -> None:
    page = (DOCKER.parent / "docs" / "containers.md").read_text(encoding="utf-8")
    renewed = set(re.findall(r"([A-Z]+)=([a-z/]+:[0-9][a-z0-9.-]*)", page))
    assert renewed == {(variable, f"{image}:{tag}") for variable, image, tag, _ in PINNED.findall(TEXT)}


# ---- the parts fit each other ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", OURS)
def test_its_command_is_understood(name: str) -> None:
    """An option that the program does not have is refused before --help is answered."""
    words = SERVICES[name]["command"]
    answer = run(*words, "--help")
    assert answer.exit_code == 0, answer.output
    assert run(*words, "--no-such-option", "--help").exit_code == 2  # the control


def test_the_shards_are_complete_and_keep_their_recordings_apart() -> None:
    shards = sorted(str(option(name, "--shard")) for name in of_command("run"))
    assert shards == [f"{number}/{len(shards)}" for number in range(1, len(shards) + 1)]
    folders = [volumes(name)["/recordings"] for name in of_command("run")]
    assert len(set(folders)) == len(folders)
    assert set(folders) < set(COMPOSE["volumes"])


def test_a_monitor_is_healthy_by_the_file_that_it_touches() -> None:
    for name in of_command("run"):
        assert f"find {option(name, '--alive')} " in SERVICES[name]["healthcheck"]["test"][1]


def test_each_certificate_is_one_that_the_script_makes_and_the_router_knows(tmp_path: Path) -> None:
    made = make_certificates(tmp_path / "made")
    assert made.returncode == 0, made.stderr
    mounted = {name: volumes(name).get("/etc/rwa-monitor/tls") for name in SERVICES if name != "database"}
    assert len(set(mounted.values())) == len(mounted)
    names = {str(source).removeprefix("./certificates/") for source in mounted.values()}
    assert names == {folder.name for folder in (tmp_path / "made").iterdir()} - {"authority"}
    access = json.loads(zenoh.Config.from_file(DOCKER / "router.json5").get_json("access_control"))
    known = {common for subject in access["subjects"] for common in subject["cert_common_names"]}
    assert names - {"router"} <= known
    # A wheel publishes under the name in its certificate.
    for name in of_command("simulate"):
        key = option(name, "--key") or "rwa/simulated/wheel_1/samples"
        assert mounted[name] == "./certificates/" + ".".join(key.split("/")[1:3])


# ---- the password ----------------------------------------------------------------------------------------------------


def make_password(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([DOCKER / "make_password.sh", folder], capture_output=True, text=True, check=False)


def test_the_password_stands_in_the_secret_files_only(tmp_path: Path) -> None:
    done = make_password(tmp_path / "secrets")
    assert done.returncode == 0, done.stderr
    files = {path.name: path for path in (tmp_path / "secrets").iterdir()}
    assert set(files) == set(COMPOSE["secrets"])
    assert {secret["file"] for secret in COMPOSE["secrets"].values()} == {f"./secrets/{name}" for name in files}
    assert {stat.S_IMODE(path.stat().st_mode) for path in files.values()} == {0o600}
    password = files["database_password"].read_text(encoding="utf-8")
    assert re.fullmatch(r"[0-9a-f]{64}", password)
    assert files["database_pgpass"].read_text(encoding="utf-8") == f"*:*:rwa:rwa:{password}\n"
    assert password not in done.stdout + done.stderr
    # Nobody has both files, and neither a command nor the environment holds a password.
    assert SERVICES["dashboard"]["secrets"] == ["database_pgpass"]
    assert SERVICES["database"]["secrets"] == ["database_password"]
    assert "://rwa@" in str(option("dashboard", "--history"))
    settings = [key for service in SERVICES.values() for key in service.get("environment", {})]
    assert [key for key in settings if "PASSWORD" in key] == ["POSTGRES_PASSWORD_FILE"]


def test_no_password_is_overwritten_or_the_same_twice(tmp_path: Path) -> None:
    assert make_password(tmp_path / "one").returncode == make_password(tmp_path / "two").returncode == 0
    before = (tmp_path / "one" / "database_password").read_bytes()
    assert before != (tmp_path / "two" / "database_password").read_bytes()
    again = make_password(tmp_path / "one")
    assert again.returncode == 2
    assert "exists already" in again.stderr
    assert (tmp_path / "one" / "database_password").read_bytes() == before


# ---- other tools -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tool", ["podman-compose", "docker-compose", "hadolint"])
def test_a_tool_that_is_there_finds_nothing_wrong(tool: str) -> None:
    # hadolint comes with the environment of the tests, which need not be the shell's.
    found = shutil.which(tool, path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    if found is None:
        pytest.skip(f"no {tool}: {'make venv' if tool == 'hadolint' else f'apt-get install {tool}'}")
    arguments = ["Dockerfile"] if tool == "hadolint" else ["-f", "compose.yaml", "config"]
    done = subprocess.run(
        [found, *arguments], cwd=DOCKER, capture_output=True, text=True, check=False, env={"PATH": os.environ["PATH"]}
    )
    assert done.returncode == 0, done.stdout + done.stderr
