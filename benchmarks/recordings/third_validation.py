"""The third set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.third_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import find_peaks

from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.validation import convert, means, save

DUKE = "DukeElectricVehicles/DEV_data"


def run_down(time: np.ndarray, speed: np.ndarray, slowest: float, skip: int) -> slice:
    """Return the rows from `skip` after the fastest row to the first below the slowest speed."""
    first = int(speed.argmax()) + skip
    slow = np.flatnonzero(speed[first:] < slowest)
    return slice(first, first + int(slow[0]) if slow.size else time.size)


def wheels(mirrors: Path, out: Path) -> None:
    """From DukeElectricVehicles/DEV_data, WheelSpindown/6_12_2019 and BearingTests.

    Front wheels of an efficiency vehicle running down: speed in m/s (column 4) at 10 Hz over a radius of 0.2375 m
    (WheelSpindown.m), means of 10 rows; J = 0.0485 kg m² (sum of tyre, sealant, rim and spokes there, for the Michelin
    tyre; that of the other wheels is not given and scales everything alike). Tyres, hubs (`dtswiss`) and bearings
    (`nsk`, minutes below 5 m/s; one recording is called large in this folder, small in the other) after the file names.
    """
    radius, inertia = 0.2375, 0.570 * 0.227**2 + 0.020 * 0.23**2 + 0.380 * 0.20**2 + 0.170 * 0.13**2
    for name, path, slowest in (
        ("front_michelin", "WheelSpindown/6_12_2019/mich1", 0.4),
        ("front_michelin_covered", "WheelSpindown/6_12_2019/michCovered", 0.4),
        ("front_dtswiss", "WheelSpindown/6_12_2019/dtswiss_stock", 0.4),
        ("front_dtswiss_loose", "WheelSpindown/6_12_2019/dtswiss_loose", 0.4),
        ("front_greenspeed", "WheelSpindown/6_12_2019/greenspeed1", 0.8),
        ("front_nsk", "BearingTests/spindown_NSKsmall2", 0.3),
        ("front_nsk_other", "BearingTests/spindown_NSKlarge2", 0.3),
    ):
        rows = git_table(mirrors, DUKE, f"{path}.txt", invalid_raise=False)
        part = run_down(rows[:, 9], rows[:, 3], slowest, 20)
        time, speed = means(10, rows[part, 9] / 1e3, rows[part, 3] / radius)
        save(out, name, {"time_s": time, "speed_rad_s": speed}, {"inertia_kg_m2": inertia}, True, 1.0)


def hub_motor(mirrors: Path, out: Path) -> None:
    """From DukeElectricVehicles/DEV_data, DynoData/MITSUBA/spindown_noFlywheel and guinness2019_Bearings.

    Wheel with hub motor running down with its controller connected or disconnected, or the rotor taken out of the
    stator (bearings and air alone). The sensor counts 16 pulses a turn, thus rpm / 16 (spindown.m); 50 Hz, means of 20
    rows (0.4 s), out of the stator of 100 rows (2 s). J = 0.06175 kg m² (stock hub wheel, spindown.m). `hub_left`:
    another hub, means of 10 rows (1 s), J = 0.04 kg m².
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


