"""The second set of public recordings to friction tables, for validation.

    python -m benchmarks.recordings.second_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

import csv
import io
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, filtfilt

from benchmarks.recordings.validation import convert, git_show, means, save, swings


def fetch(mirrors: Path, repository: str, path: str, revision: str = "HEAD") -> bytes:
    """Return the bytes of a file of a repository, OWNER/NAME."""
    return git_show(str(mirrors / f"{repository.replace('/', '+')}.git"), path, revision)


def git_table(mirrors: Path, repository: str, path: str, revision: str = "HEAD", **how: Any) -> np.ndarray:
    """Return the numbers of a table of a repository."""
    return np.genfromtxt(io.BytesIO(fetch(mirrors, repository, path, revision)), **how)


def satellite(mirrors: Path, out: Path) -> None:
    """From mgiglia92/reaction-wheel (branch devel).

    A model satellite on a shaft running down, rate gyro (MPU6050, 42 Hz) at 100 Hz in degrees/s. J = body 221.3 +
    reaction wheel 53.8 kg mm² (parameter_calcs.py), without the wheel 221.3. The shaft is vertical (`vertical…`) or
    level (`level…`). The files in old-data give twice the rate (gyro range): where the shaft is level gravity turns
    in the accelerometers 0.50 times an integrated turn (fit of its sine: 3 % left at 0.50, > 15 % at 0.48 and 0.52),
    so the three are halved. From five rows after the fastest to 3 °/s.
    """
    for name, path, inertia in (
        ("satellite_vertical", "friction-tests/vertical-friction-1", 275.1e-6),
        ("satellite_vertical_fast", "old-data/vertical-friction-data", 275.1e-6),
        ("satellite_level", "old-data/friction-with-wheel", 275.1e-6),
        ("satellite_level_bare", "old-data/friction-without-wheel", 221.3e-6),
    ):
        rows = git_table(
            mirrors, "mgiglia92/reaction-wheel", f"src/python/data/{path}.csv", "devel", delimiter=",", skip_header=1
        )
        time, rate = np.cumsum(rows[:, 7]), rows[:, 5] * (0.5 if "old-data" in path else 1.0)
        first = int(np.abs(rate).argmax()) + 5
        slow = np.flatnonzero(np.abs(rate[first:]) < 3.0)
        last = first + int(slow[0]) if slow.size else rate.size
        save(
            out,
            name,
            {"time_s": time[first:last], "speed_rad_s": np.radians(rate[first:last])},
            {"inertia_kg_m2": inertia},
            motor_off=True,
        )


def small_propeller(mirrors: Path, out: Path) -> None:
    """From bhabas/sar_simulation.

    `motor_decay_N`: coreless motor with propeller of a Crazyflie after its last command, optical speed at 20 Hz on a
    grid of 46–62 rad/s; J of motor and propeller is not given: 1e-7 kg m² (scales everything alike).
    `micro_ladder_2` (tared by the reading at rest before each sweep) and `micro_steps`: RCbenchmark stand, torque of
    the cell, optical speed; other logs than in the first set.
    """
    base = "sar_projects/System_Identification/"
    for number in (6,):
        time, speed = git_table(
            mirrors,
            "bhabas/sar_simulation",
            base + f"Motor_Crazyflie/Logs/Upgraded_Motor_Decay/MS_Decay_{number}.csv",
            delimiter=",",
            skip_header=1,
        ).T
        top = np.flatnonzero(speed > 1700)[-1]
        end = top + int(np.flatnonzero(speed[top:] <= 50)[0])
        save(
            out,
            f"motor_decay_{number}",
            {"time_s": time[top:end], "speed_rad_s": speed[top:end]},
            {"inertia_kg_m2": 1e-7},
            motor_off=True,
        )
    for name, file, ladder in (
        ("micro_ladder_2", "StepsTestV2_2024-02-06_131025", True),
        ("micro_steps", "TimeConstant_Test_2024-02-06_134515", False),
    ):
        time, speed, torque = benchmark(
            mirrors, "bhabas/sar_simulation", base + f"Motor_Impulse_Micro/Logs/{file}.csv", 1.0
        )
        rest = np.flatnonzero((speed == 0) & np.isfinite(torque))
        torque = torque - (
            np.interp(np.arange(time.size), rest, torque[rest]) if ladder else np.nanmedian(torque[rest[:50]])
        )
        good = np.isfinite(time + speed + torque) & (speed > 60)
        time, speed, torque = time[good], speed[good], torque[good]
        if ladder:  # the second reading of a step has the first one's time
            time = np.cumsum(
                np.where(np.diff(time, prepend=time[0] - 5) < 0.5, 5.0, np.diff(time, prepend=time[0] - 5))
            )
        new = np.concatenate([[True], np.diff(time) > 1e-6])
        save(out, name, {"time_s": time[new], "speed_rad_s": speed[new], "friction_torque_Nm": torque[new]})


def benchmark(mirrors: Path, repo: str, path: str, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time [s], speed and torque of a log of an RCbenchmark stand; the speed times a scale."""
    lines = [
        row
        for row in csv.reader(io.StringIO(fetch(mirrors, repo, path).decode("utf-8-sig")))
        if row and not row[0].startswith("#")
    ]
    head = lines[0]

    def column(start: str) -> np.ndarray:
        at = next(k for k, text in enumerate(head) if text.startswith(start))
        return np.array([float(row[at]) if len(row) > at and row[at].strip() else np.nan for row in lines[1:]])

    time, optical, electrical, torque = (
        column("Time"),
        column("Motor Optical Speed"),
        column("Motor Electrical Speed"),
        column("Torque"),
    )
    speed = optical if np.nanmax(optical) > 0 else electrical
    if np.nanmedian(torque[speed > 0]) < 0:
        torque = -torque
    return time, speed * scale, torque


