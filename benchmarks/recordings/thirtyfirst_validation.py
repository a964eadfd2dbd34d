"""The thirty-first set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.thirtyfirst_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import even, ramps, smooth
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.twentieth_validation import less_inertia
from benchmarks.recordings.twentyseventh_validation import without
from benchmarks.recordings.validation import convert, means, save


def car_actuators(mirrors: Path, out: Path) -> None:
    """From nicolazande/camber-control (no licence): actuators for the camber and the toe of a racing car's wheels.

    Time (ms), place (mm or degrees), its slope by the drive (mm/s or degrees/s) and current of the motor; speed and
    current low-pass filtered, friction = current (A) − J dv/dt, J by least squares beside dry and viscous friction and
    an offset. `lin_sweep`, `lin_steps`: a spindle by courses of the drive's own to places up to 5 mm off in a sine ever
    faster for 30 s, and in steps; 100 Hz, filtered at 12 Hz, means of 2 rows where it is faster than 3 mm/s.
    `ecc_steps`, `ecc_steps_fast`: an eccentric on the car's load in steps of its place each second and each half; its
    current, whose sign is turned round, is new each 100 ms only: these rows, speed and angle in them from 75 Hz,
    the speed filtered at 8 Hz, where it is faster than 15 degrees/s.
    """
    repo = "nicolazande/camber-control"
    for name, file in (("lin_sweep", "pp-sine-sweep-10mm-0.5Hz"), ("lin_steps", "pp-square-wave-10mm-0.5Hz")):
        log = git_table(mirrors, repo, f"actuators/LinA/data/{file}.txt")
        v, f = less_inertia(100.0, log[:, 5] / 1e3, log[:, 4], 12.0, 3.0)
        t, v, f = means(2, *(x[20:-20] for x in (log[:, 0] / 1e3, v, f)))
        on = np.abs(v) > 3.0
        columns = {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}
        save(out, name, columns, dead_band=3.0, period=0.02)
    for name, file in (("ecc_steps", "full-travel-0.5Hz"), ("ecc_steps_fast", "full-travel-1Hz")):
        log = git_table(mirrors, repo, f"actuators/EccA/data/load-square-wave-{file}.txt")
        time, angle, v = even(75.0, log[:, 0] / 1e3, log[:, 3], log[:, 4])
        v = smooth(75.0, 8.0, v)
        new = np.flatnonzero(np.diff(log[:, 5]) != 0.0) + 1
        t, f = log[new, 0] / 1e3, -log[new, 5]
        angle, speed, gain = (np.interp(t, time, x) for x in (angle, v, np.gradient(v, 1 / 75)))
        on = np.abs(speed) > 15.0
        f = without(f, gain[:, None], np.column_stack([np.sign(speed), speed, np.ones_like(speed)]), on)
        columns = {"time_s": t[on], "speed_rad_s": np.radians(speed[on]), "friction_torque_Nm": f[on]}
        columns |= {"angle_rad": np.radians(angle[on])}
        save(out, name, columns, dead_band=float(np.radians(15.0)), period=0.104)


def flexible_drive(mirrors: Path, out: Path) -> None:
    """From Mthanson1/MTE360-Collocated-Controller-Lab3 (no licence): two masses on a spring, one driven, at Waterloo.

    1 kHz for 8 s, volts to the motor and speeds of both masses (mm/s, filtered by the course), low-pass filtered at 15
    Hz; friction = volts − what the acceleration of the driven mass, the difference of the places (the integral of that
    of the speeds) and an offset of each recording take, by least squares over two recordings beside dry and viscous
    friction of the driven mass; means of 8 rows where it is faster than 5 mm/s. `masses_square`, `masses_square_low`:
    ±2 V and ±1.75 V, each for a second; `masses_sine_slow`, `masses_sine`: 2 V in sines at 0.5 and 1 Hz.
    """
    for files in (
        (("masses_square", "2-5/2_0V/2-5a"), ("masses_square_low", "2-5/1_75V/2-5a")),
        (("masses_sine_slow", "2-6/2_6-0_5Hz"), ("masses_sine", "2-6/2_6-1_0Hz")),
    ):
        logs = []
        for _, file in files:
            path = f"Lab3_Group6_Data/{file}.mat"
            data = io.BytesIO(fetch(mirrors, "Mthanson1/MTE360-Collocated-Controller-Lab3", path))
            scope = loadmat(data, squeeze_me=True)  # type: ignore[arg-type]
            time, volts, v, other = (np.asarray(scope[key], dtype=float) for key in ("t", "u", "v1_filt", "v2_filt"))
            stretch = np.cumsum(v - other) / 1e3
            volts, v, stretch = (smooth(1000.0, 15.0, x) for x in (volts, v, stretch))
            columns = (x[100:-100] for x in (time, v, volts, np.gradient(v, 1e-3), stretch))
            logs.append(np.array(means(8, *columns)))
        _, v, volts, slope, stretch = np.concatenate(logs, axis=1)
        each = np.repeat(np.eye(2), [log.shape[1] for log in logs], axis=0)
        base, others = np.column_stack([slope, stretch, each]), np.column_stack([np.sign(v), v])
        friction = without(volts, base, others, np.abs(v) > 5.0)
        for (name, _), log, f in zip(files, logs, np.split(friction, [logs[0].shape[1]]), strict=True):
            on = np.abs(log[1]) > 5.0
            columns_on = {"time_s": log[0, on], "speed_rad_s": log[1, on], "friction_torque_Nm": f[on]}
            save(out, name, columns_on, dead_band=5.0, period=0.008)


def robot_on_ramps(mirrors: Path, out: Path) -> None:
    """From longwood564/Robot2021Char (no licence): a robot on the ground under a voltage in slow ramps, 200 Hz.

    As in `fifteenth_validation`, both sides: volts (logged without their sign) stand for the torque, speed of the
    wheels (0.4788 m a turn) low-pass filtered at 5 Hz, J by least squares beside dry and viscous friction and an
    offset, means of 10 rows. `robot_on_left`, `robot_on_right`: straight on and back; `robot_spin_left`,
    `robot_spin_right`: on the spot.
    """
    for name, file, volts, speed in (
        ("robot_on_left", "linear-data-20210306", 3, 7),
        ("robot_on_right", "linear-data-20210306", 4, 8),
        ("robot_spin_left", "angular-data-20210313", 3, 7),
        ("robot_spin_right", "angular-data-20210313", 4, 8),
    ):
        logs = json.loads(fetch(mirrors, "longwood564/Robot2021Char", f"{file}.json"))
        runs = []
        for run in ("slow-forward", "slow-backward"):
            log = np.array(logs[run], dtype=float)
            log[:, volts] *= np.sign(log[:, speed].mean())
            runs.append(log.tolist())
        save(out, name, ramps(runs, (volts, speed), 2 * np.pi / 0.4787787, 5.0, 10, 2.0), dead_band=2.0)


def pendulum_motors(mirrors: Path, out: Path) -> None:
    """From raphaelcasimir/kord-stk (GPL 3.0): motors of inverted pendulums at Aalborg, in 1999 and 2004.

    `motor_ramp` (maal.m): voltage in a slow ramp from −8 to 8 V, times not recorded (a second a row here), current (A)
    and tachometer (34.9 rad/s a volt, what it shows at rest taken off), where it turns faster than 3 rad/s.
    `motor_square` (dedcml2.mat): 20 Hz for 50 s, a voltage to and fro that grows to 7 V, current (A) and speed (rad/s),
    both low-pass filtered at 4 Hz, friction = current − J dω/dt, J by least squares beside dry and viscous friction and
    an offset, where it is faster than 5 rad/s. `motor_swept` (measm3hzb.mat): another motor, 100 Hz for 5 s, ±6.55 V
    (stands for the torque) and speed as logged, low-pass filtered at 12 Hz, J likewise, where it is faster than 3 of
    its units.
    """
    repo, year = "raphaelcasimir/kord-stk", "Old Report CDs/1999/klassisk/matlab"
    lines = [line.split() for line in fetch(mirrors, repo, f"{year}/maal.m").decode("latin1").splitlines()]
    log = np.array([row for row in lines if len(row) == 3 and re.fullmatch(r"-?\d+\.\d+", row[0])], dtype=float)
    still = np.median(log[np.abs(log[:, 1]) < 1.0, 2])
    v, time = 2e3 * np.pi / 180 * (log[:, 2] - still), np.arange(len(log), dtype=float)
    on = np.abs(v) > 3.0
    columns = {"time_s": time[on], "speed_rad_s": v[on], "friction_torque_Nm": log[on, 0]}
    save(out, "motor_ramp", columns, dead_band=3.0, period=1.0)
    scope = loadmat(io.BytesIO(fetch(mirrors, repo, f"{year}/dedcml2.mat")), squeeze_me=True)  # type: ignore[arg-type]
    v, f = less_inertia(20.0, scope["y"][:, 0], scope["y"][:, 1], 4.0, 5.0)
    on = np.abs(v) > 5.0
    columns = {"time_s": scope["t"][on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}
    save(out, "motor_square", columns, dead_band=5.0, period=0.05)
    path = "Old Report CDs/2004/matlab_simulink/modeling/linear_mga/motor/measm3hzb.mat"
    scope = loadmat(io.BytesIO(fetch(mirrors, repo, path)), squeeze_me=True)  # type: ignore[arg-type]
    v, f = less_inertia(100.0, scope["u"], scope["y"], 12.0, 3.0)
    on = np.abs(v) > 3.0
    columns = {"time_s": scope["t"][on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}
    save(out, "motor_swept", columns, dead_band=3.0, period=0.01)


def positioning_axis(mirrors: Path, out: Path) -> None:
    """From DragosBaci/SystemIdentification (no licence): an axis on a brushless motor, as students in Cluj log it.

    1389 Hz for 6 s, duty of its bridge (stands for the torque; what the turning motor induces is its viscous part) in
    steps, and speed (rad/s), both low-pass filtered at 15 Hz, friction = duty − J dω/dt, J by least squares beside dry
    and viscous friction and an offset, means of 10 rows where it is faster than 5 rad/s.
    """
    data = io.BytesIO(fetch(mirrors, "DragosBaci/SystemIdentification", "baci.mat"))
    scope = loadmat(data, squeeze_me=True, struct_as_record=False)["baci"]  # type: ignore[arg-type]
    time = np.asarray(scope.X.Data, dtype=float)
    _, speed, duty = (np.asarray(channel.Data, dtype=float) for channel in scope.Y)
    v, f = less_inertia(1 / float(np.median(np.diff(time))), duty, speed, 15.0, 5.0)
    t, v, f = means(10, *(x[100:-100] for x in (time, v, f)))
    on = np.abs(v) > 5.0
    save(out, "duty_axis", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}, dead_band=5.0)


def pendulum_base(mirrors: Path, out: Path) -> None:
    """From Larsosterholt/BSc-inverted-pendulum (no licence): the motor of a rotary pendulum with its arm, no pendulum.

    200 Hz, current (A) and angle (rad, some 230 counts a turn), speed from the angle, both low-pass filtered at 8 Hz,
    means of 4 rows; torque constant 0.08924 N m/A (parameters.m), J by least squares beside dry and viscous friction
    and an offset where it is faster than 3 rad/s. `base_steps`: ±4 V, each for 5 s with 5 s of rest behind it;
    `base_random`, `base_random_again`: volts that wander by chance for 40 s, rests among them. Rows where it rests are
    kept.
    """
    path = "PID_physical_mode_currentl_angle_and_angular_vel_feedback/data/baseTest.mat"
    data = io.BytesIO(fetch(mirrors, "Larsosterholt/BSc-inverted-pendulum", path))
    runs = loadmat(data, squeeze_me=True, struct_as_record=False)["baseTest"]  # type: ignore[arg-type]
    for name, run in zip(("base_steps", "base_random", "base_random_again"), runs, strict=True):
        time, current, angle = (np.asarray(x, dtype=float) for x in (run.time, run.Current, run.baseAngle))
        current, angle = (smooth(200.0, 8.0, x) for x in (current, angle))
        v = np.gradient(angle, 0.005)
        slope, on = np.gradient(v, 0.005), np.abs(v) > 3.0
        base = np.column_stack([slope, np.sign(v), v, np.ones_like(v)])
        inertia = 0.08924 * float(np.linalg.lstsq(base[on], current[on], rcond=None)[0][0])
        t, v, current = means(4, *(x[20:-20] for x in (time, v, current)))
        columns = {"time_s": t, "speed_rad_s": v, "motor_current_A": current}
        wheel = {"inertia_kg_m2": float(f"{inertia:.4g}"), "torque_constant_Nm_A": 0.08924}
        save(out, name, columns, wheel, dead_band=3.0)


def swinging_frame(mirrors: Path, out: Path) -> None:
    """From Brightside/AAU_EITCE6_AAU3Cubli (no licence): the frame of a balancing wheel, hung up and let swing, thrice.

    Volts of a potentiometer on its axle (stand for the angle), made even at 50 Hz, low-pass filtered at 5 Hz, until it
    has come down to a tenth of the widest swing, 20 s between two; friction = −dω/dt − a cubic of the angle for the
    weight, by least squares beside dry and viscous friction, where it is faster than 0.1 V/s.
    """
    path = "Data/Appendix Transferfunction/Appendix - Transferfunction/Measurements.csv"
    lines = fetch(mirrors, "Brightside/AAU_EITCE6_AAU3Cubli", path).decode().replace(";", "").splitlines()
    rows = [np.array([x for x in line.split(",") if x], dtype=float) for line in lines]
    rows = [row for row in rows if row.size > 100]
    parts = []
    for number in range(len(rows) // 2):
        place, clock = sorted(rows[2 * number : 2 * number + 2], key=lambda row: row.max())
        size = min(place.size, clock.size)
        time, x = even(50.0, clock[:size] / 1e3, place[:size])
        x = smooth(50.0, 5.0, x - np.median(x[-100:]))
        v = np.gradient(x, 0.02)
        begin = int(np.argmax(np.abs(v) > 1.0))
        last = begin + int(np.flatnonzero(np.abs(x[begin:]) > 0.1 * np.abs(x).max())[-1])
        part = np.array([time + 30.0 * number, x, v, np.gradient(v, 0.02)])
        parts.append(part[:, begin + 5 : last])
    t, x, v, slope = np.concatenate(parts, axis=1)
    on = np.abs(v) > 0.1
    f = without(-slope, np.column_stack([x**power for power in range(4)]), np.column_stack([np.sign(v), v]), on)
    columns = {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on], "angle_rad": x[on]}
    save(out, "frame_swings", columns, dead_band=0.1, period=0.02)


ALL = (
    car_actuators,
    flexible_drive,
    robot_on_ramps,
    pendulum_motors,
    positioning_axis,
    pendulum_base,
    swinging_frame,
)

if __name__ == "__main__":
    convert(ALL)