def car(mirrors: Path, out: Path) -> None:
    """From shotgoose/coastdown-testing.

    A small racing car rolling down, speed of a rear wheel at 500 Hz, means of 50 rows (0.1 s): m = 250 kg, diameter of
    the wheel 0.5842 m (coastdown-testing.py), J = m r². From half a second after the fastest to near the end of the
    recording. The ground is taken as level: its slope is not given.
    """
    radius = 0.5842 / 2
    for name, file, slowest in (
        ("car_4wd_1", "4WD-1", 55.0),
        ("car_4wd_2", "4WD-2", 55.0),
        ("car_2wd", "2WD-3", 70.0),
        ("car_coast", "3", 115.0),
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

    Arm with two direct-drive joints in a vertical plane, both turned at one constant speed (0.1–80 °/s) from hanging
    down, 67 Hz. Means of 20 rows (0.3 s), speed from the angles; those within a tenth of the set speed (a half below 5
    °/s), a second after the start (0.4 s from 50 °/s on). Friction = torque less the gravity of Test2.m (38.5 N m sin
    q1 + 1.82 N m sin(q1 + q2) for joint 1, 1.82 N m sin(q1 + q2) for joint 2). Runs in growing order, forth and back in
    turn, 5 s between them; `_again` has their second recording (forth alone).
    """
    speeds = {f"0{n}": n / 10 for n in range(1, 6)}
    speeds |= {str(n): float(n) for n in (1, 2, 3, 4, 5, 10, 15, 20, 30, 40, 50, 60, 70, 80)}
    for end, signs, take in (("", ("", "n"), "exp"), ("_again", ("",), "exp2")):
        parts: list[np.ndarray] = []
        clock = 0.0
        for speed, sign in ((speed, sign) for speed in speeds for sign in signs):
            q1, q2, tau1, tau2 = (
                git_table(mirrors, "jorgevchin/Friction-Identification", f"Test 2/cin_{key}_{sign}{speed}_{take}_gan.t")
                for key in ("pos1", "pos2", "tau1", "tau2")
            )
            size = min(len(q) for q in (q1, q2, tau1, tau2))
            time, a1, a2 = q1[:size, 0], np.radians(q1[:size, 1]), np.radians(q2[:size, 1])
            gravity = 9.81 * 0.186 * np.sin(a1 + a2)
            f1, f2 = tau1[:size, 1] - 9.81 * 3.921 * np.sin(a1) - gravity, tau2[:size, 1] - gravity
            rows = means(20, time, np.gradient(a1, time), np.gradient(a2, time), f1, f2)
            part = np.column_stack(rows)
            ratio = part[:, 1:3] / np.radians(speeds[speed]) * (-1.0 if sign else 1.0)
            near = 0.1 if speeds[speed] >= 5 else 0.5
            steady = (np.abs(ratio - 1.0) < near).all(1) & (part[:, 0] > (0.4 if speeds[speed] >= 50 else 1.0))
            part = part[steady][:-1]  # the last may hold the stop
            part[:, 0] += clock - part[0, 0]
            parts.append(part)
            clock = part[-1, 0] + 5.0
        table = np.vstack(parts)
        for joint in (1, 2):
            columns = {"time_s": table[:, 0], "speed_rad_s": table[:, joint], "friction_torque_Nm": table[:, joint + 2]}
            save(out, f"direct_drive_joint{joint}{end}", columns, dead_band=5e-4)


def schunk(mirrors: Path, out: Path) -> None:
    """From nikhilushinde/AutoKoopman (commit 6edafed; recorded for Liu and Althoff, IROS 2018).

    Six-joint robot arm (Schunk) on fast moves, 250 Hz: motor torque and speed of joint 1 (its axis is vertical) and
    joint 6 (the last, in line with the tool: no gravity) as logged. The inertia is not taken off: a loop over the
    speed; that of the wheel file is the one by least squares.
    """
    for name, number, joint, inertia in (
        ("schunk_joint1", 85, 1, 1.83),
        ("schunk_joint6", 85, 6, 0.51),
        ("schunk_joint6_other", 100, 6, 0.41),
    ):
        time, state, torque = (
            git_table(
                mirrors,
                "nikhilushinde/AutoKoopman",
                f"autoKoopman_codeocean/data/Robot/measurement_{number}/{key}.csv",
                "6edafed",
                delimiter=",",
            )
            for key in ("time", "trajectory", "input")
        )
        size = len(torque)
        columns = {
            "time_s": time[:size],
            "speed_rad_s": state[:size, 5 + joint],
            "friction_torque_Nm": torque[:, joint - 1],
        }
        save(out, name, columns, {"inertia_kg_m2": inertia}, dead_band=0.02)


ALL = (wheels, hub_motor, car, pendulums, direct_drive, schunk)

if __name__ == "__main__":
    convert(ALL)