def quad_blade(mirrors: Path, out: Path) -> None:
    """From diegosdantonio/thruststand_test (GPL-3.0).

    Small brushless motors with a 2-inch four-blade propeller, RCbenchmark 1580, ladders of 19–21 steps of 3.5 s,
    several sweeps one after another (60 s between them), electrical speed; 1108 less the reading at rest of its sweep
    where there is one, 3cells as the cell gives it. Sweeps of fewer than ten steps are left out.
    """
    for name, files in (
        ("quadblade_1108", ("212137", "212732", "213055")),
        ("quadblade_3cells", ("220340", "220513")),
    ):
        parts, end = [], 0.0
        for file in files:
            time, speed, torque = benchmark(
                mirrors, "diegosdantonio/thruststand_test", f"datasets/StepsTest_2020-06-16_{file}.csv", np.pi / 30
            )
            if name == "quadblade_1108" and (speed == 0).any():
                torque = torque - torque[speed == 0].mean()
            good = (speed > 100) & np.isfinite(torque)
            time = end + 3.5 * np.arange(good.sum())
            parts.append(np.column_stack([time, speed[good], torque[good]]))
            end = time[-1] + 60.0
        table = np.vstack(parts)
        save(out, name, {"time_s": table[:, 0], "speed_rad_s": table[:, 1], "friction_torque_Nm": table[:, 2]})


def seven_inch(mirrors: Path, out: Path) -> None:
    """From alspitz/esc_test (MIT).

    7-inch three-blade propeller, RCbenchmark 1580, electrical speed; rows that have a torque (about 8 a second,
    uneven), less the mean reading at rest.
    """
    for name, file in (("prop7_f60", "Log_2019-11-07_211050"), ("prop7_f80", "Log_2019-11-09_181347")):
        time, speed, torque = benchmark(mirrors, "alspitz/esc_test", f"data/rcbench/{file}.csv", np.pi / 30)
        have = np.isfinite(torque) & np.isfinite(time) & np.isfinite(speed)
        time, speed, torque = time[have], speed[have], torque[have]
        torque = torque - torque[speed == 0][:50].mean()
        good = (speed > 100) & np.concatenate([[True], np.diff(time) > 1e-6])
        time, speed, torque = time[good], speed[good], torque[good]
        save(out, name, {"time_s": time, "speed_rad_s": speed, "friction_torque_Nm": torque})


