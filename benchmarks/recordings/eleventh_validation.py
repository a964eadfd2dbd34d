"""The eleventh set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.eleventh_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, filtfilt, find_peaks

from benchmarks.recordings.fifth_validation import amplitudes, loss
from benchmarks.recordings.ninth_validation import RPM
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.validation import convert, means, save

LAB, COMMIT = "brucecui97/mech467", "36dde457"


def table_axis(mirrors: Path, file: str) -> tuple[np.ndarray, ...]:
    """Return time [s], angle of the screw [rad] and motor current [A] of a machine table; 2 kHz, lead of 20 mm."""
    data = io.BytesIO(fetch(mirrors, LAB, f"lab1/Group2/{file}.mat", COMMIT))
    log = loadmat(data, simplify_cells=True)["output"]  # type: ignore[arg-type]
    good = np.append(True, np.diff(log["time"]) > 0.0)
    return log["time"][good], log["CH1out"][good] * 2 * np.pi / 20.0, 0.887 * log["CH1sig"][good]


def ball_screw(mirrors: Path, out: Path) -> None:
    """From brucecui97/mech467 (no licence; commit 36dde45): the table of a machine tool on a ball screw.

    Current = 0.887 A/V of the amplifier's input, K_T 0.72 N m/A, J = 5.9e-4 kg m², the sum of the parts (all of the
    laboratory's manual), angle of the screw from the table's position. `out`, `back`: constant speeds of 15 to 160
    mm/s, means over 0.1 s from 0.15 s after that speed is reached until 0.15 s before it ends, one speed after the
    other. `swung`: a current of about 1 A to and fro, 3.6 s a period, a small sine on it; 25 Hz low pass, 250 Hz.
    """
    clock_end, rows = 0.0, []
    for feed in (15, 20, 25, 30, 35, 40, 50, 60, 80, 100, 120, 140, 160):
        clock, angle, current = table_axis(mirrors, f"Part_A/{feed}")
        speed = np.gradient(np.interp(clock[0] + 5e-4 * np.arange(clock.size), clock, angle), 5e-4)
        for way in (1.0, -1.0):
            on = np.flatnonzero(np.abs(np.convolve(speed, np.ones(20) / 20, "same") - way * feed * np.pi / 10) < 0.5)
            part = slice(int(on[0]) + 300, int(on[-1]) - 300)
            t, v, f = means(200, clock[part] - clock[0], speed[part], 0.72 * current[part])
            rows.append(np.column_stack([np.full(t.size, way), clock_end + t, v, f]))
        clock_end = float(rows[-1][-1, 1]) + 1.0
    table = np.concatenate(rows)
    for name, way in (("out", 1.0), ("back", -1.0)):
        t, v, f = table[table[:, 0] == way, 1:].T
        save(out, f"screw_axis_{name}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})
    wheel = {"inertia_kg_m2": 5.9e-4, "torque_constant_Nm_A": 0.72}
    for name, file in (("a", "Part_C/2"), ("b", "Part_C/5")):
        clock, angle, current = table_axis(mirrors, file)
        even = np.arange(clock[0], clock[np.flatnonzero(current)[-1]], 5e-4)
        low = butter(2, 25.0 / 1000)
        angle, current = (filtfilt(*low, np.interp(even, clock, x))[::8] for x in (angle, current))
        speed = np.gradient(angle, 4e-3)
        part = slice(int(np.flatnonzero(np.abs(speed) > 1.0)[0]), -10)
        columns = {"time_s": even[::8][part], "speed_rad_s": speed[part], "motor_current_A": current[part]}
        save(out, f"screw_axis_swung_{name}", columns, wheel, dead_band=0.5)


def thruster(mirrors: Path, out: Path) -> None:
    """From MateusPedrosa/BlueROV_practical (no licence): an underwater thruster (T200) of Blue Robotics, their data.

    At standstill in water, 200 commands from full astern to full ahead at 10, 14 and 20 V; backwards the speed is
    negative. Torque = voltage · current / speed (the motor's losses in it), above 500 rpm. No times: a row a second.
    """
    data = fetch(mirrors, "MateusPedrosa/BlueROV_practical", "T200-Public-Performance-Data-10-20V-September-2019.xlsx")
    book = zipfile.ZipFile(io.BytesIO(data))
    for sheet, volts in ((2, 10.0), (4, 14.0), (7, 20.0)):
        text = book.read(f"xl/worksheets/sheet{sheet}.xml").decode()
        cells = [re.findall(r'<c r="[ABC]\d+"[^>]*t="n"><v>([^<]*)</v>', row) for row in text.split("<row ")[2:]]
        command, turns, current = np.array([row for row in cells if len(row) == 3], dtype=float).T
        v, time = np.sign(command - 1500.0) * turns * RPM, np.arange(command.size, dtype=float)
        on = turns > 500.0
        f = volts * current[on] / v[on]
        save(out, f"thruster_{volts:.0f}V", {"time_s": time[on], "speed_rad_s": v[on], "friction_torque_Nm": f})


def half_swings(
    clock: np.ndarray, angle: np.ndarray, tops: np.ndarray, reach: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the loss of K θ²/2 between two turning points over the way, in terms of K, and each half swing's size.

    Turning points are vertices of parabolas over `reach` rows on each side, their middle a median of three at a time.
    """
    rows = []
    for k in tops[(tops > reach) & (tops < angle.size - reach - 1)]:
        w = slice(k - reach, k + reach + 1)
        c = np.polyfit(clock[w] - clock[k], angle[w], 2)
        rows.append((clock[k] - c[1] / (2 * c[0]), c[2] - c[1] ** 2 / (4 * c[0])))
    at, top = np.array(rows).T
    alternate = np.append(True, np.sign(top[1:]) != np.sign(top[:-1]))
    at, top = at[alternate], top[alternate]
    top -= np.median((top[:-2] + 2 * top[1:-1] + top[2:]) / 4)
    way = np.diff(top)
    loss = (top[:-1] ** 2 - top[1:] ** 2) / 2 / way
    columns = {"time_s": (at[1:] + at[:-1]) / 2, "speed_rad_s": way / np.diff(at), "friction_torque_Nm": loss}
    return columns, np.abs(way) / 2


def of_two(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the mean of each half swing and the next, one way."""
    return {key: (np.abs(x[1:]) + np.abs(x[:-1])) / 2 for key, x in columns.items()}


def torsion_wheel(mirrors: Path, out: Path) -> None:
    """From GuenterQuast/PhyPraKit (GPL-3): a wheel on a spiral spring (Pohl's wheel) swinging, CASSY at 100 Hz.

    Arc in steps of 1 mm over 91.9 mm. Loss of K θ²/2 between two turning points over the way, in terms of K; the
    turning points are vertices of parabolas over 41 rows, their middle a median of three at a time. `half_swings`;
    `swings`: means of two.
    """
    text = fetch(mirrors, "GuenterQuast/PhyPraKit", "examples/Drehpendel.labx").decode()
    channels = re.findall(r"<channel [^>]*>(.*?)</channel>", text, re.DOTALL)
    clock, arc = (np.array(re.findall(r"<value>(.*?)</value>", channels[k]), dtype=float) for k in (1, 3))
    angle = arc / 0.0919
    tops = np.sort(np.concatenate([find_peaks(way * angle, distance=60, height=0.06)[0] for way in (1, -1)]))
    columns, _ = half_swings(clock, angle, tops, 20)
    save(out, "torsion_wheel_half_swings", columns, dead_band=0.05)
    save(out, "torsion_wheel_swings", of_two(columns))


def stand(mirrors: Path, out: Path) -> None:
    """From noahcurtiss/Motor_Tests (no licence): propellers on a thrust stand, 24 commands one after the other.

    Robbe Roxxy 2827-35 with 10x4.5 and T-Motor MN3110-17 with 10x4.7, 36 s a command. Speed = 780/12 rpm a step, torque
    = voltage · current / speed (the motor's losses in it), means of 25 rows (2.6 s) from the 50th of a command on,
    above 2500 rpm; current in steps of 0.1 A.
    """
    for name, file in (
        ("robbe_11V", "robbe/robbe11.2"),
        ("robbe_12V", "robbe/robbe12.4"),
        ("tiger_11V", "tiger/tiger11.2"),
    ):
        log = git_table(mirrors, "noahcurtiss/Motor_Tests", f"{file}.txt")
        log = log[(log[:, 1] < 250) & (log[:, 6] > 90)]
        rows = []
        for command in np.unique(log[:, 0])[1:]:
            at = np.flatnonzero(log[:, 0] == command)[50:]
            turns, amperes, volts = means(25, log[at, 4] * 65.0, log[at, 1] / 10.0, log[at, 6] / 10.0)
            clock = 0.103 * means(25, at.astype(float))[0]
            rows.append(np.column_stack([clock, turns * RPM, volts * amperes]))
        t, v, power = np.concatenate(rows).T
        on = v > 2500 * RPM
        save(out, f"stand_{name}", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": power[on] / v[on]})


def tribometer(mirrors: Path, out: Path) -> None:
    """From jchristopherson/FrictionModels.jl (MIT): a pin pressed on a plate with 5 N, strokes of 0.23 mm to and fro.

    Force in N and position in mm (they stand for torque and angle) at 200 Hz, 0.22 mm/s for a second, then a second of
    rest. Position low-pass filtered at 8 Hz, means of 4 rows, two parts of 40 s.
    """
    log = git_table(mirrors, "jchristopherson/FrictionModels.jl", "examples/test_data_2.txt", skip_header=1)
    even = np.arange(log[0, 0], log[-1, 0], 0.005)
    place, force = (np.interp(even, log[:, 0], log[:, k]) for k in (2, 3))
    speed = np.gradient(filtfilt(*butter(2, 0.08), place), 0.005)
    for name, start in (("early", 30.0), ("late", 150.0)):
        part = (even >= start) & (even < start + 40.0)
        t, v, f = means(4, even[part], speed[part], -force[part] / 1e6)
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, f"tribometer_{name}", columns, dead_band=0.03)


def rods(mirrors: Path, out: Path) -> None:
    """From dat07032002/pendulum_on_board and pendulum_moving_board (no licence): a rod swinging on its bearing.

    200 Hz, 4096 steps a turn, low-pass filtered at 8 Hz, from 0.05 s after the rod is let go until it rests. Friction =
    −J (dω/dt + w² sin θ + c cos θ), J = 5.06e-5 kg m² (27 g, 75 mm), w² and c by least squares beside dry and viscous
    friction where it moves faster than 0.3 rad/s (w² 203 to 204 1/s²). `new`: the bearing was changed; means of 2.
    """
    for name, repo, file in (
        ("rod_old", "dat07032002/pendulum_on_board", "swing3"),
        ("rod_old_less", "dat07032002/pendulum_on_board", "swing2"),
        ("rod_new", "dat07032002/pendulum_moving_board", "swing3"),
        ("rod_new_less", "dat07032002/pendulum_moving_board", "swing2"),
    ):
        log = git_table(mirrors, repo, f"{file}.csv", delimiter=",", skip_header=1)
        angle = filtfilt(*butter(2, 0.08), log[:, 1] - np.median(log[-100:, 1]))
        speed = np.gradient(angle, 0.005)
        rate, on = np.gradient(speed, 0.005), np.abs(speed) > 0.3
        on[:10] = False
        base = np.column_stack([np.sin(angle), np.cos(angle), np.sign(speed), speed])
        pull = base[:, :2] @ np.linalg.lstsq(base[on], -rate[on], rcond=None)[0][:2]
        part = slice(10, int(np.flatnonzero(on)[-1]))
        t, v, f = means(2, log[part, 0], speed[part], -5.06e-5 * (rate + pull)[part])
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, name, columns, {"inertia_kg_m2": 5.06e-5}, dead_band=0.2)


def robot_motors(mirrors: Path, out: Path) -> None:
    """From tarasz98/Robot_cup_Saga (no licence): geared motors of small robots (Regbot), two steps of the voltage.

    Left motor, 1 kHz: current, and speed of the wheel in m/s, both low-pass filtered at 15 Hz. Friction = current − J
    dv/dt in A, J by least squares beside dry and viscous friction; above 0.15 m/s.
    """
    for name in ("24", "30"):
        text = fetch(mirrors, "tarasz98/Robot_cup_Saga", f"Pi/regbot/matlab/rev2b/vel_step_{name}.txt").decode("latin1")
        lines = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("%")]
        log = np.array([[float(word) for word in line[:10]] for line in lines])
        current, speed = (filtfilt(*butter(2, 0.03), log[:, k]) for k in (6, 8))
        rate, on = np.gradient(speed, 0.001), speed > 0.15
        base = np.column_stack([rate, np.ones_like(speed), speed])
        inertia = float(np.linalg.lstsq(base[on], current[on], rcond=None)[0][0])
        t, v, f, i = means(2, log[on, 0], speed[on], (current - inertia * rate)[on], current[on])
        table = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "motor_torque_Nm": i}
        save(out, f"robot_{name}", table, {"inertia_kg_m2": round(inertia, 5)})


def torque_rig(mirrors: Path, out: Path) -> None:
    """From Brojowski/uas (no licence): aircraft propellers of three blades on a rig with a torque cell (RCbenchmark).

    Motors KDE4215XF and "T", commands in stairs up, 45 Hz: torque (lbf ft, sign turned) less what the cell reads before
    the start, optical speed, means of 25 rows (0.56 s) above 1500 rpm.
    """
    for name, file in (("rig_kde", "KDE4215XF_Red_Tri_2019-11-25_124441"), ("rig_t", "T_Red Tri_2019-11-18_111145")):
        rows = fetch(mirrors, "Brojowski/uas", f"AIAA_DBF/{file}.csv").decode("utf8").splitlines()[1:]
        log = np.array([[float(row.split(",")[k] or "nan") for k in (0, 7, 3)] for row in rows])
        log = log[np.isfinite(log).all(1)]
        start = int(np.flatnonzero(log[:, 1] > 500.0)[0])
        torque = -1.35582 * (log[:, 2] - np.median(log[: start - 10, 2]))
        t, turns, f = means(25, log[:, 0], log[:, 1], torque)
        on = turns > 1500.0
        save(out, name, {"time_s": t[on], "speed_rad_s": turns[on] * RPM, "friction_torque_Nm": f[on]})


def foucault(mirrors: Path, out: Path) -> None:
    """From FrancescoScandiffio/Foucault-pendulum-tracking-system (no licence): a bob on a wire, filmed at about 9 Hz.

    Pixels along the direction of the swing, which turns by 0.1 degrees a minute (that of the most motion within 400
    rows); windows of eight periods from 60 s on. Loss of a²/2 over the way, in terms of the restoring force a pixel.
    """
    repo, file = "FrancescoScandiffio/Foucault-pendulum-tracking-system", "2021_09_17_14_57_N.csv"
    log = git_table(mirrors, repo, file, delimiter=";", skip_header=1)
    place, along = log[:, 1:] - np.median(log[:, 1:], axis=0), np.empty(len(log))
    for k in range(0, len(log), 200):
        axis = np.linalg.eigh(np.cov(place[max(k - 100, 0) : k + 300].T))[1][:, 1]
        along[k : k + 200] = place[k : k + 200] @ axis * np.sign(axis[0])
    late = log[:, 0] > 60.0
    table = amplitudes(log[late, 0], along[late], 8, 2.8, 20.0)
    save(out, "foucault_bob", loss(table, table[:, 1] ** 2 / 2))


def cogging_motor(mirrors: Path, out: Path) -> None:
    """From gchenfc/ODrive (MIT; commit 5461155): a bare motor turned slowly by its controller, without compensation.

    Current in A stands for the torque (the rotor's inertia is not taken off), angle of 8192 steps a turn, low-pass
    filtered at 20 Hz for the speed. One turn at 0.1 and at 0.03 turns/s, 430 Hz, means of 4 and 8 rows.
    """
    for name, file, count in (
        ("cogging_slow_turn", "slow2/nocomp_0", 4),
        ("cogging_slower_turn", "slow2_slower/nocomp_0", 8),
    ):
        data = fetch(mirrors, "gchenfc/ODrive", f"analysis/cogging_torque/{file}.npy", "54611550")
        clock, place, current = np.load(io.BytesIO(data), allow_pickle=False)
        step = float(np.median(np.diff(clock)))
        even = np.arange(clock[0], clock[-1], step)
        angle = filtfilt(*butter(2, 20.0 * 2 * step), np.interp(even, clock, place * 2 * np.pi / 8192))
        t, v, i = means(count, even, np.gradient(angle, step), np.interp(even, clock, current))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": i}
        save(out, name, {key: x[10:-10] for key, x in columns.items()}, dead_band=0.01)


ALL = (ball_screw, thruster, torsion_wheel, stand, tribometer, rods, robot_motors, torque_rig, foucault, cogging_motor)

if __name__ == "__main__":
    convert(ALL)
