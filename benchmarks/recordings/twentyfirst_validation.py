"""The twenty-first set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.twentyfirst_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path

import numpy as np

from benchmarks.recordings.fifteenth_validation import even, ramps, smooth
from benchmarks.recordings.ninth_validation import RPM, sheet
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.twentieth_validation import less_inertia
from benchmarks.recordings.validation import convert, means, save


def robot_log(data: bytes) -> dict[str, list[tuple[float, bytes]]]:
    """Return what a robot's binary log (WPILOG) holds: for each name its times (s) and values as they are stored.

    Each record has a byte of the sizes of what follows, then its entry, size and time (µs); entry 0 names the others.
    """
    at = 12 + int.from_bytes(data[8:12], "little")
    names: dict[int, str] = {}
    found: dict[str, list[tuple[float, bytes]]] = {}
    while at < len(data):
        sizes = ((data[at] & 3) + 1, (data[at] >> 2 & 3) + 1, (data[at] >> 4 & 7) + 1)
        head: list[int] = []
        at += 1
        for size in sizes:
            head.append(int.from_bytes(data[at : at + size], "little"))
            at += size
        value, at = data[at : at + head[1]], at + head[1]
        if head[0]:
            found.setdefault(names[head[0]], []).append((1e-6 * head[2], value))
        elif value[:1] == b"\0":
            names[int.from_bytes(value[1:5], "little")] = value[9 : 9 + int.from_bytes(value[5:9], "little")].decode()
    return found


def lifts_and_wrist(mirrors: Path, out: Path) -> None:
    """From boyu0802/FRC6998_2025ReefScape_New (no licence): a robot's lift and the wrist at its top, in slow ramps.

    50 Hz, volts (stand for the torque, what the turning motor induces is its viscous part), speed as logged (turns/s of
    the wrist, heights/s of the lift), a ramp up and one down, as in `fifteenth_validation`: low-pass filtered at 2 Hz
    (the lift; the wrist at 3 Hz), means of 8 rows at 200 Hz, friction = volts − J dω/dt. `lift_a`, `lift_b`, `lift_c`:
    it holds its own weight; `wrist_a` to `wrist_d`: it turns by 0.4 of a turn, of the first file its last two ramps, of
    the third its first two.
    """
    repo = "boyu0802/FRC6998_2025ReefScape_New"
    for name, file, which, cut, lowest in (
        ("lift_a", "20250202_100203", 0, 2.0, 0.02),
        ("lift_b", "20250202_103319", 0, 2.0, 0.02),
        ("lift_c", "20250202_115714", 0, 2.0, 0.02),
        ("wrist_a", "20250202_053557", -1, 3.0, 0.01),
        ("wrist_b", "20250202_054253.4", 0, 3.0, 0.01),
        ("wrist_c", "20250202_054253", 0, 3.0, 0.01),
        ("wrist_d", "20250202_063751", 0, 3.0, 0.01),
    ):
        log = robot_log(fetch(mirrors, repo, f"sysid/FRC_{file}.wpilog"))
        state, volts, speed = (
            next(value for key, value in log.items() if key.startswith(start))
            for start in ("sysid-test-state", "voltage-", "velocity-")
        )
        time = np.array([t for t, _ in volts])
        rows = np.column_stack([time, *(np.frombuffer(b"".join(x for _, x in one)) for one in (volts, speed))])
        said = np.array([x.decode() for _, x in state])
        starts = np.flatnonzero(np.append(True, said[1:] != said[:-1]))
        ends = np.append(starts[1:], said.size) - 1
        parts = []
        for way in ("quasistatic-forward", "quasistatic-reverse"):
            spans = [(state[a][0], state[b][0]) for a, b in zip(starts, ends, strict=True) if said[a] == way]
            first, last = spans[which]
            parts.append(rows[(time >= first) & (time <= last) & (np.abs(rows[:, 1]) > 0.02)].tolist())
        save(out, name, ramps(parts, (1, 2), 1.0, cut, 8, lowest), dead_band=lowest)


def direct_servo(mirrors: Path, out: Path) -> None:
    """From Cobular/LKMTechCanDriver-Rust (no licence): a motor turns a weighted arm to one place after the other.

    500 Hz, angle (degrees) and the torque that the controller asks for (its own units, sign turned), made even,
    low-pass filtered at 10 Hz; friction = torque − J dω/dt − that of the weight (a sine of the angle), both by least
    squares beside dry and viscous friction and an offset where it turns faster than 0.3 rad/s, the dead band; means of
    10 rows.
    """
    log = git_table(mirrors, "Cobular/LKMTechCanDriver-Rust", "motor_data.csv", delimiter=",", skip_header=1)
    time, angle, drive = even(500.0, log[:, 0], np.radians(log[:, 1]), -log[:, 6])
    angle, drive = smooth(500.0, 10.0, angle), smooth(500.0, 10.0, drive)
    v = np.gradient(angle, 1 / 500)
    on = np.abs(v) > 0.3
    known = np.column_stack([np.gradient(v, 1 / 500), np.sin(angle), np.cos(angle)])
    base = np.column_stack([known, np.sign(v), v, np.ones_like(v)])
    f = drive - known @ np.linalg.lstsq(base[on], drive[on], rcond=None)[0][:3]
    t, v, f, turned = means(10, *(x[1000:-100] for x in (time, v, f, angle)))
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned}
    save(out, "direct_servo", columns, dead_band=0.3)


def balancing_robot(mirrors: Path, out: Path) -> None:
    """From MadsRudolph/REGBOT-Balance (no licence): two wheels of a robot that balances while it drives.

    Every 15 ms, volts of each motor and speed of its wheel (m/s), made even, low-pass filtered at 4 Hz; friction =
    volts − J dω/dt, J by least squares; means of four rows, a dead band of 0.05 m/s. `square_left`, `square_right`:
    round a square; `there_left`, `there_right`: two metres there; both again on another floor a day later.
    """
    for name, file in (
        ("square", "test3b_square_2026-04-21"),
        ("square_later", "test3b_square_0.8ms_v3_onfloor_2026-04-22"),
        ("there", "test4_position_2m_2026-04-21"),
        ("there_later", "test4_position_2m_v3_onfloor_2026-04-22"),
    ):
        text = fetch(mirrors, "MadsRudolph/REGBOT-Balance", f"logs/{file}.txt").decode()
        rows = [line.split() for line in text.splitlines() if line[:1].isdigit()]
        log = np.array([[float(row[k]) for k in (0, 7, 8, 9, 10)] for row in rows if len(row) == len(rows[0])])
        for side, volts, speed in (("left", 1, 3), ("right", 2, 4)):
            time, drive, v = even(1 / 0.015, log[:, 0], log[:, volts], log[:, speed])
            v, f = less_inertia(1 / 0.015, drive, v, 4.0, 0.05)
            t, v, f = means(4, *(x[20:-20] for x in (time, v, f)))
            columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
            save(out, f"{name}_{side}", columns, dead_band=0.05)


def hand_spinner(mirrors: Path, out: Path) -> None:
    """From trspeb/pysplinefit (no licence): a toy that spins down by itself, read from a drawing of its speed.

    Each mark of the drawing is a reading (whole seconds, whole turns a minute); means of the readings of one second,
    from the first to 12 turns a minute; J is not given: 5e-5 kg m².
    """
    text = fetch(mirrors, "trspeb/pysplinefit", "res/n_t.svg").decode()
    marks = re.findall(r'<use style="fill:#0000ff[^>]* x="([\d.]+)"[^>]* y="([\d.]+)"', text)
    at, turns = np.array(marks, dtype=float).T
    seconds, turns = np.round((at - 72.0) / 4.464), (388.8 - turns) / 0.576
    time = np.unique(seconds)
    speed = RPM * np.array([turns[seconds == one].mean() for one in time])
    fast = speed > 12.0 * RPM
    columns = {"time_s": time[fast], "speed_rad_s": speed[fast]}
    save(out, "hand_spinner", columns, {"inertia_kg_m2": 5e-5}, motor_off=True)


def student_bobs(mirrors: Path, out: Path) -> None:
    """From Cali0707/PHY180_Pendulum_Lab and planT-444/phy180-pendulum (no licence): bobs on threads that swing freely.

    Amplitudes with the time of each, filmed; speed = the mean over a swing of period T, 4 √(2 (1 − cos a))/T, which
    runs down as a wheel of J = T²/16 would (in terms of m g l). `bob_degrees`: every 1.4167 s (its period), in steps of
    half a degree, to 0.12 rad; `bob_slowly`: a period of 1.525 s, 36 amplitudes in two minutes, to 0.02 rad.
    """
    text = fetch(mirrors, "Cali0707/PHY180_Pendulum_Lab", "test_data.txt").decode().replace("dy0", "dy\n0")
    steps = np.array([line.split()[:2] for line in text.splitlines() if line[:1].isdigit()], dtype=float)
    file = "input-files/PHY180 Pendulum - Sheet4.csv"
    log = git_table(mirrors, "planT-444/phy180-pendulum", file, delimiter=",", skip_header=1)
    for name, (time, angle), period, smallest in (
        ("bob_degrees", steps.T, 1.4167, 0.12),
        ("bob_slowly", log[:, :2].T, 1.525, 0.02),
    ):
        large = angle > smallest
        columns = {"time_s": time[large], "speed_rad_s": 4.0 * np.sqrt(2.0 - 2.0 * np.cos(angle[large])) / period}
        save(out, name, columns, {"inertia_kg_m2": period**2 / 16}, motor_off=True)


def exercise_bike(mirrors: Path, out: Path) -> None:
    """From MichaelPraskovich/uBike (GPL-3.0): an exercise bike runs down from 60 turns of its cranks a minute.

    Its display, filmed, read in whole turns a minute; two runs at each of two settings of its magnets (`bike_1`,
    `bike_4`), without the last reading, where it shows none; speed of the flywheel, 310/58.3 times as fast,
    J = 0.377 kg m² (a disk of 14.515 kg, 0.456 m wide).
    """
    text = fetch(mirrors, "MichaelPraskovich/uBike", "README.md").decode()
    for level in (1, 4):
        part = text.split(f"<b>Resistance {level}</b>")[1].split("<details>")[0]
        rows = [
            [cell.strip() for cell in line.split("|")[1:4]] for line in part.splitlines() if re.match(r"\| +\d", line)
        ]
        for run, end in ((1, ""), (2, "_again")):
            log = np.array([(row[0], row[run]) for row in rows if row[run] not in ("", "0")], dtype=float)
            columns = {"time_s": log[:, 0], "speed_rad_s": 310 / 58.3 * RPM * log[:, 1]}
            save(out, f"bike_{level}{end}", columns, {"inertia_kg_m2": 0.377}, motor_off=True)


def cobot(mirrors: Path, out: Path) -> None:
    """From SparkyWolf1/python_industrial_automation_homeworks (UR3 CobotOps, CC BY 4.0): a robot at work.

    About once a second the speed (rad/s) and current (A, stands for the torque) of each joint, the first 1500 rows; the
    base turns about a vertical axis (`cobot_base`), the last joint a gripper about its own (`cobot_wrist`), the others
    hold up what is beyond them (`cobot_shoulder`, `cobot_elbow`, `cobot_hand`); `cobot_elbow_later`: from an hour later
    on. Rows slower than 0.05 rad/s are the dead band. How fast the speed changes is not known.
    """
    repo = "SparkyWolf1/python_industrial_automation_homeworks"
    text = fetch(mirrors, repo, "DatasetsTesting/Robot_Data/dataset_02052023.csv").decode().replace(",", ".")
    rows = [line.split(";")[:20] for line in text.splitlines()[1:]]
    for name, joint, first in (
        ("base", 0, 0),
        ("shoulder", 1, 0),
        ("elbow", 2, 0),
        ("elbow_later", 2, 3600),
        ("hand", 3, 0),
        ("wrist", 5, 0),
    ):
        log = [
            (datetime.fromisoformat(row[1][:23]).timestamp(), float(row[14 + joint]), float(row[2 + 2 * joint]))
            for row in rows[first : first + 1500]
            if row[14 + joint] and row[2 + 2 * joint]
        ]
        t, v, f = np.array(log).T
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, f"cobot_{name}", columns, dead_band=0.05)


def grains(mirrors: Path, out: Path) -> None:
    """From JoelJank/RheometerData (no licence): dry glass beads of 0.42 mm in a rheometer, pressed down and sheared.

    Every 0.3 s; torque (mN m) and speed (about 0.005 turns a minute, noisy), means of 10 rows, the first 150 s of each
    pressing: `grains_3kPa`, `grains_6kPa`, `grains_9kPa`.
    """
    path = "Data/Glass/420 micron/9kPa/w0per_dried/w0per_dried.xlsx"
    data = fetch(mirrors, "JoelJank/RheometerData", path)
    for name, number in (("3kPa", 2), ("6kPa", 3), ("9kPa", 4)):
        log = sheet(data, number, "B F H")
        log = log[log[:, 0] < log[0, 0] + 150.0]
        t, f, v = means(10, *log.T)
        columns = {"time_s": t, "speed_rad_s": RPM * v, "friction_torque_Nm": 1e-3 * f}
        save(out, f"grains_{name}", columns)


ALL = (
    lifts_and_wrist,
    direct_servo,
    balancing_robot,
    hand_spinner,
    student_bobs,
    exercise_bike,
    cobot,
    grains,
)

if __name__ == "__main__":
    convert(ALL)