def epos(text: str) -> np.ndarray:
    """Return the numbers of a log of the drive: time, speed, torque."""
    lines = text.splitlines()
    rows = []
    for line in lines[next(k for k, line in enumerate(lines) if line.startswith("ms;")) + 1 :]:
        try:
            rows.append([float(x) for x in line.rstrip(", ").split(";")[:3]])
        except ValueError:
            continue
    return np.array([r for r in rows if len(r) == 3])


def start_stop(mirrors: Path, out: Path) -> None:
    """From RViMLab/TRO2021-Dynamic-Modelling (MIT).

    Lead screw (1), antibacklash lead screw (2), worm (3) lifting and lowering 96 g: starts and stops at 50 (1, 2) and
    10 rpm (3), 40 ms, averaged by the drive. Torque in per cent of 9.84 mN m at the motor, J of motor and drive as in
    the first set.
    """
    for drive, name, file in (
        (1, "screw_start_stop_50", "50"),
        (2, "antibacklash_start_stop_50", "50"),
        (3, "worm_start_stop_10", "10"),
    ):
        rows = epos(
            fetch(
                mirrors, "RViMLab/TRO2021-Dynamic-Modelling", f"experiments/driveNo{drive}/start_stop/{file}.csv"
            ).decode("latin1")
        )
        save(
            out,
            name,
            {
                "time_s": rows[:, 0] / 1e3,
                "speed_rad_s": -rows[:, 1] * np.pi / 30,
                "motor_torque_Nm": -rows[:, 2] / 100 * 9.84e-3,
            },
            {"inertia_kg_m2": {1: 2.186e-6, 2: 2.186e-6, 3: 6.5e-7}[drive]},
            dead_band={1: 0.3, 2: 0.3, 3: 0.1}[drive],
        )


def robots(mirrors: Path, out: Path) -> None:
    """From longshike/NNFM-A-Novel-Neural-Network-Modeling-Approach-for-Robot-Flexible-Joints-Friction.

    Friction torque as published (gravity and dynamics taken off by the authors). Franka joint 2 (case 3) and 7 (case
    4), means of 10 rows (24 ms … 47 ms); FAIRINO joint 3 on three paths, means of 4 rows (62 ms). Other files than in
    the first set.
    """
    repo = "longshike/NNFM-A-Novel-Neural-Network-Modeling-Approach-for-Robot-Flexible-Joints-Friction"
    for name, path, count, band in (
        ("franka_joint2_fast", "Franka Robot/case3_high", 10, 0.005),
        ("franka_joint7_slow", "Franka Robot/case4_slow", 10, 0.005),
        ("franka_joint7_fast", "Franka Robot/case4_high", 10, 0.005),
        ("fairino_joint3_line", "FAIRINO Robot/verify_robot_zhixian_slow_processed", 4, 5e-5),
        ("fairino_joint3_arc", "FAIRINO Robot/verify_robot_yuanhu_slow_processed", 4, 5e-5),
        ("fairino_joint3_s", "FAIRINO Robot/verify_robot_S_slow_processed", 4, 5e-5),
    ):
        rows = git_table(
            mirrors,
            repo,
            f"Comparative data/{path}.csv",
            delimiter=",",
            skip_header=1,
            usecols=(0, 2, 4),
            invalid_raise=False,
        )
        rows = rows[np.isfinite(rows).all(1)]
        rows = rows[np.concatenate([[True], np.diff(rows[:, 0]) > 0])]
        time, speed, torque = means(count, *rows.T)
        save(out, name, {"time_s": time, "speed_rad_s": speed, "friction_torque_Nm": torque}, dead_band=band)


def arm7(mirrors: Path, out: Path) -> None:
    """From YIZHIXIAOCANGSHU/Friction-Identification-for-Manipulators.

    Seven-joint arm, friction as published (measured torque less rigid body). Joint 5: 350 Hz, means of 5 rows.
    """
    for joint, count in ((5, 5),):
        data = np.load(
            io.BytesIO(
                fetch(
                    mirrors,
                    "YIZHIXIAOCANGSHU/Friction-Identification-for-Manipulators",
                    f"results/real_friction_identification_joint_{joint}.npz",
                )
            )
        )
        time, speed, torque = means(count, data["time"], data["qd"][:, joint - 1], data["tau_friction"][:, joint - 1])
        save(
            out,
            f"arm7_joint{joint}",
            {"time_s": time, "speed_rad_s": speed, "friction_torque_Nm": torque},
            dead_band=0.03,
        )


