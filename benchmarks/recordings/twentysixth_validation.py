"""The twenty-sixth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.twentysixth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import smooth
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.validation import convert, means, save


def matrix(mirrors: Path, repository: str, path: str, key: str) -> np.ndarray:
    """Return a variable of a MATLAB file of a repository."""
    data = io.BytesIO(fetch(mirrors, repository, f"{path}.mat"))
    return np.asarray(loadmat(data, squeeze_me=True)[key], dtype=float)  # type: ignore[arg-type]


def surgical_tools(mirrors: Path, out: Path) -> None:
    """From MRDLab/mis-tool-characterization (Open Database License): a spindle that closes a surgical robot's forceps.

    1 kHz, angle of the spindle (8192 counts a turn) and torque of a sensor on it (0.039811 mN m a count), which a motor
    turns to and fro in sines while another loads the jaw with a constant torque; both low-pass filtered at 10 Hz, speed
    from the angle, friction = −torque, means of 10 rows, half a second at both ends left out. `tool_slow`: a sine in 10
    s, `tool_fast`: in 2 s, the same tool and load; `tool_other`, `tool_rolled`: another tool, in 5 s, twice the load,
    and with its shaft rolled.
    """
    for name, file in (
        ("slow", "Tool_5_Maryland_L_2/01"),
        ("fast", "Tool_5_Maryland_L_2/41"),
        ("other", "Tool_4_Maryland_L_2/13"),
        ("rolled", "Tool_4_Maryland_L_Roll_3/300"),
    ):
        repo = "MRDLab/mis-tool-characterization"
        log = git_table(mirrors, repo, f"data/{file}.TXT", delimiter=",", comments="%")
        log = log[np.isfinite(log).all(axis=1)]
        angle = smooth(1000.0, 10.0, 2 * np.pi / 8192 * log[:, 1])
        torque = smooth(1000.0, 10.0, 39.811e-6 * log[:, 2])
        speed, time = np.gradient(angle, 1 / 1000), np.arange(angle.size) / 1000
        t, v, f, turned = means(10, *(x[500:-500] for x in (time, speed, -torque, angle)))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned.mean()}
        save(out, f"tool_{name}", columns, dead_band=0.03)


def robot_arm(mirrors: Path, out: Path) -> None:
    """From JiyGuo/dynamical_identification (no licence): joints of a robot arm on paths that excite all six at once.

    1 kHz, angles of the joints (rad) and torque (thousands of its units), both low-pass filtered at 8 Hz, speeds from
    the angles, means of 10 rows while it moves; friction = torque − what the accelerations of all joints and the sine
    and cosine of its angle take + what it is at rest, by least squares beside dry and viscous friction, where it is
    faster than 0.15 rad/s. `wrist_6`: its last joint, `wrist_6_other` on another path, `wrist_5`, `wrist_4`: others.
    """
    for name, run, joint in (
        ("wrist_6", "20210329_5", 6),
        ("wrist_6_other", "20210325_1", 6),
        ("wrist_5", "20210329_4", 5),
        ("wrist_4", "20210329_5", 4),
    ):
        place, torque = (
            matrix(mirrors, "JiyGuo/dynamical_identification", f"data/{run}/{k}", "ans") for k in ("joint", "torque")
        )
        angles = [smooth(1000.0, 8.0, x) for x in place[1:]]
        speeds = [np.gradient(x, 1e-3) for x in angles]
        moving = np.flatnonzero(np.abs(speeds[joint - 1]) > 0.02)
        on = slice(int(moving[0]), int(moving[-1]))
        t, angle, v, f, *slopes = means(
            10,
            *(x[on] for x in (place[0], angles[joint - 1], speeds[joint - 1])),
            smooth(1000.0, 8.0, torque[joint] / 1e3)[on],
            *(np.gradient(x, 1e-3)[on] for x in speeds),
        )
        base = np.column_stack([*slopes, np.sin(angle), np.cos(angle), np.ones_like(v), np.sign(v), v])
        fast = np.abs(v) > 0.15
        f -= base[:, :9] @ np.linalg.lstsq(base[fast], f[fast], rcond=None)[0][:9]
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": angle - angle.mean()}
        save(out, name, columns, dead_band=0.15)


def robot_slews(mirrors: Path, out: Path) -> None:
    """From TanYing1995/RobotExp (no licence): single joints of a robot arm (Siasun), one slew after the other.

    1 kHz, angle and torque (N m), both low-pass filtered at 10 Hz, speed from the angle, means of 20 rows where it
    moves, 0.15 s at both ends of each slew left out and 3 s put between them; friction = torque − J dω/dt, J by least
    squares beside dry and viscous friction and an offset. `slews`: its base, whose axis is vertical, to and fro, slower
    ones first, `slews_other`: others of them, `slews_roll`: the roll of its forearm, one way.
    """
    for name, joint, runs in (
        ("slews", 1, (29, 65, 2, 77, 24, 66, 11, 67, 12, 79, 99, 85)),
        ("slews_other", 1, (15, 71, 16, 31, 72, 10, 73, 84)),
        ("slews_roll", 4, (261, 296, 268, 281, 287, 293, 277, 272)),
    ):
        clock, parts = 0.0, []
        for run in runs:
            angle, torque = (
                matrix(mirrors, "TanYing1995/RobotExp", f"LSTM/Data_Temp/{run}/{k}", k)[joint]
                for k in ("real_angle_array", "torque_array")
            )
            angle, torque = smooth(1000.0, 10.0, angle), smooth(1000.0, 10.0, torque)
            speed = np.gradient(angle, 1e-3)
            time = clock + np.arange(angle.size) / 1000
            part = np.array(means(20, *(x[150:-150] for x in (time, speed, torque, np.gradient(speed, 1e-3)))))
            parts.append(part[:, np.abs(part[1]) > 0.01])
            clock = float(time[-1]) + 3.0
        t, v, f, slope = np.concatenate(parts, axis=1)
        base = np.column_stack([slope, np.sign(v), v, np.ones_like(v)])
        f -= slope * np.linalg.lstsq(base, f, rcond=None)[0][0]
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def robot_finger(mirrors: Path, out: Path) -> None:
    """From rtkg/motion_primitives (no licence): the middle joint of the little finger of a robot hand on tendons.

    1 kHz, angle and the command of its motor (thousands of its units), a sine of 0.1 from 0.5 Hz on,
    of which the first 5 s, until 2.5 Hz; made even, low-pass filtered at 15 Hz, means of 2 rows; friction = command − k
    angle + what it is at rest (tendons pull it straight), by least squares beside dry and viscous friction.
    """
    path = "matlab/2012-11-23_SysIdent_LFJ3/lfj3_sweep_10.0_100at45deg_0.5_5.0.txt"
    log = git_table(mirrors, "rtkg/motion_primitives", path)
    grid = np.arange(0.0, 6.0, 1e-3)
    angle, drive = (smooth(1000.0, 15.0, np.interp(grid, log[:, 0], log[:, k])) for k in (1, 4))
    on = slice(300, 5000)
    t, turned, v, f = means(2, *(x[on] for x in (grid, angle, np.gradient(angle, 1e-3), drive / 1e3)))
    base = np.column_stack([turned, np.ones_like(v), np.sign(v), v])
    fast = np.abs(v) > 0.1
    f -= base[:, :2] @ np.linalg.lstsq(base[fast], f[fast], rcond=None)[0][:2]
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned.mean()}
    save(out, "finger", columns, dead_band=0.1)


def stepped_motor(mirrors: Path, out: Path) -> None:
    """From WAAM-UFJF/Ensaio-Frequencia (MIT): a small motor before and after a step of its voltage.

    1 kHz for 10 s, current (stands for the torque) and speed as logged; low-pass filtered at 10 Hz, friction = current
    − J dω/dt, J by least squares beside dry and viscous friction, means of 10 rows. `stepped`: to nearly twice
    the speed, at ten times the current of `stepped_idle` and `stepped_later`, on two other days.
    """
    for name, file in (
        ("stepped", "Feb-09-2022--14-52-21"),
        ("stepped_idle", "Jan-15-2022--11-00-14"),
        ("stepped_later", "Jan-27-2022--15-46-52"),
    ):
        path = f"Python/Dados/{file}.csv"
        log = git_table(mirrors, "WAAM-UFJF/Ensaio-Frequencia", path, delimiter=";", skip_header=1)
        current, speed = (smooth(1000.0, 10.0, log[:, k]) for k in (1, 2))
        t, v, f, slope = means(10, *(x[100:-100] for x in (log[:, 0], speed, current, np.gradient(speed, 1e-3))))
        base = np.column_stack([slope, v, np.ones_like(v)])
        f -= slope * np.linalg.lstsq(base, f, rcond=None)[0][0]
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def lab_arms(mirrors: Path, out: Path) -> None:
    """From two groups of a course (no licence): rigid arms on a geared motor, to and fro between two angles.

    hesp2674/ASEN-2803-Lab-3 (`arm_course`, `arm_slack`: damped, and at a third of the gain, undamped) and
    NMuellerCU/ASEN2803-Lab-3 (`arm_damped`), other groups and years than before; 1 kHz, volts of the motor (stand for
    the torque, what it induces is its viscous part) and angle of the hub, of which the speed, both low-pass filtered at
    8 Hz, friction = volts − J dω/dt, J by least squares beside dry and viscous friction and an offset, means of 4 rows
    where it moves.
    """
    pack = zipfile.ZipFile(io.BytesIO(fetch(mirrors, "hesp2674/ASEN-2803-Lab-3", "April72022.zip")))
    for name, text in (
        ("course", pack.read("April72022/rigid_5_kp_15_kd_1pt5")),
        ("slack", pack.read("April72022/rigid_5_kp_5_kd_0")),
        ("damped", fetch(mirrors, "NMuellerCU/ASEN2803-Lab-3", "data_2.txt")),
    ):
        log = np.genfromtxt(io.BytesIO(text), comments="%")
        angle, drive = (smooth(1000.0, 8.0, log[:, k]) for k in (1, 6))
        v = np.gradient(angle, 1e-3)
        t, v, f, slope = (x[200:-200] for x in (log[:, 0] / 1e3, v, drive, np.gradient(v, 1e-3)))
        on = np.abs(v) > 0.2
        base = np.column_stack([slope, np.sign(v), v, np.ones_like(v)])
        f = f - slope * np.linalg.lstsq(base[on], f[on], rcond=None)[0][0]
        near = np.convolve(on, np.ones(81), "same") > 0
        t, v, f = means(4, *(x[near] for x in (t, v, f)))
        save(out, f"arm_{name}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.2)


def swings(mirrors: Path, out: Path) -> None:
    """From two repositories (no licence): what swings freely, J = 1.

    `held_pendulum`: a pendulum of a tutorial (VDB-Bram/Tutorial-Direct-Collocation), angle at 100 Hz, low-pass filtered
    at 4 Hz, means of two rows, from its third swing on for 5 s. `aero_pitch`: the level axis of a body with two rotors
    (Quanser, YangZhu-uestc/Quanser-AERO-2-DOF-helicopter-Model-Identification), whose rotors have started to turn and
    keep their speed, from 1.5 s on until it sticks, at 1 kHz, low-pass filtered at 2.5 Hz, means of 15 rows. Friction =
    −dω/dt − k sin (angle − that at rest), both by least squares beside dry and viscous friction.
    """
    pendulum = matrix(mirrors, "VDB-Bram/Tutorial-Direct-Collocation", "DataPendulum", "data")
    aero = "YangZhu-uestc/Quanser-AERO-2-DOF-helicopter-Model-Identification"
    key = "Log_Sensor_Measurements"
    body = matrix(mirrors, aero, f"Pitch-channel motion model identification source files/{key}", key).T
    for name, time, place, rate, cut, first, last, count, rest, band in (
        ("held_pendulum", pendulum[:, 0], np.radians(pendulum[:, 1]), 100.0, 4.0, 16.0, 21.0, 2, -67.2, 0.1),
        ("aero_pitch", body[:, 0], body[:, 1], 1000.0, 2.5, 1.5, 13.0, 15, 0.0, 0.02),
    ):
        angle = smooth(rate, cut, place) - np.radians(rest)
        speed = np.gradient(angle, 1 / rate)
        on = (time >= first) & (time < last)
        t, turned, v, f = means(count, *(x[on] for x in (time, angle, speed, -np.gradient(speed, 1 / rate))))
        terms = np.column_stack([np.sin(turned), np.cos(turned), v, np.sign(v)])
        f -= terms[:, :2] @ np.linalg.lstsq(terms, f, rcond=None)[0][:2]
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned.mean()}
        save(out, name, columns, dead_band=band)


def motor_shield(mirrors: Path, out: Path) -> None:
    """From gergelytakacs/AutomationShield (CC BY-NC-ND 4.0): a small motor under random steps of its voltage.

    20 ms, speed (rad/s, in steps of 27) and current (A, as filtered there), low-pass filtered at 2 Hz, torque constant
    1, friction = current − J dω/dt, J by least squares, means of 2 rows, from 2 s on.
    """
    repo, path = "gergelytakacs/AutomationShield", "matlab/examples/MotoShield/aprbsResult"
    speed, current = (smooth(50.0, 2.0, matrix(mirrors, repo, path, k)) for k in ("y", "ifltr"))
    time = np.arange(speed.size) / 50
    t, v, f, slope = means(2, *(x[100:-50] for x in (time, speed, current, np.gradient(speed, 1 / 50))))
    f -= slope * np.linalg.lstsq(np.column_stack([slope, v, np.ones_like(v)]), f, rcond=None)[0][0]
    save(out, "shield_motor", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


ALL = (surgical_tools, robot_arm, robot_slews, robot_finger, stepped_motor, lab_arms, swings, motor_shield)

if __name__ == "__main__":
    convert(ALL)
