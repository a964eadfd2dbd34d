"""The four examples run as a reader runs them, and print what their comments promise."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"

# A line that each prints when it did its work, as a regular expression, and the files that it leaves.
PROMISED = {
    "first_diagnosis.py": (
        r"window 4: anomalous\. Friction of switching system fss_2",
        ["last_window.png"],
    ),
    "hidden_effect.py": (r"cause: viscous_asymmetry.*\n(.*\n)+.*on a later record: adequate", ["extended_wheel.toml"]),
    "replay_bad_day.py": (r"replayed: .*compared: equal", []),  # byte for byte on the processor that made it
    "own_effect.py": (r"found grease_plateau: strength_Nm = 0\.000(29|30)\d* N m", []),
}


def test_every_example_is_tried() -> None:
    assert {file.name for file in EXAMPLES.glob("*.py")} == set(PROMISED)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if "effect" in name else name for name in PROMISED]
)
def test_an_example_does_what_it_states(name: str, tmp_path: Path) -> None:
    command = [sys.executable, "-W", "error::DeprecationWarning:rwa_monitor", str(EXAMPLES / name)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stderr
    line, files = PROMISED[name]
    assert re.search(line, done.stdout), done.stdout
    assert all((tmp_path / file).stat().st_size > 0 for file in files)