def damiao(mirrors: Path, out: Path) -> None:
    """From YIZHIXIAOCANGSHU/Friction-Identification-for-Manipulators_usb2fdcan.

    Geared servo motors (1: DM8009, 3: DM4340, 5 and 7: DM4310) turning freely: ladders of dwells and ramps in both
    directions, 48 Hz, torque from quantised current, all that comes after the breakaway test. J as identified
    there (ramps, mean of three repeats; errors of 50 % and more are possible). Motor 3: rows whose speed is at the
    end of its scale (5.67 rad/s) dropped.
    """
    for motor, groups, inertia in (
        (1, "02", 0.0227),
        (3, "02", 0.0566),
        (5, "02", 0.00107),
        (7, "03", 0.00196),
        (7, "01", 0.00196),
    ):
        data = np.load(
            io.BytesIO(
                fetch(
                    mirrors,
                    "YIZHIXIAOCANGSHU/Friction-Identification-for-Manipulators_usb2fdcan",
                    f"results/runs/20260425_162832_identify-all/group_{groups}/motor_{motor:02d}/capture.npz",
                )
            ),
            allow_pickle=True,
        )
        keep = ~np.char.startswith(data["phase_name"].astype(str), "breakaway")
        if motor == 3:
            keep &= np.abs(data["velocity"]) < 5.6
        time, speed, torque = (data[k][keep] for k in ("time", "velocity", "torque_feedback"))
        name = f"servo_motor{motor}" + ("_again" if (motor, groups) == (7, "01") else "")
        save(
            out,
            name,
            {"time_s": time, "speed_rad_s": speed, "motor_torque_Nm": torque},
            {"inertia_kg_m2": inertia},
            dead_band=0.05,
        )


def sheet(data: bytes) -> np.ndarray:
    """Return the first four numbers of each row of a workbook's first sheet."""
    text = zipfile.ZipFile(io.BytesIO(data)).read("xl/worksheets/sheet1.xml").decode()
    rows = [
        [float(v) for kind, v in re.findall(r'<c r="[A-Z]+\d+"([^>]*)><v>([^<]*)</v>', row) if 't="s"' not in kind]
        for row in re.findall(r"<row .*?</row>", text, re.DOTALL)
    ]
    return np.array([row[:4] for row in rows if len(row) >= 4])


def spin_module(mirrors: Path, out: Path) -> None:
    """From three groups of students: ARGreat, rowanmle11, ethanfrick1962 (ASEN 3801, lab 3).

    ASEN 3801 lab 3 (three student groups, other files and other units than in the first set): a current for five
    seconds, then none. `wheel_*`: reaction wheel, K_T 33.5 mN m/A, every second row, for the drive sends each value
    twice; `base_10mNm`: the whole module turned by its own motor, K_T 25.5 mN m/A, sign turned. J = K_T ΔI / Δ(dω/dt)
    where the current ends (0.8 s on each side): wheel 1.07e-4 kg m² (median of 11 runs of both groups, 1.03–1.09),
    base 5.4e-3 (median of 8 runs, 4.1–7.7e-3: a torque that follows the angle disturbs it).
    """
    for name, repo, file, motor in (
        ("wheel_b_15mNm", "ARGreat/ASEN-3801-Lab3", "ASENLAB3_DAY1/2025_09_23_001_T15t5", "wheel"),
        ("wheel_b_8mNm", "ARGreat/ASEN-3801-Lab3", "ASENLAB3_DAY2/2025_07_10____3_2T8t5", "wheel"),
        ("wheel_c_16mNm", "rowanmle11/ASEN-3801-Lab-3", "RWHEEL_T16t5.xlsx", "wheel"),
        ("base_10mNm", "ethanfrick1962/ASEN3801Lab3", "data/case_BASE10", "base"),
    ):
        raw = fetch(mirrors, repo, file)
        rows = (
            sheet(raw) if file.endswith("xlsx") else np.genfromtxt(io.BytesIO(raw), skip_header=1, invalid_raise=False)
        )
        rows = rows[(rows[:, 0] >= 0) & (rows[:, 0] < 7500)]
        time, speed, current = rows[:, 0] / 1e3, rows[:, 2] * np.pi / 30, rows[:, 3]
        if motor == "wheel":
            limit = np.flatnonzero(speed > 410.0)
            good = (time > 1.2) & (time < (time[limit[0]] - 0.1 if limit.size else 6.95)) & (speed > 3.0)
            save(
                out,
                name,
                {"time_s": time[good][::2], "speed_rad_s": speed[good][::2], "motor_current_A": current[good][::2]},
                {"inertia_kg_m2": 1.07e-4, "torque_constant_Nm_A": 0.0335},
                dead_band=3.0,
            )
        else:
            good = (time > 1.3) & (time < 6.95)
            save(
                out,
                name,
                {"time_s": time[good][::2], "speed_rad_s": -speed[good][::2], "motor_current_A": current[good][::2]},
                {"inertia_kg_m2": 5.4e-3, "torque_constant_Nm_A": 0.0255},
                dead_band=0.05,
            )


