"""Public recordings to friction tables, for development.

python -m benchmarks.recordings.development {emps,flywheel,drum,tx40} SOURCE OUT

SOURCE is the git directory that was fetched (bare or not; for tx40 the folder measured/tx40). Each recording
becomes OUT/NAME.csv and OUT/NAME.toml (wheel file). Friction is positive where it opposes positive speed. For
meco-group/nlgreyfast (emps), pgrady3/dev (flywheel), hpvdt/rolling_resistance_rig (drum). numpy and scipy only.
"""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, filtfilt

from benchmarks.recordings.validation import git_list, git_show, save


def emps(source: str, out: Path) -> None:
    """Linear axis.

    F = g vir − M a; position at 1 kHz, zero-phase Butterworth of 4th order at 20 Hz, central differences.
    """
    data = loadmat(io.BytesIO(git_show(source, "nlid_emps_sim_data_training.mat")))  # type: ignore[arg-type]
    gain, mass, cut = 35.15065188, 95.11, 20.0
    time, position, force = (data[k].ravel().astype(float) for k in ("t", "qm", "vir"))
    force = gain * force
    dt = (time[-1] - time[0]) / (time.size - 1)
    b, a = butter(4, cut * 2 * dt)
    position = filtfilt(b, a, position)
    speed = np.gradient(position, dt)
    friction = filtfilt(b, a, force) - mass * np.gradient(speed, dt)
    keep = np.arange(int(0.2 / dt), time.size - int(0.2 / dt), 10)  # without the filters' ends; 100 Hz
    time, speed, friction = time[keep] - time[keep[0]], speed[keep], friction[keep]
    half = time.size // 2
    for name, part in (
        ("emps", slice(None)),
        ("emps_first_half", slice(0, half)),
        ("emps_second_half", slice(half, None)),
    ):
        save(
            out,
            name,
            {"time_s": time[part], "speed_rad_s": speed[part], "friction_torque_Nm": friction[part]},
            {"inertia_kg_m2": mass},
            dead_band=0.005,
            period=10 * dt,
        )


def flywheel(source: str, out: Path) -> None:
    """Flywheel coasting down.

    Means over 1 s of rpm at 50 Hz; friction = −J dω/dt by central differences of the means.
    """
    inertia, per = 0.8489, 50
    for file in (
        "unloaded_spindown_5_28",
        "motorUnplugged_spindown",
        "unloaded_spindown",
        "motorUnplugged_spindown_5_28",
    ):
        table = np.genfromtxt(io.BytesIO(git_show(source, f"DynoData/{file}.txt")), invalid_raise=False)
        rpm, time = table[:, 3], table[:, 5] / 1e3
        glitch = np.flatnonzero((rpm[1:-1] == 0) & (rpm[:-2] > 0) & (rpm[2:] > 0)) + 1
        rpm[glitch] = rpm[glitch - 1]
        smooth = np.convolve(rpm, np.ones(per) / per, "same")
        first = int(smooth.argmax()) + 5 * per  # five seconds after the motor is switched off
        slow = np.flatnonzero(smooth[first:] < 10.0)
        last = first + (int(slow[0]) if slow.size else rpm.size - first) - 5 * per  # and five before it stands
        count = (last - first) // per
        speed = rpm[first : first + count * per].reshape(count, per).mean(1) * np.pi / 30
        at = time[first : first + count * per].reshape(count, per).mean(1)
        at = at - at[0]
        friction = -inertia * np.gradient(speed, at)
        name = "flywheel_" + file
        save(
            out,
            name,
            {"time_s": at[1:-1], "speed_rad_s": speed[1:-1], "friction_torque_Nm": friction[1:-1]},
            {"inertia_kg_m2": inertia},
            period=1.0,
        )
        save(
            out,
            name + "_motor_off",
            {"time_s": at, "speed_rad_s": speed},
            {"inertia_kg_m2": inertia},
            motor_off=True,
            period=1.0,
        )


