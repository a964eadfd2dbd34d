"""The fourteenth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.fourteenth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt, medfilt

from benchmarks.recordings.fifth_validation import loss
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.third_validation import half_swings
from benchmarks.recordings.validation import convert, means, save


def motor_map(mirrors: Path, out: Path) -> None:
    """From Capo01/odrive_based_electric_motor_dynamometer (GPL-3): a motor against another, efficiency mapped.

    Levels of 10 to 400 rad/s, at each the torque of the other in steps; means of ten readings, a second after each
    change (1.2 s a row). `tested` = k · q-axis current − torque of the load cell, `absorber` = torque + k · its q-axis
    current, k by least squares beside dry and viscous friction (torque 0.03, 0.06 N m/A); signs turned so that the
    speed is positive, with the temperature of each. Left out: the last two rows, where the machine
    stopped (their torque is missing, one turns the other way).
    """
    file = "Odrive motor testing procedure/odrive_data.csv"
    log = git_table(mirrors, "Capo01/odrive_based_electric_motor_dynamometer", file, delimiter=",", skip_header=3)
    log = log[np.isfinite(log).all(1) & (log[:, 10] < -5.0)]
    log = log[np.abs(log[:, 9] - 29.5 * log[:, 5]) < 500.0]  # mN m, mN m/A
    torque, v = -log[:, 9] / 1e3, -log[:, 10]
    for name, current, sign, heat in (("tested", -log[:, 5], 1.0, 3), ("absorber", log[:, 15], -1.0, 13)):
        base = np.column_stack([sign * current, -sign * np.ones_like(v), -sign * v])
        constant = float(np.linalg.lstsq(base, torque, rcond=None)[0][0])
        motor = constant * current
        columns = {
            "time_s": 1.2 * np.arange(v.size),
            "speed_rad_s": v,
            "friction_torque_Nm": motor - sign * torque,
            "motor_torque_Nm": motor,
            "bearing_temperature_degC": log[:, heat],
        }
        save(out, f"motor_map_{name}", columns, dead_band=1.0)


def muds(mirrors: Path, out: Path) -> None:
    """From Open-Source-Drilling-Community/YPLCalibrationFromRheometer (MIT): drilling fluids in a rheometer.

    KCl and polymer in water, weighted to 1.25, 1.5, 1.75 times water or not, at 10, 20, 50 and 80 °C; Versatec (oil),
    weighted to 1.37 times water or not, in steps of 10 °C. Stress (Pa) over the rate of shear (1/s), rates downwards,
    one temperature after the other, with the temperature. No times: ten seconds a row.
    """
    repo = "Open-Source-Drilling-Community/YPLCalibrationFromRheometer"
    text = fetch(mirrors, repo, "RheogramSet.txt").decode("utf-8-sig").replace(",", ".").splitlines()
    for name, fluid, steps in (
        ("polymer_175", "KCl/Polymer 1.75sg", (10, 20, 50, 80)),
        ("polymer_150", "KCl/Polymer 1.50sg", (10, 20, 50, 80)),
        ("polymer_125", "KCl/Polymer 1.25sg", (10, 20, 50, 80)),
        ("polymer", "KCl/Polymer unweighted", (10, 20, 50, 80)),
        ("oil_137", "Versatec 1.37sg", range(10, 90, 10)),
        ("oil", "Versatec unweighted", range(10, 90, 10)),
    ):
        rows = []
        for heat in steps:
            start = next(k for k, line in enumerate(text) if f"{fluid} {heat}degC" in line) + 1
            stop = next(k for k in range(start, len(text)) if not text[k].strip())
            rows += [[*map(float, line.split()), float(heat)] for line in text[start:stop]]
        rate, stress, heat_of = np.array(rows).T
        columns = {"time_s": 10.0 * np.arange(rate.size), "speed_rad_s": rate, "friction_torque_Nm": stress}
        save(out, f"mud_{name}", columns | {"bearing_temperature_degC": heat_of})


def motor_levels(mirrors: Path, out: Path) -> None:
    """From adinovitarini/Dataset_Case_Study (no licence): speed of a small motor over its voltage in 20 levels.

    Voltage stands for the torque (what the turning motor induces is its viscous part); levels of 2 to 8 V up and down,
    no times: 10 ms a row; means of 20 rows, the first 20 rows after each change left out.
    """
    log = git_table(mirrors, "adinovitarini/Dataset_Case_Study", "motor_data.csv", delimiter=",", skip_header=1)
    log = log[np.isfinite(log).all(1)]
    rows = []
    edges = np.concatenate([[0], np.flatnonzero(np.diff(log[:, 0])) + 1, [len(log)]])
    for start, stop in pairwise(edges):
        part = slice(int(start) + 20, int(stop))
        rows.append(np.array(means(20, 0.01 * np.arange(len(log))[part], log[part, 1], log[part, 0])))
    table = np.concatenate(rows, axis=1)
    t, v, volts = table[:, table[1] > 5.0]
    save(out, "motor_levels", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": volts})


def bobs(mirrors: Path, out: Path) -> None:
    """From three groups of students (no licence): bobs on threads, filmed; friction in terms of m g l.

    satvick16/pendulum-lab (15 Hz, degrees) and tylertian123/phy180_lab, lab 1 (20 Hz): one row for each half swing as
    in `third_validation`. 420Ayan420/phy180-pendulums: turning points of each side (those that follow another within
    1.5 s or are on the wrong side are none), half the width between them (10 % off the median of nine is dropped),
    means of two; loss of 1 − cos a over the way.
    """
    log = git_table(mirrors, "satvick16/pendulum-lab", "tracker_data.txt")
    save(out, "bob_half_swings", half_swings(log[:, 0], np.radians(log[:, 1]), 1.0, 3, 0.05), dead_band=0.01)
    log = git_table(mirrors, "tylertian123/phy180_lab", "lab3/report/lab1_data.txt")
    save(out, "bob_small", half_swings(log[:, 0], log[:, 1], 1.0, 3, 0.02), dead_band=0.01)
    log = git_table(mirrors, "420Ayan420/phy180-pendulums", "displacement_data.txt", skip_header=1)
    log = log[np.isfinite(log).all(1)]
    tops, lows = (side[np.append(True, np.diff(side[:, 0]) > 1.5)] for side in (log[:, :2], log[log[:, 3] < 0.0, 2:4]))
    width = (np.interp(lows[:, 0], *tops.T) - lows[:, 1]) / 2
    good = np.abs(width / medfilt(width, 9) - 1.0) < 0.1
    t, a = means(2, lows[good, 0], width[good])
    period = np.full(t.size, float(np.median(np.diff(lows[:, 0]))))
    save(out, "bob_slow", loss(np.column_stack([t, a, period]), 1 - np.cos(a)))


def kicked_pendulum(mirrors: Path, out: Path) -> None:
    """From dev10110/rotary-pendulum (no licence): a pendulum on an arm that a motor kicks from side to side.

    Angle on a magnetic encoder in degrees, 100 Hz, low-pass filtered at 10 Hz; from 0.35 s after each kick (the command
    changes its sign) to the next, one row for each half swing as in `third_validation`, friction in terms of m g l.
    """
    rows = []
    for line in fetch(mirrors, "dev10110/rotary-pendulum", "log.log").decode().splitlines():
        hour, minute, second = line.split()[1].rstrip(",").replace(",", ".").split(":")
        angle, command = line.split()[2:4]
        rows.append([3600.0 * int(hour) + 60.0 * int(minute) + float(second), float(angle.rstrip(",")), float(command)])
    log = np.array(rows)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(np.sign(log[:, 2]))) + 1, [len(log)]])
    parts: list[dict[str, np.ndarray]] = []
    for start, stop in pairwise(edges):
        if stop - start > 150:
            part = log[int(start) + 35 : int(stop)]
            angle_of = filtfilt(*butter(2, 10.0 / 50), np.radians(part[:, 1]))
            parts.append(half_swings(part[:, 0], angle_of - np.median(angle_of), 1.0, 5, 0.02))
    columns = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    save(out, "kicked_half_swings", columns, dead_band=0.05)


ALL = (motor_map, muds, motor_levels, bobs, kicked_pendulum)

if __name__ == "__main__":
    convert(ALL)
