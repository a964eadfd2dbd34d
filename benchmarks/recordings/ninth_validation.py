"""The ninth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.ninth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

import io
import re
import zipfile
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, filtfilt

from benchmarks.recordings.fifth_validation import amplitudes, loss
from benchmarks.recordings.second_validation import fetch
from benchmarks.recordings.third_validation import half_swings
from benchmarks.recordings.validation import convert, means, save, slope

RPM = np.pi / 30
CYLINDER = "ingxfm/find-the-viscous-friction-value-from-a-bunch-of-.mat-data-files"
LABS = "BenHagenau/ASEN2003"


def rows_of(text: bytes) -> np.ndarray:
    """Return the rows of numbers of a table that has remarks before it and between."""
    rows = []
    for line in text.decode("latin1").replace(",", " ").splitlines():
        try:
            rows.append([float(word) for word in line.split()])
        except ValueError:
            continue
    width = max(map(len, rows))
    return np.array([row for row in rows if len(row) == width])


def cylinder(mirrors: Path, out: Path) -> None:
    """From ingxfm/find-the-viscous-friction-value-… (no licence): hydraulic cylinder with a servo valve.

    Piston 16 mm, rod 10 mm, moved out and back at 1 to 5 V, ten times each; one pressure was recorded at a time, so
    that the second chamber is of another stroke at the same voltage. 10 kHz, 20 mm and 1 MPa to the volt as in test.m.
    Over the stroke from 1.5 to 8.5 V of the position in quarters: friction = area × pressure of A less that of B (in
    N), speed = the quarter over its time (in m/s). Strokes of growing voltage, 20 s each. `_out`: extending, `_in`:
    retracting (negative speed).
    """
    area, ring = np.pi / 4 * 0.016**2, np.pi / 4 * (0.016**2 - 0.010**2)
    edges = np.linspace(1.5, 8.5, 5)
    parts: dict[int, list[np.ndarray]] = {1: [], -1: []}
    for run in range(50):
        strokes = []
        for side in "AB":
            file = f"data/m_find_b_p{side}_{run // 10 + 1}V_sample_{run % 10 + 1}.mat"
            data = loadmat(io.BytesIO(fetch(mirrors, CYLINDER, file)))  # type: ignore[arg-type]
            time, place, pressure = (data[k].ravel() for k in ("t", "poloha_s_filtr2", "pressure_s_filtr1"))
            strokes.append((time, place, pressure, int(place.argmax())))
        for way in (1, -1):
            here = []
            for time, place, pressure, top in strokes:
                part = slice(0, top) if way > 0 else slice(top, None)
                for low, high in pairwise(edges):
                    inside = (place[part] > low) & (place[part] < high)
                    t = time[part][inside]
                    here.append((t.mean(), way * 0.02 * (high - low) / np.ptp(t), 1e6 * pressure[part][inside].mean()))
            (a, b), count = (np.array(here[:4]), np.array(here[4:])), 20.0 * run
            force = area * a[:, 2] - ring * b[:, 2]
            parts[way].append(np.column_stack([count + a[:, 0], a[:, 1], force])[np.argsort(a[:, 0])])
    for way, name in ((1, "cylinder_out"), (-1, "cylinder_in")):
        t, v, f = np.vstack(parts[way]).T
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=1e-4)


def reluctance_machine(mirrors: Path, out: Path) -> None:
    """From zanellia/cs_nmpc_rsm (no licence): friction torque of a reluctance machine at 41 speeds, both ways.

    A table for its controller. It has no time: 1 s to a row; sign turned.
    """
    data = loadmat(io.BytesIO(fetch(mirrors, "zanellia/cs_nmpc_rsm", "friction.mat")))["lut_fr"][0, 0]  # type: ignore[arg-type]
    speed, torque = data["omega"].ravel().astype(float), -data["m"].ravel()
    columns = {"time_s": np.arange(float(speed.size)), "speed_rad_s": speed, "friction_torque_Nm": torque}
    save(out, "reluctance_machine", columns, dead_band=1.0)


def geared_motor(mirrors: Path, out: Path) -> None:
    """From thuxrife/FRA233_Lab1_G04 (no licence): a small geared motor under a voltage that swings, or in stairs.

    2 kHz, speed as logged. In terms of its voltage: friction = voltage − J dω/dt in V, so that what the turning motor
    induces is in its viscous part. Voltage and speed low-pass filtered at 10 Hz, J by least squares beside dry and
    viscous friction and an offset where it turns by more than 5 rad/s; means of 60 rows (30 ms)
    after the first second, in which it starts. Sines of two days and
    two settings, stairs from 0 to 12 V and back.
    """
    for name, file in (
        ("geared_motor_sine", "PART2_studyV4/part2_Sine_2_2026-02-06_20-33/Sine_Raw"),
        ("geared_motor_sine_again", "PART2_studyV4/part2_Sine_6_2026-02-06_20-34/Sine_Raw"),
        ("geared_motor_sine_before", "PART2_studyV2/part2_Sine_3_2026-01-31_20-54/Sine_Raw"),
        ("geared_motor_chirp", "PART2_studyV3_12V/part2_Chirp_6_2026-02-03_21-39/Chirp_Raw"),
        ("geared_motor_stairs", "PART2_studyV2/part2_Stair_5_2026-02-01_22-31/Stair_Raw"),
    ):
        data = loadmat(io.BytesIO(fetch(mirrors, "thuxrife/FRA233_Lab1_G04", f"{file}.mat")))["RawData"][0, 0]  # type: ignore[arg-type]
        time, volt, speed = (data[key].ravel().astype(float) for key in ("Time", "Input", "Velo"))
        volt, v = (filtfilt(*butter(2, 10.0 / 1000), column) for column in (volt, speed))
        rate, on = np.gradient(v, 5e-4), np.abs(v) > 5.0
        base = np.column_stack([rate, np.sign(v), v, np.ones_like(v)])
        inertia = float(np.linalg.lstsq(base[on], volt[on], rcond=None)[0][0])
        t, v, f = means(60, *(column[2000:-200] for column in (time, v, volt - inertia * rate)))
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=5.0)


def rolling_disk(mirrors: Path, out: Path) -> None:
    """From BenHagenau/ASEN2003 (no licence), lab 4: a cylinder that rolls down a ramp and drags a sensor.

    10 Hz, rows that fall back by 0.3 rad/s dropped; 11.7 kg and 0.7 kg, r = 0.235 m, radius of gyration 0.203 m, 5.5°
    (lab4.m). Friction = torque of the weight − J dω/dt, the slope of a parabola through seven rows, until it leaves the
    ramp.
    """
    for name in ("balanced_1", "balanced_2"):
        time, _, speed = rows_of(fetch(mirrors, LABS, f"Lab 4: Rolling Disk/{name}")).T
        last = int(np.flatnonzero(np.diff(speed) < -1.5)[0]) if (np.diff(speed) < -1.5).any() else speed.size
        good = np.flatnonzero(speed[:last] > np.maximum.accumulate(speed[:last]) - 0.3)
        time, speed = time[good], speed[good]
        rows, rate = slope(time, speed, 3)
        rows, rate = rows[speed[rows] > 0.2], rate[speed[rows] > 0.2]
        torque = 12.4 * 9.81 * 0.235 * np.sin(np.radians(5.5)) - (12.4 * 0.235**2 + 11.7 * 0.203**2) * rate
        columns = {"time_s": time[rows], "speed_rad_s": speed[rows], "friction_torque_Nm": torque}
        save(out, name.replace("balanced", "disk"), columns)


def despinner(mirrors: Path, out: Path) -> None:
    """From BenHagenau/ASEN2003 (no licence), lab 5: turntable of a yo-yo despinner running down, weights held back.

    Three configurations, speed at 100 Hz in rpm, means of 10 rows, from 0.3 s after its drive lets go (it is held at
    about 100 rpm before) to 4 rpm. J = 0.0483 kg m² (yoyo_Main.m, without weights).
    """
    for name, file in (
        ("despinner", "100_RPM_0_INCH.txt"),
        ("despinner_bare", "80_RPM_NoMass"),
        ("despinner_other", "105_RPM_13.6_INCH"),
    ):
        time, speed = rows_of(fetch(mirrors, LABS, f"Lab 5: yoyo despinner/{file}")).T
        high = np.convolve(speed, np.ones(11) / 11, "same")[6:-6]
        held = high.max() if name == "despinner_bare" else np.median(speed[:300])
        first = int(np.flatnonzero(high > 0.99 * held)[-1])
        part = slice(first + 36, first + int(np.flatnonzero(speed[first:] < 4.0)[0]))
        t, v = means(10, time[part], speed[part] * RPM)
        save(out, name, {"time_s": t, "speed_rad_s": v}, {"inertia_kg_m2": 0.0483}, True, 0.1)


def rotary_arm(mirrors: Path, out: Path) -> None:
    """From BenHagenau/ASEN2003 (no licence), lab 6: a rigid arm on a geared motor, to and fro between two angles.

    1 kHz, three units or settings. Torque = 0.518 / 3.29 · voltage, J = 0.0035 kg m² (rotary_Main.m; by least squares
    nothing of the voltage is induced); speed and torque low-pass filtered at 30 Hz, friction = torque − J dω/dt, means
    of 4 rows where it moves.
    """
    for name, file in (
        ("rotary_arm_unit5", "Unit5_Rigid_trial1.csv"),
        ("rotary_arm_unit1", "4PM_Group37_RigidArm_Unit1"),
        ("rotary_arm_small", "rigidarm_k1k3_6"),
    ):
        table = rows_of(fetch(mirrors, LABS, f"Lab 6: Rotary Arm/{file}"))
        time = (table[:, 0] - table[0, 0]) / 1e3
        v, volt = (filtfilt(*butter(2, 30.0 / 500), table[:, k]) for k in (3, 6))
        motor = 0.518 / 3.29 * volt
        t, speed, motor, f = means(4, time, v, motor, motor - 0.0035 * np.gradient(v, 1e-3))
        near = np.convolve(np.abs(speed) > 0.1, np.ones(9), "same") > 0
        columns = {"time_s": t, "speed_rad_s": speed, "friction_torque_Nm": f, "motor_torque_Nm": motor}
        columns = {key: column[near] for key, column in columns.items()}
        save(out, name, columns, {"inertia_kg_m2": 0.0035}, dead_band=0.1)


def propeller(mirrors: Path, out: Path) -> None:
    """From fdcl-gwu/Motor_Tests (no licence): a propeller (T-Motor 700) at 25 commands on a load cell's arm.

    Torque = 0.23 m × load (calibration of post_porcess_torque_test.m), speed from the controller (780/14 rpm a count);
    the first 3 s at each command dropped, means of 50 rows. 22 ms to a row; it has no time.
    """
    file = "tiger_5_31_2018_14p8 volt/tiger_torque_data_post_process_14.8/test_V_14.8.txt"
    rows = rows_of(fetch(mirrors, "fdcl-gwu/Motor_Tests", file))
    parts = []
    for command in np.unique(rows[:, 0]):
        at = np.flatnonzero(rows[:, 0] == command)[150:]
        torque = 0.23 * 9.8e-3 * (0.4947 * rows[at, 7] - 7.689)
        parts.append(np.column_stack(means(50, 0.022 * at, rows[at, 4] * 780 / 14 * RPM, torque)))
    t, v, f = np.vstack(parts).T
    save(out, "tiger_propeller", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def joystick(mirrors: Path, out: Path) -> None:
    """From gubbatuba/elecanisms (no licence): motor of a haptic joystick running down, one way and the other.

    Angle of 14 bits at 1 kHz; speed over 10 ms, from 20 ms after it falls to 20 rad/s. A kit of the same course as in
    the fourth set (small_motor), of another group. J is not given: 1e-6 kg m².
    """
    for name, file in (("joystick_back", "001_95"), ("joystick_forth", "001_95_fwd")):
        rows = rows_of(fetch(mirrors, "gubbatuba/elecanisms", f"haptic/data/spindowndata_{file}.csv"))
        time, angle = rows[:, 0], np.unwrap(rows[:, 1], period=16384) * 2 * np.pi / 16384
        t, v = (time[10::10] + time[:-10:10]) / 2, np.diff(angle[::10]) / np.diff(time[::10])
        first = int(np.flatnonzero(np.abs(v) > 0.985 * np.median(np.abs(v[:300])))[-1]) + 2
        part = slice(first, first + int(np.flatnonzero(np.abs(v[first:]) < 20.0)[0]))
        save(out, name, {"time_s": t[part], "speed_rad_s": v[part]}, {"inertia_kg_m2": 1e-6}, True, 2.0)


def bicycle_fork(mirrors: Path, out: Path) -> None:
    """From moorepants/BicycleParameters (BSD-2): fork of a bicycle swinging on a knife edge, rate gyro at 1 kHz.

    Its rate (low-pass filtered at 10 Hz) stands for the angle, as in a small swing; its scale is not given (0.1 rad at
    first). Loss of 1 − cos a between two turning points over the way, in terms of m g l, one row for each half swing;
    `fork_swings`: means of two neighbours.
    """
    file = "bicycleparameters/tests/sample_data/BrowserForkCompoundFirst1.mat"
    data = loadmat(io.BytesIO(fetch(mirrors, "moorepants/BicycleParameters", file)))["data"].ravel()  # type: ignore[arg-type]
    rate = filtfilt(*butter(2, 10.0 / 500), data)
    rate = 0.1 * (rate - rate.mean()) / np.abs(rate - rate.mean()).max()
    swings = half_swings(np.arange(rate.size) / 1e3, rate, 1.0, 60, 0.005)
    save(out, "fork_half_swings", swings, dead_band=1e-3)
    save(out, "fork_swings", {key: (np.abs(x[1:]) + np.abs(x[:-1])) / 2 for key, x in swings.items()})


def sheet(data: bytes, number: int, columns: str) -> np.ndarray:
    """Return columns of a sheet of a workbook, by their letters; rows where one is no number are left out."""
    text = zipfile.ZipFile(io.BytesIO(data)).read(f"xl/worksheets/sheet{number}.xml").decode()
    rows = []
    for row in re.findall(r"<row .*?</row>", text, re.DOTALL):
        found = re.findall(
            r'<c r="([A-Z]+)\d+"(?![^>]*t="(?:s|str|inlineStr)")[^>]*>(?:<f.*?</f>|<f[^>]*/>)?<v>([^<]*)', row
        )
        cells = {letter: float(value) for letter, value in found}
        rows.append([cells.get(letter, np.nan) for letter in columns.split()])
    table = np.array(rows)
    good: np.ndarray = table[np.isfinite(table).all(1)]
    return good


def bobs(mirrors: Path, out: Path) -> None:
    """From DavidW99/Damping_Oscillator, kseto06/phy180 and mohamedelsayed-0/PHY180-Pendulum-Project (no licence).

    Bobs on threads, filmed at 30 Hz: a wooden ball (38 mm, 15 g), means of two half swings; two of a course at
    Toronto, windows of one or two periods. Loss of 1 − cos a over the way, in terms of m g l.
    """
    rows = sheet(fetch(mirrors, "DavidW99/Damping_Oscillator", "damping_angle.xlsx"), 1, "A B")
    rows = rows[np.argsort(rows[:, 0])]
    wood = half_swings(rows[:, 0], np.radians(rows[:, 1] - np.median(rows[:, 1])), 1.0, 3, 0.05)
    save(out, "bob_wood", {key: (np.abs(x[1:]) + np.abs(x[:-1])) / 2 for key, x in wood.items()})
    for name, repo, file, periods, smallest in (
        ("bob_tape", "kseto06/phy180", "Lab2/decaydata.txt", 1, 0.05),
        ("bob_long", "mohamedelsayed-0/PHY180-Pendulum-Project", "angles.txt", 2, 0.03),
    ):
        rows = rows_of(fetch(mirrors, repo, file))
        rows = rows[np.append(True, np.diff(rows[:, 0]) > 0.0)]
        angle = rows[:, 1] - np.median(rows[:, 1])
        up = np.flatnonzero((angle[1:900] > 0) & (angle[: angle[1:900].size] <= 0))
        table = amplitudes(rows[:, 0], angle, periods, float(np.median(np.diff(rows[up, 0]))), smallest)
        table = table[table[:, 1] > smallest]
        save(out, name, loss(table, -np.cos(table[:, 1])))


ALL = (
    cylinder,
    reluctance_machine,
    geared_motor,
    rolling_disk,
    despinner,
    rotary_arm,
    propeller,
    joystick,
    bicycle_fork,
    bobs,
)

if __name__ == "__main__":
    convert(ALL)