def pendulum(mirrors: Path, out: Path) -> None:
    """From nielsSkov/masterThesisMatlab.

    Pendulum 2 swinging freely, 210 Hz: one row for each half swing. The loss of m g l (1 − cos θ) between two turning
    points over the angle between them is the mean friction; its speed is the mean one. m = 0.251 kg, l = 0.200 m
    (twinKalman/initTwin.m).
    """
    rows = git_table(
        mirrors, "nielsSkov/masterThesisMatlab", "parameterEstimation/data/pend2test/test1pend2.csv", delimiter=","
    )
    rows = rows[np.isfinite(rows).all(1)]
    swings(out, "pendulum2", rows[:, 0], rows[:, 1] - np.pi, 0.251 * 9.82 * 0.200)


def cart(mirrors: Path, out: Path) -> None:
    """From nielsSkov/masterThesisMatlab.

    Cart on a toothed belt, cartTest2 around 0.40 m, square wave of current, in terms of its motor as in the first
    set: τ = k_τ i − M r² dω/dt, k_τ = 93.4 mN m/A, r = 28 mm, M = 6.28 kg, 20 Hz zero-phase.
    """
    constant, radius, mass = 93.4e-3, 0.028, 6.28
    rows = git_table(
        mirrors,
        "nielsSkov/masterThesisMatlab",
        "parameterEstimation/data/cartTest2/0m40.csv",
        delimiter=",",
        invalid_raise=False,
    )[2:]
    dt = (rows[-1, 0] - rows[0, 0]) / (len(rows) - 1)
    b, a = butter(2, 20.0 * 2 * dt)
    angle = filtfilt(b, a, rows[:, 2]) / radius
    speed = np.gradient(angle, dt)
    friction = filtfilt(b, a, constant * rows[:, 1]) - mass * radius**2 * np.gradient(speed, dt)
    cut = slice(int(1.5 / dt), -int(0.6 / dt))
    save(
        out,
        "cart_d",
        {"time_s": rows[cut, 0], "speed_rad_s": speed[cut], "friction_torque_Nm": friction[cut]},
        {"inertia_kg_m2": mass * radius**2},
        dead_band=0.7,
    )


def futek(mirrors: Path, name: str) -> dict[str, np.ndarray]:
    """Return the columns of a log of the bench by name."""
    lines = [
        line
        for line in fetch(mirrors, "karthikurs/actuator-dynamometer", f"futek_data/futek_test_{name}.csv")
        .decode()
        .splitlines()
        if line and line[0] != "#"
    ]
    head = lines[0].split(",")
    table = np.array(
        [
            [float(x) if x else np.nan for x in line.split(",")]
            for line in lines[1:]
            if len(line.split(",")) == len(head)
        ]
    )
    return {key: table[:, k] for k, key in enumerate(head)}


