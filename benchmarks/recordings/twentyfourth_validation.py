"""The twenty-fourth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.twentyfourth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import csv
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import even, smooth
from benchmarks.recordings.ninth_validation import RPM
from benchmarks.recordings.second_validation import fetch
from benchmarks.recordings.twentieth_validation import less_inertia
from benchmarks.recordings.validation import convert, means, save


def padua_scope(mirrors: Path, path: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of a Simulink scope of michelezarantonello/DC-Motor-Control."""
    data = io.BytesIO(fetch(mirrors, "michelezarantonello/DC-Motor-Control", f"{path}.mat"))
    log: dict[str, Any] = loadmat(data, simplify_cells=True)  # type: ignore[arg-type]
    scope = next(value for key, value in log.items() if not key.startswith("__"))
    return np.asarray(scope["time"], dtype=float), np.asarray(scope["signals"]["values"], dtype=float)


def padua_motor(mirrors: Path, out: Path) -> None:
    """From michelezarantonello/DC-Motor-Control (no licence): a geared motor (Quanser SRV02) of a student's course.

    Another motor than that of the course in an earlier set. Filtered torque of the motor (N m, from its current), 1
    kHz. `padua_up`, `padua_down`: nine steps of its speed (rad/s behind the gear of 14), means of 100 rows, from 1 s
    after each step on. `padua_triangle`: up and down between rest and 450 rpm behind the gear, one a 2 s, from 1 s on,
    means of 10 rows, J (at the motor) by least squares beside dry and viscous friction. `padua_beam`: a flexible beam
    on its hub swings freely (degrees), low-pass filtered at 12 Hz, means of 5 rows, J = 1, friction = −dω/dt − k angle,
    k and the angle at rest by least squares, from just after its let-go on for 1.6 s.
    """
    base = "LAB0/0. Parameter Estimation/FinallyGoodMeasurementsForLAB0"
    for name, way in (("up", "Positive"), ("down", "Negative")):
        time, speed = padua_scope(mirrors, f"{base}/{way}MotorSpeedStair")
        torque = padua_scope(mirrors, f"{base}/{way}MotorTorqueStair")[1]
        t, v, f = means(100, time[:-1], 14.0 * speed[:-1], torque[:-1])
        on = t % 5.0 > 1.0
        save(out, f"padua_{name}", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]})
    time, speed = padua_scope(mirrors, f"{base}/SpeedForJeq")
    torque = padua_scope(mirrors, f"{base}/TorqueForJeq")[1]
    t, v, f = means(10, time[1000:], 14.0 * RPM * speed[1000:], torque[1000:])
    columns = {"time_s": t, "speed_rad_s": v, "motor_torque_Nm": f}
    save(out, "padua_triangle", columns, {"inertia_kg_m2": 6.6e-7}, dead_band=20.0)
    time, place = padua_scope(mirrors, "LAB3/3.1. Parameter Estimation - Real Motor/BeamOsc10s_4018msTO7000ms_16_5deg")
    angle = smooth(1000.0, 12.0, np.radians(place))
    speed = np.gradient(angle, 1 / 1000)
    on = (time >= 5.0) & (time < 6.6)
    t, turned, v, f = means(5, *(x[on] for x in (time, angle, speed, -np.gradient(speed, 1 / 1000))))
    terms = np.column_stack([turned, np.ones_like(v), v, np.sign(v)])
    f -= terms[:, :2] @ np.linalg.lstsq(terms, f, rcond=None)[0][:2]
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned.mean()}
    save(out, "padua_beam", columns)


