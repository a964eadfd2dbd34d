"""The twentieth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.twentieth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import io
import json
import re
import warnings
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import even, ramps, smooth
from benchmarks.recordings.second_validation import fetch
from benchmarks.recordings.validation import convert, means, save


def logged(data: bytes) -> list[np.ndarray]:
    """Return the long columns of numbers inside what Matlab calls an object, in the order in which the file has them.

    The file keeps them as plain elements: the kind (7 single, 9 double), the bytes, the numbers.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        inside = loadmat(io.BytesIO(data))["__function_workspace__"].tobytes()  # type: ignore[arg-type]
    found: dict[int, np.ndarray] = {}
    for kind, number in ((7, np.dtype("<f4")), (9, np.dtype("<f8"))):
        for match in re.finditer(re.escape(kind.to_bytes(4, "little")), inside):
            first = match.start() + 8
            size = int.from_bytes(inside[first - 4 : first], "little")
            if first % 8 == 0 and 40000 <= size <= len(inside) - first and size % number.itemsize == 0:
                found[first] = np.frombuffer(inside, number, size // number.itemsize, first).astype(float)
    return [found[first] for first in sorted(found)]


def less_inertia(
    rate: float, drive: np.ndarray, speed: np.ndarray, cut: float, lowest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return speed and friction = drive − J dω/dt, both low-pass filtered at `cut` (Hz).

    J by least squares beside dry and viscous friction and an offset, where it turns faster than the lowest speed.
    """
    drive, speed = smooth(rate, cut, drive), smooth(rate, cut, speed)
    slope, on = np.gradient(speed, 1 / rate), np.abs(speed) > lowest
    base = np.column_stack([slope, np.sign(speed), speed, np.ones_like(speed)])
    inertia = float(np.linalg.lstsq(base[on], drive[on], rcond=None)[0][0])
    return speed, drive - inertia * slope


def gear_motor_current(mirrors: Path, out: Path) -> None:
    """From MINIFI2548/FRA233_Lab1_System_Identification (no licence): a geared motor, its current measured.

    2 kHz (as its aligned files have it): speed as logged and current (A, stands for the torque, what the sensor shows
    at rest left in). `amp_ramp`, `amp_ramp_again`: a voltage that rises to 12 V in 12 s, low-pass filtered at 2 Hz,
    means of 0.1 s, from half a second after 10 rad/s on; `amp_sine`, `amp_sine_again`: one that swings about once a
    second, while it does, filtered at 20 Hz, means of 20 ms; the filter smears what turns with the sign, so that 30
    rad/s are the dead band.
    """
    repo = "MINIFI2548/FRA233_Lab1_System_Identification"
    for name, file, cut, count in (
        ("amp_ramp", "ramp 1", 2.0, 200),
        ("amp_ramp_again", "ramp 2", 2.0, 200),
        ("amp_sine", "sine1hz 1", 20.0, 40),
        ("amp_sine_again", "sine1hz 2", 20.0, 40),
    ):
        volts, speed, current = logged(fetch(mirrors, repo, f"Raw Signal/{file}.mat"))[:3]
        driven = np.flatnonzero(np.abs(volts) > 0.1)
        v, f = less_inertia(2000.0, current, speed, cut, 30.0)
        first = driven[0] + 400 if "sine" in name else int(np.flatnonzero(v < 10.0)[-1]) + 1000
        t, v, f = means(count, *(x[first : driven[-1] - 1000] for x in (np.arange(v.size) / 2000.0, v, f)))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, name, columns, dead_band=30.0 if "sine" in name else None)


def gear_motor_voltage(mirrors: Path, out: Path) -> None:
    """From Korn-XD/Control_LAB_1 (no licence): another team's motor of that kind, only its voltage logged.

    1 kHz (as the periods of its sines have it); volts stand for the torque (what the turning motor induces is its
    viscous part), filtered at 20 Hz, means of 40 ms from the first second on, a dead band as above. `volt_sine`,
    `volt_sine_again`: a period of 4 s; `volt_sine_faster`: of 2 s.
    """
    for name, run in (
        ("volt_sine", "20-01-36_Sine_pi%2"),
        ("volt_sine_again", "20-04-24_Sine_pi%2"),
        ("volt_sine_faster", "20-06-51_Sine_pi"),
    ):
        file = f"Lab_Results/New/2026-02-06_{run}/Raw_Data.mat"
        speed, volts = logged(fetch(mirrors, "Korn-XD/Control_LAB_1", file))[:2]
        last = int(np.flatnonzero(np.abs(volts) > 0.1)[-1])
        v, f = less_inertia(1000.0, volts[:last], speed[:last], 20.0, 30.0)
        t, v, f = means(40, *(x[1000:-200] for x in (np.arange(v.size) / 1000.0, v, f)))
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=30.0)


def robots(mirrors: Path, out: Path) -> None:
    """From four teams of robots (no licence): voltage in slow ramps, one way, then the other, by one logger, 200 Hz.

    As in `fifteenth_validation`, units as the logs have them, low-pass filtered at 2 Hz (the speed is noisier than the
    volts, which are set), means of 20 rows.
    `turning_left`, `turning_right` (HuskiesProg/IR_Dev): on the spot; `robot_i_left` (the same robot), `robot_j_left`,
    `robot_j_right` (Spectrum3847/2023-X-Ray), `robot_k_left` (FRC-4277/2022RapidReact), `robot_l_left`
    (Fenix4947-2015/robot2022): straight on.
    """
    husky, x_ray = "HuskiesProg/IR_Dev", ("Spectrum3847/2023-X-Ray", "sysID/sysid_data20230329-163900.json")
    turn = ".SysId/Data/sysid_data_angular20230215-191403.json"
    for name, repo, file, volt, speed_at, lowest in (
        ("turning_left", husky, turn, 1, 5, 0.05),
        ("turning_right", husky, turn, 2, 6, 0.05),
        ("robot_i_left", husky, ".SysId/Data/sysid_data_drive20230215-191256.json", 1, 5, 0.05),
        ("robot_j_left", *x_ray, 1, 5, 0.1),
        ("robot_j_right", *x_ray, 2, 6, 0.1),
        ("robot_k_left", "FRC-4277/2022RapidReact", "sysid-profiles/sysid_data20220305-161705.json", 1, 5, 0.05),
        ("robot_l_left", "Fenix4947-2015/robot2022", "sysid_data20220407-182834.json", 1, 5, 0.05),
    ):
        logs = json.loads(fetch(mirrors, repo, file))
        columns = ramps(
            [logs[run] for run in ("slow-forward", "slow-backward")], (volt, speed_at), 1.0, 2.0, 20, lowest
        )
        save(out, name, columns, dead_band=lowest)


def servo_lifts(mirrors: Path, out: Path) -> None:
    """From spfrommer/servo-experiment (no licence): a hobby servo that turns a weight up three times, and down slower.

    Position (degrees) and current of its supply (A, stands for the torque; its sign is here that of the motion), made
    even at 400 Hz, low-pass filtered at 4 Hz, means of 20 rows, 0.1 s left out at both ends of each run; the weights:
    none (`servo_lift_0`), 200, 400 and 650 g.
    """
    for weight in (0, 200, 400, 650):
        clock, parts = 0.0, []
        for run in range(6):
            file = f"processed/processed{weight}-{run}.txt"
            log = np.array(fetch(mirrors, "spfrommer/servo-experiment", file).split(), dtype=float).reshape(-1, 3)
            time, angle, current = even(400.0, 1e-3 * log[:, 0], np.radians(log[:, 1]), log[:, 2])
            speed, current = smooth(400.0, 4.0, np.gradient(angle, 1 / 400)), smooth(400.0, 4.0, current)
            part = (clock + time, speed, (-1.0) ** run * current)
            parts.append(means(20, *(x[40:-40] for x in part)))
            clock += float(time[-1] - time[0]) + 1.0
        t, v, f = np.concatenate(parts, axis=1)
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, f"servo_lift_{weight}", columns, dead_band=0.1)


def wheelchair(mirrors: Path, out: Path) -> None:
    """From fei-nta/Propulsion-Raw-Data (no licence): a wheelchair that rolls on after a few pushes.

    240 Hz, the wheel's angle (4096 to a turn) and the moment about its axle that the wheel's own sensor reads while no
    hand is on the rim; both low-pass filtered at 5 Hz, means of six rows, the way it rolls made positive.
    `chair_left`, `chair_right`: both wheels in trial 9, from 3 s; `chair_left_before`: trial 8, from 2.2 s. The last
    third of a second is left out.
    """
    for name, file, first in (
        ("left", "trial-09/SW1-09", 720),
        ("right", "trial-09/SW2-09", 720),
        ("left_before", "trial-08/SW1-08", 530),
    ):
        text = fetch(mirrors, "fei-nta/Propulsion-Raw-Data", f"propulsion raw data-02/{file}.csv")
        log = np.genfromtxt(io.BytesIO(text), delimiter=",")
        angle = np.unwrap(log[:, 2], period=4096.0) * 2 * np.pi / 4096.0
        way = float(np.sign(angle[-1] - angle[0]))
        angle, moment = smooth(240.0, 5.0, way * angle), smooth(240.0, 5.0, log[:, 23])
        rows = (np.arange(angle.size) / 240.0, np.gradient(angle, 1 / 240), moment, angle)
        t, v, f, turned = means(6, *(x[first:-80] for x in rows))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned}
        save(out, f"chair_{name}", columns)


def paddle(mirrors: Path, out: Path) -> None:
    """From audreywl/elecanisms2018 (branch mp1, no licence): the motor of a haptic paddle runs down three times.

    Angle of 14 bits and a clock of 16 bits, taken to tick every 16 µs (scales everything alike), about 0.2 ms apart;
    J is not given: 1e-6 kg m². Speed over 60 rows, from the third after it has fallen below 0.98 of what the motor had
    held to 15 rad/s: `paddle_down` in nine seconds, `paddle_down_braked`, `paddle_down_braked_again` in less than two.
    """
    for name, file in (
        ("paddle_down", "spindown_log"),
        ("paddle_down_braked", "spindown_log3"),
        ("paddle_down_braked_again", "spindown_log4"),
    ):
        text = fetch(mirrors, "audreywl/elecanisms2018", f"paddle/{file}.csv", "mp1")
        log = np.genfromtxt(io.BytesIO(text), delimiter=",")
        log = log[np.isfinite(log).all(1)]
        time = 16e-6 * np.append(0.0, np.cumsum(np.diff(log[:, 0]) % 65536.0))[::60]
        turned = np.unwrap(log[:, 1], period=16384.0)[::60] * 2 * np.pi / 16384.0
        at, speed = (time[1:] + time[:-1]) / 2, np.abs(np.diff(turned) / np.diff(time))
        held = float(np.median(speed[speed > 0.9 * speed.max()]))
        first = int(np.flatnonzero(speed > 0.98 * held)[-1]) + 3
        stop = first + int(np.flatnonzero(speed[first:] < 15.0)[0])
        columns = {"time_s": at[first:stop], "speed_rad_s": speed[first:stop]}
        save(out, name, columns, {"inertia_kg_m2": 1e-6}, True, 15.0)


ALL = (gear_motor_current, gear_motor_voltage, robots, servo_lifts, wheelchair, paddle)

if __name__ == "__main__":
    convert(ALL)
