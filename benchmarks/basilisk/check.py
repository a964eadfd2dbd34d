"""Judge Basilisk's records: the model of a wheel in motion must be adequate with its parameters, from rest it must not.

    python check.py FOLDER        # holds crossing.csv/.toml and rest.csv/.toml, made by record.py

Exit code 1 where a result differs.
"""

from __future__ import annotations

import sys
from pathlib import Path

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.identification.identify import identify
from rwa_monitor.monitor.setup import read_wheel
from rwa_monitor.telemetry.table import read_table

COULOMB_NM, VISCOUS = 1.6e-3, 5.3e-6  # as in record.py
WITHIN = 0.01  # relative error of a parameter


def search(folder: Path, case: str) -> Search:
    """Search one record."""
    wheel = read_wheel(folder / f"{case}.toml")
    return find_discrepancy([(case, read_table(folder / f"{case}.csv").samples)], wheel)


def main() -> int:
    """Print the results and return the exit code."""
    folder = Path(sys.argv[1])
    crossing, rest = search(folder, "crossing").result, search(folder, "rest").result
    wheel = read_wheel(folder / "crossing.toml")
    samples = read_table(folder / "crossing.csv").samples
    nominal = identify([("crossing", samples)], wheel, systems=False).wheel.nominal
    assert nominal is not None
    ratios = nominal.dry_torque_Nm / COULOMB_NM, nominal.viscous_Nm_s_rad / VISCOUS
    print(f"in motion: {crossing.verdict}; Coulomb {ratios[0]:.4f}, viscous {ratios[1]:.4f} of Basilisk's")
    print(f"from rest: {rest.verdict}; {', '.join(effect.name for effect in rest.effects) or 'nothing named'}")
    agrees = crossing.verdict == "adequate" and all(abs(ratio - 1) < WITHIN for ratio in ratios)
    return 0 if agrees and rest.verdict == "inadequate" else 1


if __name__ == "__main__":
    sys.exit(main())
