"""The eighth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.eighth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: some of it has no licence.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, filtfilt, find_peaks

from benchmarks.recordings.fifth_validation import amplitudes, loss
from benchmarks.recordings.second_validation import fetch
from benchmarks.recordings.third_validation import half_swings
from benchmarks.recordings.validation import convert, means, save, slope

RPM, DEGREE = np.pi / 30, np.pi / 180
TRACKER = "data_sorting/pendulum_data_from_tracker"
GENERATOR = "mistral2e/Piggott_APSM_monitoring"
CHAIN = "DukeElectricVehicles/DEV_embeddedfirmware"
BEFORE_MOVE = "b325f09d4adbc247476e126b85dbe7f01f8cc34a^"  # later the recordings went to another repository
PENDULUM = "bd9cede842a36f0723c255574eede7d88907c530"
WATER = "5dddeb2ff5efd303237795091179ab710b7bbe87"
TWO_ARMS = "dfki-ric-underactuated-lab/double_pendulum"


def chain_flywheel(mirrors: Path, out: Path) -> None:
    """From DukeElectricVehicles/DEV_embeddedfirmware (no licence): flywheel of a dynamometer and a hub on its chain.

    Running down, no current: hub without its magnets (`chain_bare`; `_again`, chain left loose; `_tight`, tensioned too
    much; `_loose`, then loosened), with them (`_magnets`), and days later (`_day_later`; `_reversed`, turned round),
    stopped at half of the speed. The flywheel is that of the development recordings, with another motor and other days.
    Speed of the flywheel in rpm, 54 readings a turn at most, means over 0.5 s; zeros and readings 2 % off the median of
    51 dropped. J = 0.8489 kg m². From 5 s after the fastest row to 10 rpm.
    """
    for name, file in (
        ("chain_bare", "spindown/spindown_noRotor"),
        ("chain_bare_again", "spindown/spindown_noRotor_3"),
        ("chain_tight", "spindown/spindown_noRotor_4"),
        ("chain_loose", "spindown/spindown_noRotor_5"),
        ("chain_magnets", "12V_DEVsensorless/spindown_withRotor"),
        ("chain_reversed", "spindown/spindown_noRotor_may28_after_flippedDir"),
        ("chain_day_later", "spindown/spindown_noRotor_may28_after"),
    ):
        text = fetch(mirrors, CHAIN, f"DynoData/MITSUBA/{file}.txt", BEFORE_MOVE).decode()
        lines = [line.split() for line in text.splitlines()]
        rows = np.array([[float(x) for x in line] for line in lines if len(line) == 9])
        time, speed = rows[:, 5] / 1e3, rows[:, 3] * RPM
        good = (speed > 0.0) & np.append(np.diff(time) > 0.0, True)
        time, speed = time[good], speed[good]
        middle = np.array([np.median(speed[max(k - 25, 0) : k + 26]) for k in range(speed.size)])
        if name in ("chain_reversed", "chain_day_later"):  # one reading a tooth: means over a turn
            middle = np.convolve(speed, np.ones(54) / 54, "same")
            first = int(middle[54:-54].argmax()) + 54
        else:
            first = int(middle.argmax())
            near = np.abs(speed / middle - 1) < 0.02
            time, speed, middle, first = time[near], speed[near], middle[near], int(near[:first].sum())
        first += int(np.searchsorted(time[first:], time[first] + 5.0))
        slow = np.flatnonzero(middle[first:] < 10 * RPM)
        last = first + (int(slow[0]) if slow.size else speed.size)
        t, v = bins(0.5, time[first:last], speed[first:last])
        save(out, name, {"time_s": t, "speed_rad_s": v}, {"inertia_kg_m2": 0.8489}, True, 0.5)


def bins(width: float, time: np.ndarray, *columns: np.ndarray) -> list[np.ndarray]:
    """Return the means of the rows in each slot of time; empty slots are left out."""
    slot = np.floor((time - time[0]) / width).astype(int)
    count = np.bincount(slot)
    return [(np.bincount(slot, c)[count > 0] / count[count > 0]) for c in (time, *columns)]


def two_arms(mirrors: Path, out: Path) -> None:
    """From dfki-ric-underactuated-lab/double_pendulum (BSD-3): two arms below each other, each with a geared motor.

    Motors T-Motor AK80-6 (6:1). A path over 75 s that covers the whole turn. Angles low-pass filtered at 10 Hz,
    speeds and accelerations from them, torque (current) filtered alike; rigid body (five terms) off by least squares
    over both joints beside friction (dry, viscous, by the load) and an offset each, where they
    move; the motor torque stays beside it. Means of 5 rows.
    """
    for name, file in (("arms_slow", "design_A.0/20220812/sys_id/20220812-061157-PM_measured"),):
        text = fetch(mirrors, TWO_ARMS, f"data/experiment_records/{file}.csv")
        head = text.split(b"\n")[0].decode().strip().split(",")
        rows = np.genfromtxt(io.BytesIO(text), delimiter=",", skip_header=1)
        how = "_meas" if "pos_meas1" in head else ""
        stamp = rows[:, head.index("time")]
        step = (stamp[-1] - stamp[0]) / (len(stamp) - 1)
        time = stamp[0] + step * np.arange(len(stamp))
        filt = butter(2, 10.0 * 2 * step)
        wanted = (f"pos{how}1", f"pos{how}2", f"tau{how}1", f"tau{how}2")
        q1, q2, f1, f2 = (filtfilt(*filt, np.interp(time, stamp, rows[:, head.index(key)])) for key in wanted)
        v1, v2 = np.gradient(q1, step), np.gradient(q2, step)
        a1, a2, none, one = np.gradient(v1, step), np.gradient(v2, step), np.zeros_like(time), np.ones_like(time)
        cos, sin = np.cos(q2), np.sin(q2)
        inertial = cos * (2 * a1 + a2) - sin * (2 * v1 * v2 + v2**2)
        body = np.vstack(
            [
                np.column_stack([a1, inertial, a1 + a2, np.sin(q1), np.sin(q1 + q2)]),
                np.column_stack([none, cos * a1 + sin * v1**2, a1 + a2, none, np.sin(q1 + q2)]),
            ]
        )
        dry = [np.column_stack([np.sign(v), v, one, np.sign(v) * np.abs(f)]) for v, f in ((v1, f1), (v2, f2))]
        base = np.hstack([body, np.vstack([dry[0], 0 * dry[1]]), np.vstack([0 * dry[0], dry[1]])])
        inside = (np.arange(time.size) > 100) & (np.arange(time.size) < time.size - 100)
        use = np.concatenate([inside & (np.abs(v) > 0.02) for v in (v1, v2)])
        torque = np.concatenate([f1, f2])
        friction = torque - body @ np.linalg.lstsq(base[use], torque[use], rcond=None)[0][:5]
        for joint, v, motor, f in ((1, v1, f1, friction[: time.size]), (2, v2, f2, friction[time.size :])):
            t, speed, motor, f = means(5, *(column[100:-100] for column in (time, v, motor, f)))
            columns = {"time_s": t, "speed_rad_s": speed, "friction_torque_Nm": f, "motor_torque_Nm": motor}
            save(out, f"{name}_joint{joint}", columns, dead_band=0.02)


def rolling_pendulum(mirrors: Path, out: Path) -> None:
    """From DukeElectricVehicles/DEV_embeddedfirmware (no licence): an axle with two bicycle wheels and a weight below.

    It rolls to and fro on a floor (rolling resistance of tyres); roll angle from an inertial unit at 20 Hz. Several
    releases a file, each from 1.1 rad on down to 0.1 rad: loss of 1 − cos a over the way, from windows of one period.
    Friction in terms of m g l (29.7 kg · 9.8 m/s² · 43.1 mm).
    """
    for name, file in (
        ("tyres_100", "VPPC_blackblack_100"),
        ("tyres_80", "VPPC_blackblack_80"),
        ("tyres_60", "VPPC_blackblack_60"),
        ("tyres_left", "blackblack_6_21_left"),
        ("tyres_right", "blackblack_6_21_right"),
        ("tyres_alum", "blackblue50_alum"),
    ):
        text = fetch(mirrors, CHAIN, f"Pendulum/FusionIMU/{file}.txt", PENDULUM).decode()
        lines = [line.split() for line in text.splitlines()]
        rows = np.array([[float(x) for x in line] for line in lines if len(line) == 7])
        rows = rows[rows[:, 0] > np.maximum.accumulate(np.append(-1.0, rows[:-1, 0]))]
        time, angle = rows[:, 0] / 1e3, np.radians(rows[:, 3])
        angle = angle - np.median(angle)
        tops = find_peaks(angle, distance=40, height=0.08)[0]
        starts = [k for n, k in enumerate(tops) if angle[k] > 1.1 and (n == 0 or angle[tops[n - 1]] < 0.8 * angle[k])]
        tables = []
        for n, first in enumerate(starts):
            last = starts[n + 1] if n + 1 < len(starts) else time.size
            begin = next((k for k in tops if k >= first and angle[k] < 1.1), first)
            low = next((k for k in tops if k > begin and (angle[k] < 0.1 or k >= last)), last)
            if low - begin < 300:
                continue
            part = slice(begin, min(low, last))
            middle = np.median(angle[max(part.stop - 120, begin) : part.stop])
            table = amplitudes(time[part], angle[part] - middle, 1, 2.9, 0.1)
            table = table[(table[:, 1] > 0.1) & (table[:, 1] < 1.2)]
            if len(table) > 5:
                tables.append(loss(table, -np.cos(table[:, 1])))
        save(out, name, {key: np.concatenate([table[key] for table in tables]) for key in tables[0]})


def water_rower(mirrors: Path, out: Path) -> None:
    """From laberning/openrowingmonitor (GPL-3.0): paddle of a water rower (WRX700).

    Between two pulls: turns after the fastest of a stroke and before the next pull, less one at each end; friction =
    −J dω/dt, the slope of a parabola through three rows. J is set to 1 kg m² (scales everything
    alike). The first strokes.
    """
    text = fetch(mirrors, "laberning/openrowingmonitor", "recordings/WRX700_2magnets_session.csv", WATER)
    pulse = np.cumsum(np.genfromtxt(io.BytesIO(text)))[::2]
    time, speed = (pulse[1:] + pulse[:-1]) / 2, 2 * np.pi / np.diff(pulse)
    falls = np.diff(speed, append=speed[-1]) < 0
    turning = np.flatnonzero(np.diff(np.concatenate([[False], falls, [False]]).astype(int)))
    parts = []
    for first, last in zip(turning[::2] + 1, turning[1::2], strict=True):
        if last - first > 3:
            rows, rate = slope(time[first:last], speed[first:last], 1)
            parts.append(np.column_stack([time[first + rows], speed[first + rows], -rate]))
    table = np.vstack(parts[2:92])
    columns = {"time_s": table[:, 0], "speed_rad_s": table[:, 1], "friction_torque_Nm": table[:, 2]}
    save(out, "water_strokes", columns, {"inertia_kg_m2": 1.0})


def threads(mirrors: Path, out: Path) -> None:
    """From four repositories of a course at the University of Toronto: bobs on threads, filmed at 12 to 60 Hz.

    JLefebvre55/PHY180-Pendulum (MIT), YYZ-CR/PHY180 (MIT), BY-Chai/PHY180-Projects and zjs0221/PHY180-Pendulum-Project
    (no licence). As in the seventh set: loss of 1 − cos a over the way, from windows of one period
    or more. Friction in terms of m g l, which is not given.
    """
    for name, repo, file, periods, smallest, turn in (
        ("film_wide", "JLefebvre55/PHY180-Pendulum", "data/q2_data.txt", 4, 0.3, 1.0),
        ("film_quarter", "YYZ-CR/PHY180", f"lab 1/old lab 1/{TRACKER}.txt", 2, 0.28, DEGREE),
        ("film_narrow", "YYZ-CR/PHY180", f"{TRACKER}_copy.txt", 2, 0.1, DEGREE),
        ("film_long", "BY-Chai/PHY180-Projects", "Pendulum Project/Long video data/45deg_long.txt", 2, 0.2, DEGREE),
        ("film_60cm", "BY-Chai/PHY180-Projects", "Pendulum Project/60cm.txt", 2, 0.075, DEGREE),
        ("film_low", "zjs0221/PHY180-Pendulum-Project", "report02/Amplitude vs Time 11.txt", 3, 0.02, 1.0),
        ("film_low_other", "zjs0221/PHY180-Pendulum-Project", "report02/Amplitude vs Time 08.txt", 3, 0.02, 1.0),
    ):
        rows = np.genfromtxt(io.BytesIO(fetch(mirrors, repo, file)), skip_header=1, invalid_raise=False, usecols=(0, 1))
        rows = rows[np.isfinite(rows).all(1)]
        rows = rows[rows[:, 0] > np.maximum.accumulate(np.append(-1.0, rows[:-1, 0]))]
        angle = turn * (rows[:, 1] - np.median(rows[:, 1]))
        up = np.flatnonzero((angle[1:900] > 0) & (angle[: angle[1:900].size] <= 0))
        table = amplitudes(rows[:, 0], angle, periods, float(np.median(np.diff(rows[up, 0]))), smallest)
        table = table[table[:, 1] > smallest]
        save(out, name, loss(table, -np.cos(table[:, 1])))


def bench_pendulum(mirrors: Path, out: Path) -> None:
    """From dynamicslab/MultiArm-Pendulum (MIT): an arm on ball bearings swinging freely, encoder, 1 kHz.

    Six releases (SinglePendulumDataForParameterEstimation), one after the other with 20 s between: loss of 1 − cos a
    between two turning points over the way, in terms of m g l. `_half_swings` has directions, `_swings` joins to
    and fro.
    """
    file = "ParameterEstimation/SinglePendulum/SinglePendulumDataForParameterEstimation.mat"
    data = loadmat(io.BytesIO(fetch(mirrors, "dynamicslab/MultiArm-Pendulum", file)))  # type: ignore[arg-type]
    parts = []
    for key in ("id", "vad"):
        for stamp, y in zip(data[f"Time_{key}"].ravel(), data[f"Y_{key}"].ravel(), strict=True):
            angle = y[0] - np.pi * round(np.median(y[0][-1500:]) / np.pi)
            time = stamp.ravel()[: angle.size]
            parts.append(half_swings(time - time[0], angle - np.median(angle[-1500:]), 1.0, 12, 0.03))
    late = np.cumsum([0.0] + [part["time_s"][-1] + 20.0 for part in parts[:-1]])
    columns = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    columns["time_s"] = np.concatenate([part["time_s"] + more for part, more in zip(parts, late, strict=True)])
    save(out, "bench_half_swings", columns, dead_band=0.03)
    both = []  # means of a swing and the next within a release
    for part, more in zip(parts, late, strict=True):
        size = np.abs(np.column_stack([part["speed_rad_s"], part["friction_torque_Nm"]]))
        both.append(
            np.column_stack([(part["time_s"][1:] + part["time_s"][:-1]) / 2 + more, (size[1:] + size[:-1]) / 2])
        )
    t, v, f = np.concatenate(both).T
    save(out, "bench_swings", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def generator(mirrors: Path, out: Path) -> None:
    """From mistral2e/Piggott_APSM_monitoring (GPL-3.0): axial-flux generator of a small wind turbine, open circuit.

    Brought up by a cordless screwdriver and running down on a stand, 12 poles, no load. Zero crossings of one phase by
    a cycle counter at 160 MHz, 24 edges a turn: speed over whole turns (so that spacing cancels), a row each half
    turn, from 0.5 s after the fastest to 4.5 rad/s. J is not given: 1 kg m² (scales everything alike).
    """
    for name, file in (
        ("generator_a", "172245"),
        ("generator_b", "191148"),
        ("generator_d", "192213"),
        ("generator_e", "170724"),
    ):
        text = fetch(mirrors, GENERATOR, f"measurement_data/20210527/ZC/Lines_20210527_{file}.csv")
        lines = [line.split(";")[:3] for line in text.decode().splitlines()[1:]]
        rows = np.array([[float(x) for x in line] for line in lines if len(line) == 3])
        count = rows[:, 2]
        time = (count + np.cumsum(np.append(0, np.diff(count) < -(2**31))) * 2.0**32) / 160e6
        edge = time[rows[:, 1] == 1]
        edge = edge[np.append(True, np.diff(edge) > 0.0)]
        speed, middle = 2 * np.pi / (edge[24:] - edge[:-24]), (edge[24:] + edge[:-24]) / 2
        first = int(np.flatnonzero(speed > 0.99 * np.median(np.sort(speed)[-40:]))[-1])
        first = int(np.searchsorted(middle, middle[first] + 0.5))
        ends = np.flatnonzero((speed[first:] < 4.5) | (np.append(np.diff(speed[first:]), 0) > 0.3))
        part = slice(first, first + int(ends[0]) if ends.size else None, 12)
        save(out, name, {"time_s": middle[part], "speed_rad_s": speed[part]}, {"inertia_kg_m2": 1.0}, True, 0.5)


ALL = (chain_flywheel, rolling_pendulum, two_arms, water_rower, threads, bench_pendulum, generator)

if __name__ == "__main__":
    convert(ALL)