def track(events: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return times and counts of whole turns of the drum.

    A turn ends at the event nearest to the prediction from the last turns; all other events are ignored.

    Both sensors saw both magnets: the events of drum and wheel are mixed. A chain is followed from each place with four
    periods in a row, each within −0.2 to +2 % of the one before; the one with most turns below 42 rad/s is the drum.
    """
    events = np.unique(events)
    gaps = np.diff(events)
    ratio = gaps[1:] / gaps[:-1]
    fine = (ratio > 0.998) & (ratio < 1.02)
    best: tuple[np.ndarray, np.ndarray] = (np.zeros(0), np.zeros(0))
    used: set[float] = set()
    for first in np.flatnonzero(fine[:-2] & fine[1:-1] & fine[2:]):
        if events[first] in used:
            continue  # in a chain that was followed already
        time, turn = chain(events, int(first), gaps[first])
        if time.size > 30:
            used.update(time)
        period = np.diff(time) / np.diff(turn)
        if time.size > best[0].size and period[0] > 0.15 and period[-1] > 4 * period[0]:
            best = time, turn
    return best


def chain(events: np.ndarray, first: int, last: float) -> tuple[np.ndarray, np.ndarray]:
    """Follow whole turns from an event on, the last one `last` seconds long; return their times and counts."""
    time, turn, growth = [events[first], events[first + 1]], [0, 1], 1.0
    while True:
        for step in (1, 2, 3, 4, 5, 6):
            expected = time[-1] + step * last * growth ** ((step + 1) / 2)
            at = np.searchsorted(events, expected)
            near = min(events[max(at - 1, 0) : at + 1], key=lambda e: abs(e - expected))
            if near > time[-1] + 0.5 * last and abs(near - expected) < (0.02 + 0.5 * (growth - 1)) * last:
                break
        else:
            break
        period = (near - time[-1]) / step
        growth += 0.3 * (min(max((period / last) ** (2 / (step + 1)), 0.999), 1.15) - growth)
        last = period * growth ** ((step - 1) / 2)
        time.append(near)
        turn.append(turn[-1] + step)
        if growth > 1.08:
            break
    return np.array(time), np.array(turn)


def coast(events: np.ndarray, out: Path, name: str, inertia: float, turns: int = 4) -> None:
    """Write a coast-down: ω is the mean over a turn, at the turn's middle.

    For the friction table dω/dt is the slope of a parabola over 2·turns + 1 rows.
    """
    time, turn = track(events)
    middle, speed = (time[1:] + time[:-1]) / 2, 2 * np.pi * np.diff(turn) / np.diff(time)
    middle = middle - middle[0]
    rows = np.arange(turns, speed.size - turns)
    slope = np.array(
        [
            np.polyfit(middle[k - turns : k + turns + 1] - middle[k], speed[k - turns : k + turns + 1], 2)[1]
            for k in rows
        ]
    )
    period = float(np.median(np.diff(middle)))
    save(
        out,
        name,
        {"time_s": middle[rows], "speed_rad_s": speed[rows], "friction_torque_Nm": -inertia * slope},
        {"inertia_kg_m2": inertia},
        period=period,
    )
    save(
        out,
        name + "_motor_off",
        {"time_s": middle, "speed_rad_s": speed},
        {"inertia_kg_m2": inertia},
        motor_off=True,
        period=period,
    )


def drum(source: str, out: Path) -> None:
    """Drum coasting down in air.

    One row per turn, J = 10 (arbitrary); the columns are μs, drum rate, turns, wheel rate, turns.
    """
    for path in git_list(source, "analysis/data/aero"):
        found = re.search(r"([^/]+) - Separate - (Left|Right) - (\d+) psi\.csv", path)
        if not found or (found[1], found[3]) not in WANTED:
            continue
        table = np.genfromtxt(io.BytesIO(git_show(source, path)), delimiter=",", invalid_raise=False)
        table = table[np.isfinite(table).all(1)]
        coast(table[:, 0] / 1e6, out, f"drum_{found[1].replace(' ', '_')}_{found[3]}_{found[2]}", 10.0)


WANTED = {
    ("Grandprix", "110"),
    ("Michelin 44-406", "40"),
    ("Michelin 44-406", "70"),
    ("Greenspeed Scorcher", "90"),
    ("Vittoria Corsa Open", "100"),
}


def tx40(source: str, out: Path) -> None:
    """Six joints of a robot, unchanged."""
    for joint in range(1, 7):
        text = (Path(source) / f"joint{joint}.csv").read_text()
        out.mkdir(parents=True, exist_ok=True)
        (out / f"joint{joint}.csv").write_text(text)
        (out / f"joint{joint}.toml").write_text(
            (Path(source) / "wheel.toml").read_text().replace("tx40-joint", f"tx40-joint{joint}")
        )


if __name__ == "__main__":
    {"emps": emps, "flywheel": flywheel, "drum": drum, "tx40": tx40}[sys.argv[1]](sys.argv[2], Path(sys.argv[3]))