def haptic_levers(mirrors: Path, out: Path) -> None:
    """From Ohara124c41/Haptics-Bilateral_Teleoperation-1DOF_Experiments (MIT): two levers, one follows the other.

    2 kHz, angle, torques of the motors and of the sensors of the hand's force (all at the lever, N m), which move it
    together; low-pass filtered at 25 Hz, means of 10 rows, the dead band 0.1 rad/s. `haptic_follows`, `_b`, `_c`: the
    one that follows in free motion, by other controllers, J by least squares beside dry and viscous friction and an
    offset, `haptic_hand`: the same lever moved by hand, `haptic_slave`: the other follows it, J of its file.
    """
    repo = "Ohara124c41/Haptics-Bilateral_Teleoperation-1DOF_Experiments"
    for name, file, lever, inertia in (
        ("follows", "a_free_motion", 0, 6.4e-4),
        ("follows_b", "b_free_motion", 0, 8.9e-4),
        ("follows_c", "c_free_motion", 0, 5.6e-4),
        ("hand", "d_free_motion", 0, 5.8e-4),
        ("slave", "d_free_motion", 1, 1.584e-3),
    ):
        data = io.BytesIO(fetch(mirrors, repo, f"m1_question1/question1{file}.mat"))
        log: dict[str, Any] = loadmat(data, simplify_cells=True, variable_names=["scope"])["scope"]  # type: ignore[arg-type]
        place, force, torque = (
            smooth(2000.0, 25.0, np.asarray(signal["values"], dtype=float)[:, lever]) for signal in log["signals"]
        )
        time, speed = np.asarray(log["time"], dtype=float), np.gradient(place, 1 / 2000)
        drive = torque - force if lever else force - torque
        t, v, f = means(10, *(x[100:-100] for x in (time, speed, drive)))
        columns = {"time_s": t, "speed_rad_s": v, "motor_torque_Nm": f}
        save(out, f"haptic_{name}", columns, {"inertia_kg_m2": inertia}, dead_band=0.1)


def robot_dogs(mirrors: Path, out: Path) -> None:
    """From RX-00/sim2real-robot-identification (BSD 3-clause): legs of robot dogs (Unitree) in the air, chirps.

    200 Hz, angle and speed of each joint, torque by the law of its controller, kp (wanted − angle) − kd speed; low-pass
    filtered at 20 Hz, means of 4 rows; friction = torque − what the accelerations of thigh and calf and the weight
    (sines and cosines of the calf and of both) take, by least squares beside dry and viscous friction. Calves of the
    front left leg; `dog_calf_later`: another path, `dog_old_calf`: another robot (Aliengo).
    """
    for name, file, joint, kp, kd in (
        ("dog_calf", "go2/traj_1", 2, 40.0, 2.0),
        ("dog_calf_later", "go2/traj_8", 2, 40.0, 2.0),
        ("dog_old_calf", "aliengo/traj_0", 2, 25.0, 0.5),
    ):
        pack = zipfile.ZipFile(io.BytesIO(fetch(mirrors, "RX-00/sim2real-robot-identification", f"datasets/{file}.pt")))
        stem = pack.namelist()[0].split("/")[0]
        q, v, wanted = (
            np.frombuffer(pack.read(f"{stem}/data/{k}"), dtype="<f4").reshape(-1, 12).astype(float) for k in (1, 2, 3)
        )
        torque = smooth(200.0, 20.0, kp * (wanted - q)[:, joint] - kd * v[:, joint])
        calf, thigh = (smooth(200.0, 20.0, q[:, k]) for k in (joint, joint - 1))
        speed = smooth(200.0, 20.0, v[:, joint])
        slopes = [np.gradient(smooth(200.0, 20.0, v[:, k]), 1 / 200) for k in (joint, joint - 1)]
        weight = [np.sin(calf), np.cos(calf), np.sin(calf + thigh), np.cos(calf + thigh), np.ones_like(calf)]
        base = np.column_stack([*slopes, *weight, speed, np.sign(speed)])
        on = np.abs(speed) > 0.1
        torque -= base[:, :7] @ np.linalg.lstsq(base[on], torque[on], rcond=None)[0][:7]
        time = np.arange(torque.size) / 200
        t, v, f, turned = means(4, *(x[40:-40] for x in (time, speed, torque, calf)))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned.mean()}
        save(out, name, columns, dead_band=0.1)


