"""The software bill of materials: every locked package is in it, with version, licence and the lock's hashes."""

import json
import re
from pathlib import Path

import pytest

from tools.sbom import bill_of_materials, locked, problem_in

ROOT = Path(__file__).parents[1]
LOCK = ROOT / "requirements.txt"


@pytest.mark.slow
def test_every_locked_package_is_in_it_with_version_licence_and_hashes() -> None:
    bom = bill_of_materials()
    text = json.dumps(bom)
    assert problem_in(text) is None
    components = {component["purl"]: component for component in bom["components"]}
    versions = locked(LOCK)
    assert len(components) == len(versions) > 30
    hashes = set(re.findall(r"--hash=sha256:([0-9a-f]{64})", LOCK.read_text(encoding="utf-8")))
    for name, number in versions.items():
        component = components[f"pkg:pypi/{name}@{number}"]
        assert component["licenses"], name
        of_lock = {
            entry["content"] for reference in component["externalReferences"] for entry in reference.get("hashes", [])
        }
        assert of_lock, name
        assert of_lock <= hashes
    root = bom["metadata"]["component"]
    assert (root["name"], root["licenses"][0]["license"]["id"]) == ("rwa-monitor", "Apache-2.0")
    (direct,) = (entry["dependsOn"] for entry in bom["dependencies"] if entry["ref"] == root["bom-ref"])
    assert {"numpy", "pydantic", "eclipse-zenoh"} <= {ref.split("==")[0] for ref in direct}
    refs = {component["bom-ref"] for component in components.values()}
    assert {ref for entry in bom["dependencies"] for ref in entry["dependsOn"]} <= refs


def test_what_is_no_bill_is_noticed() -> None:
    assert problem_in('{"bomFormat": "CycloneDX"}') is not None


def test_an_installation_that_is_not_the_locked_one_is_refused(tmp_path: Path) -> None:
    (tmp_path / "lock.txt").write_text("numpy==1.0.0 \\\n    --hash=sha256:" + "0" * 64 + "\n")
    with pytest.raises(SystemExit, match=r"numpy: what is installed is not what lock\.txt says"):
        bill_of_materials(tmp_path / "lock.txt")


def test_packages_of_other_platforms_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "lock.txt").write_text(
        'colorama==0.4.6 ; sys_platform == "win32" \\\n    --hash=sha256:0\nnumpy==2.0 \\\n    --hash=sha256:0\n'
    )
    assert locked(tmp_path / "lock.txt") == {"numpy": "2.0"}
