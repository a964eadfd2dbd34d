"""The third set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.third_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import find_peaks

from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.validation import means, save

DUKE = "DukeElectricVehicles/DEV_data"


def run_down(time: np.ndarray, speed: np.ndarray, slowest: float, skip: int) -> slice:
    """Return the rows from `skip` after the fastest row to the first below the slowest speed."""
    first = int(speed.argmax()) + skip
    slow = np.flatnonzero(speed[first:] < slowest)
    return slice(first, first + int(slow[0]) if slow.size else time.size)


def wheels(mirrors: Path, out: Path) -> None:
    """From DukeElectricVehicles/DEV_data, WheelSpindown/6_12_2019 and BearingTests.

    Front wheels of an efficiency vehicle on a stand, running down from a hand drill: speed in m/s (column 4) at 10 Hz
    over a radius of 0.2375 m (WheelSpindown.m), means of 10 rows; J = 0.0485 kg m² (sum of tyre, sealant, rim and
    spokes there, for the Michelin tyre; the Greenspeed wheel's is not given and scales everything alike). `covered`:
    spokes behind discs; `dtswiss`: its hub with seals; `nsk`: small bearings, nine minutes below 5 m/s.
    """
    radius, inertia = 0.2375, 0.570 * 0.227**2 + 0.020 * 0.23**2 + 0.380 * 0.20**2 + 0.170 * 0.13**2
    for name, path, slowest in (
        ("front_michelin", "WheelSpindown/6_12_2019/mich1", 0.4),
        ("front_michelin_covered", "WheelSpindown/6_12_2019/michCovered", 0.4),
        ("front_dtswiss", "WheelSpindown/6_12_2019/dtswiss_stock", 0.4),
        ("front_dtswiss_loose", "WheelSpindown/6_12_2019/dtswiss_loose", 0.4),
        ("front_greenspeed", "WheelSpindown/6_12_2019/greenspeed1", 0.8),
        ("front_nsk", "BearingTests/spindown_NSKsmall2", 0.3),
        ("front_nsk_again", "BearingTests/spindown_NSKlarge2", 0.3),
    ):
        rows = git_table(mirrors, DUKE, f"{path}.txt", invalid_raise=False)
        part = run_down(rows[:, 9], rows[:, 3], slowest, 20)
        time, speed = means(10, rows[part, 9] / 1e3, rows[part, 3] / radius)
        save(out, name, {"time_s": time, "speed_rad_s": speed}, {"inertia_kg_m2": inertia}, True, 1.0)


def hub_motor(mirrors: Path, out: Path) -> None:
    """From DukeElectricVehicles/DEV_data, DynoData/MITSUBA/spindown_noFlywheel and guinness2019_Bearings.

    Wheel with hub motor running down: controller connected or disconnected, or the rotor taken out of the stator
    (bearings and air alone), 16 ticks told as a turn each, thus rpm / 16 (spindown.m), 50 Hz, means of 10 rows
    (connected, disconnected: 0.2 s) or 100 rows (2 s). J = 0.06175 kg m² (stock hub wheel). `hub_left`: another hub,
    J = 0.04.
    """
    folder = "DynoData/MITSUBA/spindown_noFlywheel/stockHubWheel_outofdyno_"
    for name, path, inertia, count, slowest in (
        ("hub_connected", folder + "connected", 0.06175, 20, 900.0),
        ("hub_disconnected", folder + "disconnected", 0.06175, 20, 400.0),
        ("hub_out_of_stator", folder + "outofstator", 0.06175, 100, 100.0),
        ("hub_left", "DynoData/guinness2019_Bearings/hubdataleft", 0.04, 10, 150.0),
    ):
        rows = git_table(mirrors, DUKE, f"{path}.txt", invalid_raise=False)
        rpm, time = rows[:, 3].copy(), rows[:, 5] / 1e3
        gap = np.flatnonzero((rpm[1:-1] == 0) & (rpm[:-2] > 0) & (rpm[2:] > 0)) + 1
        rpm[gap] = rpm[gap - 1]
        top = np.flatnonzero(rpm > 0.97 * rpm.max())[-1]  # the motor held it there before
        part = run_down(time[top:], rpm[top:], slowest, 50)
        part = slice(top + part.start, top + part.stop)
        t, speed = means(count, time[part], rpm[part] / 16 * np.pi / 30)
        save(out, name, {"time_s": t, "speed_rad_s": speed}, {"inertia_kg_m2": inertia}, True, 0.3)


def no_load(mirrors: Path, out: Path) -> None:
    """From DukeElectricVehicles/DEV_data, DynoData/Koford/noLoad.

    Brushless motor (Koford) without load while its supply is turned down: friction (iron, bearings, air) = (power −
    the controller's own, 0.46 W) / speed, rpm × 48 (analyze.m), glitches of the reading left out, means of 50 rows
    (1 s).
    """
    quiet = git_table(mirrors, DUKE, "DynoData/Koford/noLoad/quiescentPower_KofordController.txt", invalid_raise=False)
    rows = git_table(mirrors, DUKE, "DynoData/Koford/noLoad/PSrampdown_KofordController.txt", invalid_raise=False)
    good = (rows[:, 3] > 5) & (rows[:, 3] < 210)
    rows = rows[good]
    time, speed, power = means(50, rows[:, 5] / 1e3, rows[:, 3] * 48 * np.pi / 30, rows[:, 0] * rows[:, 1])
    power = power - (quiet[:, 0] * quiet[:, 1]).mean()
    save(out, "koford_no_load", {"time_s": time, "speed_rad_s": speed, "friction_torque_Nm": power / speed})


def car(mirrors: Path, out: Path) -> None:
    """From shotgoose/coastdown-testing.

    A small racing car rolling down, speed of a rear wheel at 500 Hz, means of 50 rows (0.1 s): m = 250 kg, diameter
    of the wheel 0.5842 m, J = m r². `coast_1` ends where the brake comes in (below 190 rpm).
    """
    radius = 0.5842 / 2
    for name, file, slowest in (
        ("car_4wd_1", "4WD-1", 55.0),
        ("car_4wd_2", "4WD-2", 55.0),
        ("car_2wd_1", "2WD-1", 70.0),
        ("car_2wd_3", "2WD-3", 70.0),
        ("car_coast_1", "1", 190.0),
        ("car_coast_3", "3", 115.0),
    ):
        rows = git_table(
            mirrors,
            "shotgoose/coastdown-testing",
            f"csv-data/RR-Coastdown-{file}.csv",
            delimiter=",",
            skip_header=1,
            invalid_raise=False,
        )
        rows = rows[np.isfinite(rows[:, [0, 7]]).all(1)]
        time, rpm = means(50, rows[:, 0], rows[:, 7])
        part = run_down(time, rpm, slowest, 5)
        save(
            out,
            name,
            {"time_s": time[part], "speed_rad_s": rpm[part] * np.pi / 30},
            {"inertia_kg_m2": 250.0 * radius**2},
            True,
            0.5,
        )


def half_swings(time: np.ndarray, angle: np.ndarray, weight: float, half: int, lowest: float) -> dict[str, np.ndarray]:
    """Return one row for each half swing of a pendulum that hangs at zero.

    The loss of m g l (1 − cos θ) between two turning points over the angle between them is the mean friction, its speed
    the mean one. The turning points are vertices of parabolas over 2·half + 1 rows.
    """
    tops = np.sort(np.concatenate([find_peaks(sign * angle, distance=3 * half, height=lowest)[0] for sign in (1, -1)]))
    tops = tops[(tops > half) & (tops < angle.size - half)]
    at, top = np.empty(tops.size), np.empty(tops.size)
    for row, k in enumerate(tops):
        w = slice(k - half, k + half + 1)
        c = np.polyfit(time[w] - time[k], angle[w], 2)
        at[row], top[row] = time[k] - c[1] / (2 * c[0]), c[2] - c[1] ** 2 / (4 * c[0])
    alternate = np.concatenate([[True], np.sign(top[1:]) != np.sign(top[:-1])])
    at, top = at[alternate], top[alternate]
    top -= np.median((top[:-2] + 2 * top[1:-1] + top[2:]) / 4)  # the middle of the swings
    path = np.diff(top)
    return {
        "time_s": (at[1:] + at[:-1]) / 2,
        "speed_rad_s": path / np.diff(at),
        "friction_torque_Nm": weight * (np.cos(top[1:]) - np.cos(top[:-1])) / path,
    }


def pendulums(mirrors: Path, out: Path) -> None:
    """From Prof-Carter/book_ip and IvanKenevich/furuta-pendulum.

    Pendulums swinging freely, one row for each half swing (the _swings: mean of two neighbours, so that an error of the
    middle cancels). `arm`: of an arm-driven pendulum (adip), m = 0.096 kg, l = 0.195 m; `cart`: of a cart-driven one
    (cdip), 0.107 kg, 0.23 m, both 1 kHz; `furuta`: dataset4, 0.01899 kg, 0.09156 m, 50 Hz in radians.
    """
    for name, key, mass, length in (("arm", "adip", 0.096, 0.195), ("cart", "cdip", 0.107, 0.23)):
        data = loadmat(io.BytesIO(fetch(mirrors, "Prof-Carter/book_ip", f"mfiles/p1c3/{key}_pend_data.mat")))  # type: ignore[arg-type]
        time, angle = data["t"].ravel(), data["theta2" if key == "adip" else "theta"].ravel()
        keep = time > time[int(np.abs(angle).argmax())] + 0.5
        rows = half_swings(time[keep], angle[keep], mass * 9.81 * length, 40, 0.02)
        swings = {k: (np.abs(v[1:]) + np.abs(v[:-1])) / 2 for k, v in rows.items()}
        save(out, f"pendulum_{name}_half_swings", rows, dead_band=0.01)
        save(out, f"pendulum_{name}_swings", swings)
    table = git_table(
        mirrors, "IvanKenevich/furuta-pendulum", "code/MATLAB/arm2_damping/dataset4.txt", invalid_raise=False
    )
    time, angle = table[340:, 0] / 1e6, table[340:, 1]
    rows = half_swings(time, angle, 0.01899165 * 9.81 * 0.09155541, 3, 0.03)
    save(out, "pendulum_furuta_half_swings", rows, dead_band=0.05)


def direct_drive(mirrors: Path, out: Path) -> None:
    """From jorgevchin/Friction-Identification, Test 2.

    Arm with two direct-drive joints in a vertical plane, both turned at one constant speed (0.1–90 °/s) from hanging
    down, 67 Hz; the rows between start and stop that the authors name (Test2.m), means of 10 (0.15 s), speed from the
    angles. Friction = torque less the gravity of Test2.m (38.5 N m sin q1 + 1.82 N m sin(q1 + q2), 1.82 N m sin(q1 +
    q2)). Runs in growing order, forth, then back, 5 s between them; `_again` has their second recording (forth).
    """
    speeds = ("01", "02", "03", "04", "05", "1", "2", "3", "4", "5", "10", "15", "20", "30", "40", "50", "60", "70", "80", "90")  # fmt: skip
    forth = [19, 6, 3.3, 2.6, 1.5, 1, 1, 0.8] + [0.5] * 11 + [0.3]
    forth_end = [38.0] * 4 + [4.8] * 10 + [4.4, 3.5, 2.9, 2.5, 2.2, 1.9]
    back = [8, 4.5, 3, 2, 1.5, 1, 0.5, 0.5, 0.4, 0.4, 0.3, 0.3, 0.3] + [0.5] * 6 + [0.6]
    back_end = [38.0] * 2 + [4.8] * 12 + [4.3, 3.4, 2.8, 2.5, 2.1, 1.9]
    for end, runs in (
        ("", [("", "exp", forth, forth_end), ("n", "exp", back, back_end)]),
        ("_again", [("", "exp2", forth, forth_end)]),
    ):
        parts: list[np.ndarray] = []
        clock = 0.0
        for sign, take, starts, stops in runs:
            for speed, start, stop in zip(speeds, starts, stops, strict=True):
                if (sign, speed) == ("n", "90"):
                    continue  # longer than the others, and it starts later
                q1, q2, tau1, tau2 = (
                    git_table(
                        mirrors, "jorgevchin/Friction-Identification", f"Test 2/cin_{key}_{sign}{speed}_{take}_gan.t"
                    )
                    for key in ("pos1", "pos2", "tau1", "tau2")
                )
                size = min(len(q) for q in (q1, q2, tau1, tau2))
                time, a1, a2 = q1[:size, 0], np.radians(q1[:size, 1]), np.radians(q2[:size, 1])
                gravity = 9.81 * 0.186 * np.sin(a1 + a2)
                f1, f2 = tau1[:size, 1] - 9.81 * 3.921 * np.sin(a1) - gravity, tau2[:size, 1] - gravity
                keep = (time >= start) & (time <= stop)
                columns = (time, np.gradient(a1, time), np.gradient(a2, time), f1, f2)
                t, v1, v2, m1, m2 = means(10, *(c[keep] for c in columns))
                parts.append(np.column_stack([clock + t - t[0], v1, v2, m1, m2]))
                clock = parts[-1][-1, 0] + 5.0
        table = np.vstack(parts)
        for joint in (1, 2):
            columns = {"time_s": table[:, 0], "speed_rad_s": table[:, joint], "friction_torque_Nm": table[:, joint + 2]}
            save(out, f"direct_drive_joint{joint}{end}", columns, dead_band=5e-4)


ALL = (wheels, hub_motor, no_load, car, pendulums, direct_drive)

if __name__ == "__main__":
    for one in ALL:
        if len(sys.argv) == 3 or one.__name__ in sys.argv[3:]:
            one(Path(sys.argv[1]), Path(sys.argv[2]))
