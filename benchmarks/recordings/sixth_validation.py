"""The sixth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.sixth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: some of it has no licence.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.third_validation import half_swings
from benchmarks.recordings.validation import convert, means, save

ARMS = "SedkiLmm/dynamic-identification"
WINCHES = "eliasoa/TTK4900_CDPR"
AREA = np.pi * 12.5**2 / 10  # mm² of a piston of 25 mm, to N at 1 bar


def rowing(mirrors: Path, out: Path) -> None:
    """From Abasz/ESPRowingMonitor (GPL-3.0): flywheels of rowing and kayak machines running down after a pull.

    Fans in air, at two positions of the damper each. The files hold the times between pulses; a pulse that was missed
    doubles its time and is put in. One row a turn, so that the spacing of the magnets cancels, from the first to the
    last time [s] and down to the slowest speed. Pulses a turn and J [kg m²] as in the profiles of the repository.
    """
    for name, file, pulses, inertia, first, last, slowest in (
        ("air_rower_a", "genericAir/damper-bug-54", 3, 0.07848, 56.0, 120.0, 4.0),
        ("air_rower_b", "genericAir/damper-bug-54", 3, 0.07848, 301.9, 390.0, 4.0),
        ("air_rower_c", "genericAir/interval-200_2000_200-743", 3, 0.07848, 503.4, 560.0, 6.0),
        ("air_rower_d", "genericAir/interval-5x100+500-646", 3, 0.07848, 1763.6, 1800.0, 6.0),
        ("kayak_closed", "kayakFirst/closed-fast-100", 3, 0.02527962, 0.0, 1e4, 8.0),
        ("kayak_open", "kayakFirst/open-fast-50", 3, 0.02527962, 0.0, 1e4, 8.0),
        ("danube_closed", "oldDanube/fast-closed-100", 6, 0.0899, 0.0, 1e4, 16.0),
        ("danube_open", "oldDanube/fast-open-50", 6, 0.0899, 0.0, 1e4, 4.0),
    ):
        step = git_table(mirrors, "Abasz/ESPRowingMonitor", f"test/calibration/{file}-test.txt") / 1e6
        usual = np.array([np.median(step[max(k - 4, 0) : k + 5]) for k in range(step.size)])
        missed = (step > 1.7 * usual) & (step < 2.4 * usual)
        pulse = np.cumsum(step)
        turn = np.sort(np.concatenate([pulse, (pulse - step / 2)[missed]]))[::pulses]
        time, speed = (turn[1:] + turn[:-1]) / 2, 2 * np.pi / np.diff(turn)
        if first == 0.0:  # after the last pull: from the last turn that was faster than the next ten
            first = time[np.flatnonzero([speed[k] < speed[k + 1 : k + 11].max() for k in range(speed.size - 10)])[-1]]
        rows = np.flatnonzero((time > first) & (time < last))
        slow = np.flatnonzero(speed[rows] < slowest)
        rows = rows[2 : slow[0] if slow.size else None]
        save(out, name, {"time_s": time[rows], "speed_rad_s": speed[rows]}, {"inertia_kg_m2": inertia}, True, 0.5)


def spinner(mirrors: Path, out: Path) -> None:
    """From xavieryn/P1: a fidget spinner with three lobes running down, filmed at 60 Hz.

    Mean brightness of a spot. The frequency of the lobes, every half second, is that of the strongest sine under a Hann
    window of 1 s or four periods, from below half the rate of the film. J is not given: 1e-4 kg m² (scales everything
    alike).
    """
    film = loadmat(io.BytesIO(fetch(mirrors, "xavieryn/P1", "IMG_9567.MOV.mat")))  # type: ignore[arg-type]
    light, rate = film["y"].ravel(), film["Fs"].item()
    middles, frequency = np.arange(14.0, 69.0, 0.5), [26.5]
    for middle in middles:
        reach = max(0.5, 2.0 / frequency[-1])
        rows = np.arange(int((middle - reach) * rate), int((middle + reach) * rate) + 1)
        window = np.hanning(rows.size) * (light[rows] - light[rows].mean())
        tried = frequency[-1] * np.linspace(0.8, 1.02, 2000)
        power = np.abs(np.exp(-2j * np.pi / rate * np.outer(tried, rows - middle * rate)) @ window)
        frequency.append(float(tried[power.argmax()]))
    speed = 2 * np.pi / 3 * np.array(frequency[1:])
    save(out, "fidget_spinner", {"time_s": middles, "speed_rad_s": speed}, {"inertia_kg_m2": 1e-4}, True, 0.5)


def ur5(mirrors: Path, out: Path) -> None:
    """From SedkiLmm/dynamic-identification (MIT): joints of a UR5 on a sine of 10 s, one after the other, 100 Hz.

    Current of the motor as logged (A, unit of torque here), speed of the joint, means of 4 rows while the sine runs.
    Gravity as a sine and a cosine of the angle is taken off joint 4 by least squares with dry and viscous friction.
    """
    for joint, first, last in ((1, 5.0, 59.5), (4, 8.0, 63.0), (5, 7.0, 62.0), (6, 8.5, 64.0)):
        rows = git_table(mirrors, ARMS, f"data/ur5/jointwise_motion/ur-20_01_22-joint_{joint}.csv", delimiter=",")
        rows[:, 0] -= rows[0, 0]
        rows = rows[(rows[:, 0] > first) & (rows[:, 0] < last)]
        rows = rows[np.append(True, np.diff(rows[:, 0]) > 0)]
        angle, speed, current = rows[:, joint], rows[:, 6 + joint], rows[:, 12 + joint]
        if joint == 4:
            base = np.column_stack([np.sin(angle), np.cos(angle), np.sign(speed), speed])
            current = current - base[:, :2] @ np.linalg.lstsq(base, current, rcond=None)[0][:2]
        t, v, f = means(4, rows[:, 0], speed, current)
        save(out, f"ur5_joint{joint}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.01)


def kinova(mirrors: Path, out: Path) -> None:
    """From SedkiLmm/dynamic-identification (MIT): joints of a Kinova Gen3 on one trapezoid of speed, one way, 1 kHz.

    Joints that carry no weight in that pose. Torque from the current, speed as reported, means of 10 rows; J by least
    squares.
    """
    for joint, inertia in ((3, 0.50), (5, 0.11), (7, 0.10)):
        text = fetch(mirrors, ARMS, f"data/kinova/jointwise_motion/joint_{joint}_trapez.csv")
        head = text.decode().splitlines()[0].split(",")
        rows = np.genfromtxt(io.BytesIO(text), delimiter=",", skip_header=1)
        speed, torque = rows[:, head.index(f"Velocity{joint}")], rows[:, head.index(f"TorqueCur{joint}")]
        t, v, f = means(10, rows[:, 0] / 1e3, speed, torque)
        columns = {"time_s": t, "speed_rad_s": v, "motor_torque_Nm": f}
        save(out, f"kinova_trapezoid{joint}", columns, {"inertia_kg_m2": inertia}, dead_band=0.01)


def seals(mirrors: Path, out: Path) -> None:
    """From EvaZillen/3D-printed-pneumatic-actuator (CC0): printed pneumatic cylinders drawn to and fro under pressure.

    Seals: an O-ring and three lip seals. Position by laser [mm], force [N] and pressure [bar] at 100 Hz; friction =
    force − pressure × area of the piston (25 mm); speed = slope of a line over 9 rows [mm/s]. Means of 4 rows; those
    at twice the usual speed (jumps of the laser) are dropped.
    """
    for name, file in (
        ("seal_o_ring", "O-ring_3bar"),
        ("seal_o_ring_7bar", "O-ring_7bar"),
        ("seal_kdn", "KDN_3bar"),
        ("seal_napn", "NAPN_5bar"),
        ("seal_pk", "PK_1bar"),
    ):
        path = f"results_pneumatic-actuator/data/friction/{file}.csv"
        rows = git_table(mirrors, "EvaZillen/3D-printed-pneumatic-actuator", path, invalid_raise=False)
        time = 0.01 * np.arange(len(rows)) * np.median(np.diff(rows[::100, 0])) / 1e3
        weights = np.arange(4, -5, -1) / 60 / (time[1] - time[0])
        speed = np.convolve(rows[:, 4], weights, "same")
        t, v, f = means(4, *(c[100:-100] for c in (time, speed, rows[:, 6] - AREA * rows[:, 5])))
        good = np.abs(v) < 2.0 * np.median(np.abs(v))
        columns = {"time_s": t[good], "speed_rad_s": v[good], "friction_torque_Nm": f[good]}
        save(out, name, columns, dead_band=0.5)


def wheel_motors(mirrors: Path, out: Path) -> None:
    """From BrOleg5/research-wheel-slippage (MIT): geared motors of an omnidirectional robot, wheels in the air.

    Dwells at seven speeds, to and fro. Current without its sign (taken from the speed), K_T = 0.0514 N m/A
    (scripts there), speed of the motor; 33 Hz, from 1 s after each change on, means of 4 rows. `_again`: the other
    recording, without the integral part of the controller.
    """
    for name, motor, part in (("1", 0, "with"), ("2", 1, "with"), ("3", 2, "with"), ("1_again", 0, "without")):
        path = f"datasets/dc_motor_model_identification/data_for_identification_{part}_integral.csv"
        rows = git_table(mirrors, "BrOleg5/research-wheel-slippage", path, delimiter=";", skip_header=3)
        wanted, blocks = rows[:, 1 + motor], []
        for block in np.split(rows, np.flatnonzero(np.diff(wanted)) + 1):
            block = block[block[:, 0] > block[0, 0] + 1e3]
            if len(block) > 8 and block[0, 1 + motor] != 0:
                direction = np.sign(block[0, 1 + motor])
                t, v, i = means(4, block[:, 0] / 1e3, block[:, 7 + motor], block[:, 10 + motor])
                blocks.append(np.column_stack([t, v, 0.0514 * direction * i])[v * direction > 5.0])
        table = np.vstack(blocks)
        columns = {"time_s": table[:, 0], "speed_rad_s": table[:, 1], "friction_torque_Nm": table[:, 2]}
        save(out, f"wheel_motor_{name}", columns)


def winches(mirrors: Path, out: Path) -> None:
    """From eliasoa/TTK4900_CDPR: winches of a cable robot (ODrive).

    `winch_N`: motor N with its drum free, torque lowered by 1 mN m at a time (four motors in turn, 2.2 s) until it
    stands, several times; torque set [N m], that of the step before the logged one, and speed. Rows below the limit of
    the speed. `winch_lift`: a weight of 5 kg up, down and up, `_slow`: up at half a turn a second, `_light` and
    `winch_lower_light`: 1 kg up and down; torque from the current, K_T = 8.27/150 N m/A (Plot.m), angle of the motor,
    31 Hz, rows at more than 0.2 turns/s.
    """
    logs = loadmat(io.BytesIO(fetch(mirrors, WINCHES, "DynamicTorque/DynamicalTorque.mat")))  # type: ignore[arg-type]
    for motor in (0, 1, 3):
        speed, torque = logs["VelLog"][motor], logs["TorqueLog"][motor]
        good = (speed > 0.3) & (speed < 9.2)
        columns = {
            "time_s": 2.2 * np.arange(speed.size)[good],
            "speed_rad_s": 2 * np.pi * speed[good],
            "friction_torque_Nm": torque[good] + 0.001,
        }
        save(out, f"winch_{motor}", columns)
    for name, file, motor in (
        ("winch_lift", "5kg/ODrive3/Up1", 3),
        ("winch_lift_slow", "5kg/ODrive2/Up05", 2),
        ("winch_lift_light", "1kg/ODrive2/Up05", 2),
        ("winch_lower_light", "1kg/ODrive2/Down05", 2),
    ):
        text = fetch(mirrors, WINCHES, f"Lifting_tests/{file}.csv")
        rows = np.genfromtxt(io.BytesIO(text), delimiter=",", skip_header=1)
        time, angle, speed, current = rows[:, 0], rows[:, 1 + motor], rows[:, 5 + motor], rows[:, 9 + motor]
        good = np.isfinite(time + angle + speed + current) & (np.abs(speed) > 0.2)
        good &= np.diff(time, prepend=time[0] - 1) > 0
        columns = {
            "time_s": time[good],
            "speed_rad_s": 2 * np.pi * speed[good],
            "friction_torque_Nm": -8.27 / 150 * current[good],
            "angle_rad": 2 * np.pi * angle[good],
        }
        save(out, name, columns)


def pendulums(mirrors: Path, out: Path) -> None:
    """From timdrysdale/pendulum-data and Amirjf/single-rod-pendulum: pendulums swinging freely.

    `remote_pendulum`: of a remote laboratory, on an encoder (0.15°), 50 Hz, its drive coil switched off (run 5 from
    5.8 s, run 6, third part); `rod_pendulum`: on a cart at rest, angle from an inertial sensor (Kalman filter there),
    40 Hz. One row for each half swing as in `third_validation`, friction in terms of m g l, which is not given.
    """
    remote = [
        git_table(mirrors, "timdrysdale/pendulum-data", f"data/pend00-run0{run}.csv", delimiter=",", skip_header=1)
        for run in (5, 6)
    ]
    last = remote[1][int(np.flatnonzero(np.diff(remote[1][:, 0]) < 0)[-1]) + 1 :]
    rod = git_table(
        mirrors,
        "Amirjf/single-rod-pendulum",
        "datasets/filtered_datasets/half_theta_2_kalman_output.csv",
        delimiter=",",
        skip_header=1,
    )
    for name, rows, first, lowest in (
        ("remote_pendulum", remote[0], 5.8, 0.05),
        ("remote_pendulum_again", last, 0.8, 0.05),
        ("rod_pendulum", rod, 2.0, 0.05),
    ):
        part = rows[:, 0] > first
        time, angle = rows[part, 0], rows[part, 1]
        angle = angle - np.median(angle[-20:])
        save(out, name, half_swings(time, angle, 1.0, 3, lowest), dead_band=0.01)


def seven_joints(mirrors: Path, out: Path) -> None:
    """From dbdxnuliba/sawyer-dynamics-identify-v1.1 and songtangzhong/robot-dynamics-identify-v1.3: last joints.

    Seven-joint arms (Sawyer; the other's maker is not named) on exciting paths, filtered as in the repositories, 100 Hz
    and 1 kHz (every twentieth row). Torque and speed of joint 7, J by least squares.
    """
    sawyer = [
        git_table(
            mirrors,
            "dbdxnuliba/sawyer-dynamics-identify-v1.1",
            f"examples/least_square_estimate/filter_data/{key}_filter.txt",
        )
        for key in ("qDot", "tau")
    ]
    other = []
    for key in ("qDot", "tau"):
        path = f"examples/least_square_estimate/filter_data/{key}_filter.mat"
        content = loadmat(io.BytesIO(fetch(mirrors, "songtangzhong/robot-dynamics-identify-v1.3", path)))  # type: ignore[arg-type]
        other.append(next(value for name, value in content.items() if not name.startswith("_"))[::20])
    for name, (speed, torque), step, inertia in (
        ("sawyer_joint7", sawyer, 0.01, 0.123),
        ("seven_joint7", other, 0.02, 0.093),
    ):
        columns = {
            "time_s": step * np.arange(len(speed)),
            "speed_rad_s": speed[:, 6],
            "motor_torque_Nm": torque[:, 6],
        }
        save(out, name, columns, {"inertia_kg_m2": inertia}, dead_band=0.01)


def coasting_car(mirrors: Path, out: Path) -> None:
    """From FelipeEckert/coastdown-mda-split: an electric car (Ioniq) coasting on a track, two ways in turn.

    Times over steps of 5 km/h, from 95 to 70 km/h and from 50 to 35 km/h (the steps that agree with the distances): one
    row a step, friction = deceleration (of 1 kg), speed in m/s, negative on the way back. Same day, in order, 5 s
    between two runs.
    """
    table, clock = [], 0.0
    for file, top in (("baixas ioniq_16012026", 50.0), ("altas ioniq_16012026", 95.0)):
        text = fetch(mirrors, "FelipeEckert/coastdown-mda-split", f"sample_data/Split/coastdown/{file}.csv")
        for row in csv.reader(io.StringIO(text.decode("utf-8-sig"))):
            if row[:3:2] == ["", "Average"]:  # the same runs follow once more, by direction
                break
            if len(row) > 9 and row[0] in ("On", "Off"):
                way = 1.0 if row[1] == "+" else -1.0
                for k, lapse in enumerate(float(x) for x in row[7:] if x):
                    table.append((clock + lapse / 2, way * (top - 2.5 - 5 * k) / 3.6, way * 5 / 3.6 / lapse))
                    clock += lapse
                clock += 5.0
    data = np.array(table)
    columns = {"time_s": data[:, 0], "speed_rad_s": data[:, 1], "friction_torque_Nm": data[:, 2]}
    save(out, "coasting_car", columns)


ALL = (rowing, spinner, ur5, kinova, seals, wheel_motors, winches, pendulums, seven_joints, coasting_car)

if __name__ == "__main__":
    convert(ALL)