def duty_motor(mirrors: Path, out: Path) -> None:
    """From CiganOliviu/brushless-DC-electric-motor-identification (MIT): a brushless motor under steps of its duty.

    6 s, 1389 Hz, made even at 1400 Hz, duty (stands for the torque) and speed (rad/s), both ways; low-pass filtered at
    25 Hz, friction = duty − J dω/dt, J by least squares, means of 14 rows, the dead band 20 rad/s.
    """
    data = io.BytesIO(fetch(mirrors, "CiganOliviu/brushless-DC-electric-motor-identification", "dataset.mat"))
    log: dict[str, Any] = loadmat(data, simplify_cells=True)["cigan"]  # type: ignore[arg-type]
    clock, turns, duty = (np.asarray(x["Data"], dtype=float) for x in (log["X"], log["Y"][1], log["Y"][2]))
    time, turns, duty = even(1400.0, clock, turns, duty)
    v, f = less_inertia(1400.0, duty, turns, 25.0, 20.0)
    t, v, f = means(14, *(x[50:-50] for x in (time, v, f)))
    save(out, "duty_motor", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=20.0)


def small_arm(mirrors: Path, out: Path) -> None:
    """From isaac-sim2real/sage (Apache 2.0): two joints of a small robot arm (SO-101, servos STS3215).

    50 Hz, angle and torque of the servo (from its current in steps of 6.5 mA, without a sign: that of the speed),
    made even, both low-pass filtered at 3 Hz, speed from the angle, means of 5 rows, the dead band 0.05 rad/s. The
    base, whose axis is vertical, and (`arm_wrist`) the roll of the wrist, without its blows beyond 0.3 N m.
    """
    for name, path, joint in (
        ("turns", "single_joint_rotation", 0),
        ("sweep", "sinusoidal_sweep", 0),
        ("ramps", "ramp_motion", 0),
        ("wrist", "single_joint_wrist_roll", 4),
    ):
        text = fetch(mirrors, "isaac-sim2real/sage", f"output/real/so101/custom/{path}/state_motor.csv").decode()
        rows = list(csv.reader(io.StringIO(text)))[1:]
        clock = np.array([float(row[1]) for row in rows]) / 1e6
        place, torque = (np.array([json.loads(row[k])[joint] for row in rows]) for k in (2, 4))
        time, place, torque = even(50.0, clock, place, torque)
        v = np.gradient(smooth(50.0, 3.0, place), 1 / 50)
        t, v, f = means(5, time, v, np.sign(v) * smooth(50.0, 3.0, np.abs(torque)))
        on = (np.abs(v) > 0.01) & (np.abs(f) < 0.3)
        save(out, f"arm_{name}", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}, dead_band=0.05)


def duty_wheels(mirrors: Path, out: Path) -> None:
    """From Emmanuelprime/Jidennna (no licence): wheels of a small robot in stairs of their duty, 10 to 60.

    Duty (stands for the torque, what the turning motor induces is its viscous part) and speed (as its board gives it,
    m/s), a row a tenth of a second, from a second after each step on, the last two rows, where it stops, left out.
    `_short`: steps of 10 instead of 5.
    """
    for name, file in (("", "motor_characterization_detailed"), ("_short", "motor_characterization")):
        text = fetch(mirrors, "Emmanuelprime/Jidennna", f"{file}.csv").decode()
        log = [row for row in csv.DictReader(io.StringIO(text)) if row["command"].startswith("f")][:-2]
        for side in ("left", "right"):
            keys = ("timestamp", f"{side}_speed", f"{side}_pwm")
            t, v, f = np.array([[float(row[key]) for key in keys] for row in log]).T
            last = np.maximum.accumulate(np.where(np.diff(f, prepend=0.0) != 0.0, np.arange(f.size), 0))
            on = np.arange(f.size) - last >= 10
            save(out, f"duty_{side}{name}", {"time_s": t[on] / 1e3, "speed_rad_s": v[on], "friction_torque_Nm": f[on]})


ALL = (padua_motor, haptic_levers, robot_dogs, duty_motor, small_arm, duty_wheels)

if __name__ == "__main__":
    convert(ALL)
