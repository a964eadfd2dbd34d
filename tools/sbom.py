"""Writes the software bill of materials (CycloneDX) of the program from the lock file and the installed packages.

    python -m tools.sbom -o build/sbom.json

It lists each package of requirements.txt for this platform, with version, licences, dependencies, and the hashes that
the lock allows. It needs no network: hashes are from the lock, all else is metadata of installed packages. The result
is valid by the schema of CycloneDX, and the same on the same installation.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
SCHEMA = SchemaVersion.V1_6
Bom = dict[str, Any]


def locked(lock: Path) -> dict[str, str]:
    """Return name → version of the packages in a lock that belong on this platform."""
    lines = (line.split("--hash")[0].rstrip("\\ ") for line in lock.read_text(encoding="utf-8").splitlines())
    requirements = [Requirement(line) for line in lines if line and line[0].isalnum()]
    return {
        canonicalize_name(requirement.name): next(iter(requirement.specifier)).version
        for requirement in requirements
        if requirement.marker is None or requirement.marker.evaluate()
    }


def bill_of_materials(lock: Path = ROOT / "requirements.txt") -> Bom:
    """Return the bill of materials; raises SystemExit where installed packages differ from the lock."""
    wanted = locked(lock)
    pyproject = ("--pyproject", str(ROOT / "pyproject.toml"))
    bom = _generated("environment", sys.executable, *pyproject)
    of_lock = {canonicalize_name(entry["name"]): entry for entry in _generated("requirements", str(lock))["components"]}
    installed = {canonicalize_name(entry["name"]): entry for entry in bom["components"]}
    missing = [name for name, number in wanted.items() if installed.get(name, {}).get("version") != number]
    if missing:
        raise SystemExit(f"{', '.join(missing)}: what is installed is not what {lock.name} says; run make venv")
    components = [installed[name] for name in sorted(wanted)]
    for component in components:
        distribution = of_lock[canonicalize_name(component["name"])]["externalReferences"]
        component["externalReferences"] = [*component.get("externalReferences", []), *distribution]
    root = bom["metadata"]["component"]
    root["version"] = version("rwa-monitor")
    kept = {component["bom-ref"] for component in components} | {root["bom-ref"]}
    bom["components"] = components
    bom["dependencies"] = [
        {**entry, "dependsOn": [ref for ref in entry.get("dependsOn", []) if ref in kept]}
        for entry in bom["dependencies"]
        if entry["ref"] in kept
    ]
    return bom


def _generated(*arguments: str) -> Bom:
    """Return what the generator of CycloneDX prints."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bom.json"
        options = ("--output-reproducible", "--no-validate", "--sv", SCHEMA.to_version(), "-o", str(file))
        done = subprocess.run(
            [sys.executable, "-m", "cyclonedx_py", *arguments, *options], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise SystemExit(f"cyclonedx_py {' '.join(arguments)}: {done.stderr}")
        bom: Bom = json.loads(file.read_text(encoding="utf-8"))
        return bom


def problem_in(text: str) -> str | None:
    """Return what the schema of CycloneDX finds wrong with a bill of materials."""
    error = JsonStrictValidator(SCHEMA).validate_str(text)
    return None if error is None else str(error)


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the software bill of materials.")
    parser.add_argument("-o", "--output", type=Path, required=True)
    output: Path = parser.parse_args().output
    text = json.dumps(bill_of_materials(), indent=1, sort_keys=True) + "\n"
    if (problem := problem_in(text)) is not None:
        raise SystemExit(f"the bill of materials is not valid: {problem}")
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(text, encoding="utf-8")
    print(f"{len(json.loads(text)['components'])} packages in {output}, valid CycloneDX {SCHEMA.to_version()}")


if __name__ == "__main__":
    main()
