"""What the program states of its own source: of what is installed, and never of something else."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import rwa_monitor

COMMIT = "0.1.0.post1.dev12+g8e3a56a12"
SOURCE = Path(rwa_monitor.__file__).parent


def said_by(package: Path, site: Path) -> str:
    """Return what a package states of itself when the site's metadata are the ones that Python finds."""
    path = os.pathsep.join([str(site), str(package.parent)])
    code = "from rwa_monitor import __version__; print(__version__)"
    command, environment = [sys.executable, "-S", "-P", "-c", code], os.environ | {"PYTHONPATH": path}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def installed(site: Path, version: str, *, editable: Path | None = None) -> None:
    """Write the metadata that pip leaves behind; copy the package too, unless it is used where it is."""
    info = site / f"rwa_monitor-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.4\nName: rwa-monitor\nVersion: {version}\n", encoding="utf-8")
    if editable is not None:
        origin = {"url": editable.as_uri(), "dir_info": {"editable": True}}
        (info / "direct_url.json").write_text(json.dumps(origin), encoding="utf-8")
        return
    (site / "rwa_monitor").mkdir()
    shutil.copy(SOURCE / "__init__.py", site / "rwa_monitor")


@pytest.mark.parametrize("version", ["0.1.0", COMMIT])
def test_what_is_installed_states_its_commit(tmp_path: Path, version: str) -> None:
    installed(tmp_path, version)
    assert said_by(tmp_path / "rwa_monitor", tmp_path) == version


@pytest.mark.parametrize(("version", "says"), [("0.1.0", "0.1.0+editable"), (COMMIT, f"{COMMIT}.editable")])
def test_what_may_have_changed_since_states_it(tmp_path: Path, version: str, says: str) -> None:
    installed(tmp_path, version, editable=SOURCE.parent)
    assert said_by(SOURCE, tmp_path) == says


def test_the_version_of_another_folder_is_not_claimed(tmp_path: Path) -> None:
    (tmp_path / "a folder").mkdir()
    installed(tmp_path / "site", COMMIT, editable=tmp_path / "a folder")
    assert said_by(SOURCE, tmp_path / "site") == "0+unknown"