def bench(mirrors: Path, out: Path) -> None:
    """From karthikurs/actuator-dynamometer.

    Two frameless brushless motors (no gear, g = 1) face to face with a torque sensor between them; one drives in
    steps of speed, the other idles. `bench_drag_*`: what the sensor reads while motor 1 drives = drag of the idle
    motor 2, tared by the reading at rest of the same file, means of 20 rows (0.2 s), speed of motor 2 with the sign
    of motor 1; `_up` turns one way, `_down` the other (two recordings, same day). `bench_current`: torque of the
    driving motor 1 from its current (K_T of its calibration), both drags in it, means of 20 rows. `bench_loaded`: 22
    April, motor with gear, motor 1 from its current against the sensor: friction = motor torque − sensor (tared),
    load channel = motor torque; the other actuator damps or drives, means of 10 rows (0.2 s).
    """
    for name, file in (
        ("bench_drag_up", "27_04_2021_17-33-08"),
        ("bench_drag_down", "27_04_2021_17-46-20"),
        ("bench_drag_later", "13_05_2021_17-55-58"),
    ):
        d = futek(mirrors, file)
        time, speed, sensor, mine = (
            d["time [s]"],
            d["a1 velocity [rad/s]"],
            d["trs605-5 torque [Nm]"],
            d["a1 q-axis [A]"],
        )
        driving = np.convolve(np.abs(mine), np.ones(51) / 51, "same") > 0.01  # motor 1 drives
        rest = (np.abs(speed) < 0.5) & (np.abs(d["a2 velocity [rad/s]"]) < 0.5)
        t, v, f, on = means(20, time, speed, sensor - np.median(sensor[rest]), driving.astype(float))
        spread = speed[: v.size * 20].reshape(-1, 20).std(1)
        keep = (on > 0.99) & (np.abs(v) > 3.0) & (spread < 0.1 * np.abs(v) + 1.0)
        sign = np.sign(np.median(f[keep]) * np.median(v[keep]))
        save(out, name, {"time_s": t[keep], "speed_rad_s": v[keep], "friction_torque_Nm": sign * f[keep]})
        if name == "bench_drag_later":
            current = means(20, d["a1 torque [Nm]"])[0]
            save(out, "bench_current", {"time_s": t[keep], "speed_rad_s": v[keep], "friction_torque_Nm": current[keep]})
    d = futek(mirrors, "22_04_2021_17-07-52")
    t, v, tau, sensor = means(10, d["time [s]"], d["a1 velocity [rad/s]"], d["a1 torque [Nm]"], d["trd605 torque [Nm]"])
    spread = d["a1 velocity [rad/s]"][: v.size * 10].reshape(-1, 10).std(1)
    keep = (np.abs(v) > 0.5) & (spread < 0.2 * np.abs(v) + 0.2) & (np.abs(sensor) > 0.1)
    rest = np.median(sensor[np.abs(v) < 0.1])
    save(
        out,
        "bench_loaded",
        {
            "time_s": t[keep],
            "speed_rad_s": v[keep],
            "friction_torque_Nm": (tau - (sensor - rest))[keep],
            "motor_torque_Nm": tau[keep],
        },
    )


def joint_ladder(mirrors: Path, out: Path) -> None:
    """From yinzikang/friction-identification.

    Robot joints moved to and fro at growing speed, one row for each stroke: mean torque (gravity taken off by the
    authors) and mean speed over the middle 90 %; forth and back alternate. Rows have no time: 2 s each. Joints 1 and
    6; one row at less than 1 mrad/s of joint 1 lies in the dead band.
    """
    file = fetch(mirrors, "yinzikang/friction-identification", "joint_t_v_mean_without_g.mat")
    data = loadmat(io.BytesIO(file))["joint_t_v_mean"][0]  # type: ignore[arg-type]
    for joint in (1, 6):
        torque, speed = data[joint - 1].T
        save(
            out,
            f"joint{joint}_strokes",
            {"time_s": 2.0 * np.arange(speed.size), "speed_rad_s": speed, "friction_torque_Nm": torque},
            dead_band=1e-3 if joint == 1 else 2e-4,
        )


ALL = (
    satellite,
    small_propeller,
    quad_blade,
    seven_inch,
    start_stop,
    robots,
    arm7,
    damiao,
    spin_module,
    pendulum,
    cart,
    bench,
    joint_ladder,
)

if __name__ == "__main__":
    convert(ALL)
