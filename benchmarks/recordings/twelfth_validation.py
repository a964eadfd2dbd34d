"""The twelfth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.twelfth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt, find_peaks

from benchmarks.recordings.eleventh_validation import half_swings, of_two
from benchmarks.recordings.ninth_validation import RPM, sheet
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.validation import convert, means, save


def home_rowers(mirrors: Path, out: Path) -> None:
    """From dvernooy/ErgWare (GPL-3): two rowing machines built at home, fans on a flywheel, one row a turn or half one.

    Dave: ticks of 8 µs, one mark a turn, J = 0.16 kg m²; Luca: ticks of 4 µs, two marks a turn, speed over a turn, J =
    0.08 kg m² (all of their sheets). Only where the flywheel runs down between two pulls: three falling speeds on each
    side, friction = −J dω/dt over two intervals.
    """
    for name, file, number, letter, tick, step, inertia in (
        ("home_rower_dave", "docs/ErgWare_model_0.1.xlsx", 3, "F", 8e-6, 1, 0.16),
        ("home_rower_luca", "v0.1/v0.11-stroke-debug/erg_model3.xlsx", 7, "B", 4e-6, 2, 0.08),
    ):
        ticks = sheet(fetch(mirrors, "dvernooy/ErgWare", file), number, letter)[:, 0]
        clock = np.append(0.0, np.cumsum(ticks)) * tick
        speed, time = 2 * np.pi / (clock[step:] - clock[:-step]), (clock[step:] + clock[:-step]) / 2
        falling = np.append(np.diff(speed) < 0.0, False)
        keep = np.array([k for k in range(3, speed.size - 3) if falling[k - 3 : k + 3].all()])
        rate = (speed[keep + 1] - speed[keep - 1]) / (time[keep + 1] - time[keep - 1])
        columns = {"time_s": time[keep], "speed_rad_s": speed[keep], "friction_torque_Nm": -inertia * rate}
        save(out, name, columns, {"inertia_kg_m2": inertia})


def shorted_motor(mirrors: Path, out: Path) -> None:
    """From sbwcwso/MotorTestDataProcessAndPlot (no licence): motor of an electric car, its windings shorted, driven.

    On a test bench at coolant temperatures of 20 and 65 °C, 100 Hz: speed and torque of the driving machine in about 20
    speeds one after the other, in no order. Means of 10 rows at one speed, within 2 rpm of what is wanted, above 20
    rpm.
    """
    repo = "sbwcwso/MotorTestDataProcessAndPlot"
    for name, file in (("shorted_20C", "20 ℃/asc_20℃"), ("shorted_65C", "65 ℃/ASC_65℃")):
        time, wanted, turns, torque = sheet(fetch(mirrors, repo, f"data/02 ASC/{file}.xlsx"), 1, "A B E F").T
        steady = (np.abs(turns - wanted) < 2.0) & (turns > 20.0)
        parts = np.split(np.arange(time.size), np.flatnonzero(np.diff(wanted) != 0.0) + 1)
        rows = [
            np.column_stack(means(10, time[k], turns[k], torque[k])) for k in (part[steady[part]] for part in parts)
        ]
        t, v, f = np.concatenate(rows).T
        save(out, name, {"time_s": t, "speed_rad_s": v * RPM, "friction_torque_Nm": f})


def viscometer(mirrors: Path, out: Path) -> None:
    """From priye19/Low-cost---rotational-viscometer (MIT): a printed viscometer, a bob turning in a cup on a bearing.

    Load cell on the cup in grams (force, not torque), the bob's speed by its tachometer in stairs up from 120 to 400
    rpm, about 20 readings a step one after the other; no times: a reading a second.
    """
    for name, file, chosen in (
        ("cup_glycerol_100", "glycerol-concentration-series", {"concentration_pct": "100"}),
        ("cup_glycerol_80", "glycerol-concentration-series", {"concentration_pct": "80"}),
        ("cup_oil", "mineral-oil-gap-study", {"bob_diameter_mm": "42.5"}),
        ("cup_oil_wide", "mineral-oil-gap-study", {"bob_diameter_mm": "39.5"}),
    ):
        text = fetch(mirrors, "priye19/Low-cost---rotational-viscometer", f"data/reference/{file}.csv").decode()
        lines = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
        found = [row for row in lines if all(row[key] == value for key, value in chosen.items())]
        rows = [(float(row["rpm"]), float(row["load_cell_g"])) for row in found if row["load_cell_g"]]
        turns, grams = np.array(rows).T
        columns = {"time_s": np.arange(turns.size, dtype=float), "speed_rad_s": turns * RPM}
        save(out, name, {**columns, "friction_torque_Nm": grams / 1e3})


def crane(mirrors: Path, out: Path) -> None:
    """From peterkrull/EIT6-Crane-Control (no licence): the trolley of a model crane pulled by hand at a force gauge.

    Force (kg, × 9.82 N) at 50 Hz, position from a film at 30 Hz, low-pass filtered at 3 Hz; the gauge starts 14 s
    before the film (of the authors). Means over 0.1 s, speed in m/s, above 0.02.
    """
    base = "test/x_axis_friction/x_friction_slow"
    gauge = git_table(mirrors, "peterkrull/EIT6-Crane-Control", f"{base}.csv", delimiter=",")
    film = git_table(mirrors, "peterkrull/EIT6-Crane-Control", f"{base}_video.csv", delimiter=",", skip_header=2)
    film = film[np.isfinite(film).all(1)]
    even = np.arange(film[0, 0], film[-1, 0], 1 / 30)
    place = filtfilt(*butter(2, 0.2), np.interp(even, film[:, 0], film[:, 1]))
    force = np.interp(even, gauge[:, 0] - 14.0, 9.82 * gauge[:, 1])
    t, v, f = means(3, even, np.gradient(place, 1 / 30), force)
    on = v > 0.02
    save(out, "crane_pulled", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]})


def sprung_rods(mirrors: Path, out: Path) -> None:
    """From Alqahtani921893/Damping-Parameter-Estimation (no licence): a rod on a spring, an encoder of 4096 steps.

    Swinging freely, 260 Hz (the clock of the log over all rows), numbers in the names are those of the files. The
    period does not depend on the amplitude: loss of K θ²/2 between two turning points over the way, in terms of K; the
    turning points are vertices of parabolas over 17 rows, their middle a median of three at a time. Means of two half
    swings, from 0.8 to 0.06 rad.
    """
    for name, file in (
        ("rod_60", "60"),
        ("rod_80", "80P"),
        ("rod_120", "120Pnedulum-120-14-1.6"),
        ("rod_120_again", "120Pnedulum-120-14-1.6-2"),
    ):
        text = fetch(mirrors, "Alqahtani921893/Damping-Parameter-Estimation", f"experimental/data/{file}.txt")
        found = re.findall(r", ([\d.]+), (-?[\d.]+)\s", text.decode("latin1"))
        angle = np.radians(np.array(found, dtype=float)[:, 1])
        clock = np.arange(angle.size) / 260.0
        angle = angle - angle[-1]
        tops = np.sort(np.concatenate([find_peaks(way * angle, distance=30, height=0.02)[0] for way in (1, -1)]))
        columns, size = half_swings(clock, angle, tops, 8)
        keep = (size < 0.8) & (size > 0.06)
        save(out, name, {key: x[keep[1:] & keep[:-1]] for key, x in of_two(columns).items()})


def stepper_pendulum(mirrors: Path, out: Path) -> None:
    """From jensen-benard/rotary-inverted-pendulum (MIT): a pendulum swinging freely on an encoder, 5 s at 1 kHz.

    The first second, when the hand still holds it, is left out; 4000 steps a turn, low-pass filtered at 10 Hz. Friction
    = −(dω/dt + w² sin θ + c cos θ) in terms of J, w² and c by least squares beside dry and viscous friction where it
    moves faster than 0.5 rad/s; means of 8 rows.
    """
    for number in (1, 3):
        file = f"software/modelling/experiment/damping_coefficient/pendulum_free_swing_data_0{number}.txt"
        text = fetch(mirrors, "jensen-benard/rotary-inverted-pendulum", file).decode().splitlines()
        angle = filtfilt(*butter(2, 10.0 / 500), np.radians([float(line) for line in text[2:] if line.strip()]))[1000:]
        speed = np.gradient(angle, 1e-3)
        rate, on = np.gradient(speed, 1e-3), np.abs(speed) > 0.5
        base = np.column_stack([np.sin(angle), np.cos(angle), np.sign(speed), speed])
        fit = np.linalg.lstsq(base[on], -rate[on], rcond=None)[0]
        pull = base[:, :2] @ fit[:2]
        t, v, f = means(8, 1e-3 * np.arange(speed.size), speed, -(rate + pull))
        columns = {"time_s": t[5:-5], "speed_rad_s": v[5:-5], "friction_torque_Nm": f[5:-5]}
        save(out, f"stepper_pendulum_{number}", columns, {"inertia_kg_m2": 1.0}, dead_band=0.3)


def small_motor(mirrors: Path, out: Path) -> None:
    """From warboar32/pendulum-data (no licence): a small geared motor under a voltage that swings, then in steps.

    Current in A stands for the torque; current and angle at 100 Hz, low-pass filtered at 5 Hz, the speed from the
    angle. Friction = current − J dω/dt, J by least squares beside dry and viscous friction and an offset where it turns
    faster than 1 rad/s; means of 2 rows.
    """
    rows = [line.split("\t") for line in fetch(mirrors, "warboar32/pendulum-data", "README.md").decode().splitlines()]
    table = np.array([[float(word) for word in row] for row in rows[1:] if len(row) == 7])
    for name, begin, end in (("small_motor_swing", 0.1, 7.2), ("small_motor_steps", 7.3, 19.2)):
        part = table[(table[:, 0] > begin) & (table[:, 0] < end)]
        even = np.arange(part[0, 0], part[-1, 0], 0.01)
        low = butter(2, 5.0 / 50)
        current, angle = (filtfilt(*low, np.interp(even, part[:, 0], part[:, k])) for k in (2, 5))
        speed = np.gradient(angle, 0.01)
        rate, on = np.gradient(speed, 0.01), np.abs(speed) > 1.0
        base = np.column_stack([rate, np.sign(speed), speed, np.ones_like(speed)])
        inertia = float(np.linalg.lstsq(base[on], current[on], rcond=None)[0][0])
        t, v, f, motor = means(2, even, speed, current - inertia * rate, current)
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "motor_torque_Nm": motor}
        columns = {key: x[5:-5] for key, x in columns.items()}
        save(out, name, columns, {"inertia_kg_m2": round(inertia, 6)}, dead_band=0.3)


def odrive_motor(mirrors: Path, out: Path) -> None:
    """From labmrd/odrive-with-motor-characterization (MIT): a bare motor under a voltage that swings ever faster.

    `chirp`: 0.25 V at most, `step`: a constant 0.25 V, one way. Voltage in V stands for the torque (what
    the turning motor induces is its viscous part), it and the angle in turns low-pass filtered at 20 Hz on an even grid
    of 200 Hz. Friction = voltage − J dω/dt, J in V s²/rad by least squares beside dry and viscous friction and an
    offset.
    """
    folder = "docs/motor_characterization_references/demo_data"
    for name, file in (
        ("odrive_chirp_1", "chirp1"),
        ("odrive_chirp_2", "chirp2"),
        ("odrive_step", "step1"),
        ("odrive_step_again", "step2"),
    ):
        text = fetch(mirrors, "labmrd/odrive-with-motor-characterization", f"{folder}/{file}.csv").decode()
        lines = [line.strip(" ;").split(",") for line in text.splitlines() if line and line[0].isdigit()]
        log = np.array([[float(word) for word in line] for line in lines if len(line) == 4])
        log = log[np.append(True, np.diff(log[:, 0]) > 0.0)]
        clock = (log[:, 0] - log[0, 0]) / 8e3
        even = np.arange(0.0, clock[-1], 0.005)
        low = butter(2, 20.0 / 100)
        angle, volts = (filtfilt(*low, np.interp(even, clock, log[:, k])) for k in (2, 1))
        speed = np.gradient(2 * np.pi * angle, 0.005)
        rate, on = np.gradient(speed, 0.005), np.abs(speed) > 2.0
        base = np.column_stack([rate, np.sign(speed), speed, np.ones_like(speed)])
        inertia = float(np.linalg.lstsq(base[on], volts[on], rcond=None)[0][0])
        columns = {"time_s": even, "speed_rad_s": speed, "friction_torque_Nm": volts - inertia * rate}
        columns = {key: x[10:-10] for key, x in {**columns, "motor_torque_Nm": volts}.items()}
        save(out, name, columns, {"inertia_kg_m2": round(inertia, 7)}, dead_band=1.0)


def gear_motor(mirrors: Path, out: Path) -> None:
    """From Royginald/small-controls-project (no licence): a geared motor at 3 to 12 V, each from rest, 3 s long.

    Voltage in V stands for the torque (what the turning motor induces is its viscous part), speed in steps/s at
    20 Hz, a step taken as 0.01 rad, from 0.5 s on, one voltage after the other. `even`, `odd`: whole volts that are.
    """
    for name, levels in (("gear_motor_even", (4, 6, 8, 10, 12)), ("gear_motor_odd", (3, 5, 7, 9, 11))):
        rows = []
        for volts in levels:
            file = f"Motor Responses/motor_data_{volts}_volts.csv"
            run = git_table(mirrors, "Royginald/small-controls-project", file, delimiter=",", skip_header=1)
            rows.append(run[run[:, 0] > 0.5] + [4.0 * volts, 0.0, 0.0])
        t, f, v = np.concatenate(rows).T
        save(out, name, {"time_s": t, "speed_rad_s": 0.01 * v, "friction_torque_Nm": f})


def micromouse(mirrors: Path, out: Path) -> None:
    """From opatiny/micromouse (MIT): wheels of a small robot in the air, command in steps of one from −254 to 254.

    Command × voltage of the battery / 255 in V stands for the torque (what the turning motor induces is its viscous
    part); speed by encoder, 1.1 s a step.
    """
    log = git_table(
        mirrors, "opatiny/micromouse", "matlab/data/wheelSpeedCalibration3.csv", delimiter=",", skip_header=1
    )
    log = log[np.isfinite(log).all(1)]
    volts = log[:, 2] * log[:, 1] / 255e3
    for name, column in (("mouse_left", 3), ("mouse_right", 4)):
        columns = {"time_s": log[:, 0] / 1e3, "speed_rad_s": log[:, column] * RPM, "friction_torque_Nm": volts}
        save(out, name, columns, dead_band=1.0)


def starch_gel(mirrors: Path, out: Path) -> None:
    """From PetrusKirsten/Rheometer-Plotting (no licence): a rheometer breaking down starch gels at 300 /s, then slower.

    Stress in Pa stands for the torque, shear rate in 1/s for the speed: 180 to 600 s at 300 /s, a row each 2 to 6 s,
    then up to seven rows of a falling rate.
    """
    repo = "PetrusKirsten/Rheometer-Plotting"
    for name, file in (
        ("starch", "10St/10_0WSt-viscRec_1"),
        ("starch_again", "10St/10_0WSt-viscRec_2"),
        ("starch_kappa", "10St_kC/10_0WSt_kCar-viscoelasticRecovery-Flow_1"),
        ("starch_iota", "10St_iC/10_0WSt_iCar-viscoRecoveryandFlow_1"),
    ):
        t, stress, rate = sheet(fetch(mirrors, repo, f"data/by sample/{file}.xlsx"), 1, "B I K").T
        on = rate > 5.0
        save(out, name, {"time_s": t[on], "speed_rad_s": rate[on], "friction_torque_Nm": stress[on]})


ALL = (
    home_rowers,
    shorted_motor,
    viscometer,
    crane,
    sprung_rods,
    stepper_pendulum,
    small_motor,
    odrive_motor,
    gear_motor,
    micromouse,
    starch_gel,
)

if __name__ == "__main__":
    convert(ALL)
