"""The seventeenth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.seventeenth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import even, smooth
from benchmarks.recordings.ninth_validation import RPM
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.third_validation import half_swings
from benchmarks.recordings.validation import convert, means, save


def running_down(mirrors: Path, out: Path) -> None:
    """From three students' haptic joysticks (no licence): a small motor with gearhead runs down, its angle is read.

    J is not given: 1e-6 kg m² (scales everything alike). `spin_down_a`, `spin_down_b`, `spin_down_c`
    (BrennaManning/elecanisms): every 10.5 ms, 8192 counts a turn (its calibration); speed over two rows, until it
    stops. `spin_down_long` (LoganSweet/elecanisms2018): degrees every 1.3 ms, speed over 20 rows without a pause of
    more than 2 ms, from 650 rad/s, when the log goes on with the motor off, to the stop. `spin_down_volts`
    (cariley/elecanisms): the sensor's voltage every 0.14 ms, which falls and jumps back, twice a turn; speed over two
    turns, from the largest one on.
    """
    wheel = {"inertia_kg_m2": 1e-6}
    for name, file in (("a", "angle_spindown"), ("b", "angle_spindown 2"), ("c", "angle_spindown1")):
        path = f"miniproject1/data/{file}.csv"
        log = git_table(mirrors, "BrennaManning/elecanisms", path, delimiter=",", skip_header=1)[1::2]
        turned = np.unwrap(log[:, 1], period=8192.0) * 2 * np.pi / 8192.0
        time, speed = (log[1:, 2] + log[:-1, 2]) / 2, np.abs(np.diff(turned) / np.diff(log[:, 2]))
        last = int(np.flatnonzero(speed < 1.5)[0])
        columns = {"time_s": time[2:last], "speed_rad_s": speed[2:last]}
        save(out, f"spin_down_{name}", columns, wheel, True, 1.0)

    path = "miniproject1/angledata_final3.csv"
    log = git_table(mirrors, "LoganSweet/elecanisms2018", path, delimiter=",")
    log = log[log[:, 1] > log[0, 1] + 8.45]
    longest = np.maximum.reduceat(np.diff(log[:, 1]), np.arange(0, len(log) - 1, 20))
    at, turned = log[::20, 1], np.unwrap(np.radians(log[:, 0]))[::20]
    time, speed = (at[1:] + at[:-1]) / 2, np.diff(turned) / np.diff(at)
    last = int(np.flatnonzero(speed < 5.0)[0])
    good = np.flatnonzero(longest[:last] < 2e-3)
    save(out, "spin_down_long", {"time_s": time[good], "speed_rad_s": speed[good]}, wheel, True, 5.0)

    path = "MiniLab1_Report/Data/SpinDown_Data_NoAveraging.txt"
    log = git_table(mirrors, "cariley/elecanisms", path, delimiter=",", skip_header=1)
    back = np.flatnonzero(np.diff(log[:, 1]) > 1.0)
    at = log[back[np.append(True, np.diff(back) > 8)], 0][::4]
    time, speed = (at[1:] + at[:-1]) / 2, 4 * np.pi / np.diff(at)
    first = int(np.convolve(speed, np.ones(9) / 9, "same").argmax())
    save(out, "spin_down_volts", {"time_s": time[first:], "speed_rad_s": speed[first:]}, wheel, True, 5.0)


def table_axis(mirrors: Path, out: Path) -> None:
    """From Gigahawk/mech467 (no licence): the table of a machine tool on a ball screw, another year's students.

    Constants of the laboratory's manual as in `eleventh_validation`: current = 0.887 A/V of the amplifier's input, K_T
    0.72 N m/A, lead 20 mm, J = 5.9e-4 kg m²; angle of the screw from the table's position, 2 kHz, torque and angle
    low-pass filtered at 10 Hz. Friction = torque − J dω/dt. `axis_out`, `axis_back`: constant speeds of 5 to 200 mm/s,
    means over 0.05 s (0.2 s up to 35 mm/s) from 0.15 s after that speed is reached until 0.15 s before it ends, one
    speed after the other.
    """
    clock_end, rows = 0.0, []
    for feed in (5, 10, 20, 35, 50, 60, 70, 80, 120, 160, 200):
        data = io.BytesIO(fetch(mirrors, "Gigahawk/mech467", f"Labs/Lab 1/data/part_1/{feed}_mmps.mat"))
        log = loadmat(data, simplify_cells=True)["output"]  # type: ignore[arg-type]
        clock, place, volts = (log[key] for key in ("time", "CH1out", "CH1sig"))
        time, angle, torque = even(2000.0, clock, place * np.pi / 10, 0.72 * 0.887 * volts)
        speed, torque = np.gradient(smooth(2000.0, 10.0, angle), 5e-4), smooth(2000.0, 10.0, torque)
        torque -= 5.9e-4 * np.gradient(speed, 5e-4)
        for way in (1.0, -1.0):
            on = np.flatnonzero(np.abs(speed - way * feed * np.pi / 10) < 0.2 * feed * np.pi / 10)
            part = slice(int(on[0]) + 300, int(on[-1]) - 300)
            t, v, f = means(400 if feed < 40 else 100, time[part], speed[part], torque[part])
            rows.append(np.column_stack([np.full(t.size, way), clock_end + t, v, f]))
        clock_end += float(time[-1]) + 1.0
    table = np.concatenate(rows)
    for name, way in (("out", 1.0), ("back", -1.0)):
        t, v, f = table[table[:, 0] == way, 1:].T
        save(out, f"axis_{name}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def copter(mirrors: Path, out: Path) -> None:
    """From fdcl-gwu/motor_test (no licence): a motor with a propeller on a stand under a slowly growing command.

    About 100 Hz; time of a turn in µs, current and voltage in tenths (post_proc.py). Electrical power over the speed
    stands for the torque, thus with the losses of the motor; means of 40 rows. `copter_a`, `copter_b`, `copter_c`:
    power_command, power_command_3 and calibration.
    """
    for name, file in (("a", "power_command"), ("b", "power_command_3"), ("c", "calibration")):
        log = np.load(io.BytesIO(fetch(mirrors, "fdcl-gwu/motor_test", f"{file}.npy"))).astype(float)
        speed = 2e6 * np.pi / log[:, 1]
        t, v, f = means(40, 0.01 * np.arange(len(log)), speed, 0.01 * log[:, 3] * log[:, 5] / speed)
        save(out, f"copter_{name}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def small_propeller(mirrors: Path, out: Path) -> None:
    """From wil3/motor_modeling (no licence): motor and propeller of a tiny copter on a stand, throttle up and down.

    About 20 Hz, two load cells at the ends of a beam: their difference (N m by their own scale) is the torque, at rest
    not zero and not the same before and after; speed (rpm) counted over a while, from 500 rad/s. `small_copter_a`:
    data2, `small_copter_b`: tinyhawk_15k_ramp.
    """
    for name, file in (("a", "data2"), ("b", "tinyhawk_15k_ramp")):
        log = git_table(mirrors, "wil3/motor_modeling", f"motor_modeling/data/{file}.csv", delimiter=",")
        log = log[np.append(True, np.diff(log[:, 0]) > 0.0)]
        time, _, left, right, turns = log[RPM * log[:, 4] > 500.0].T
        rest = np.diff(log[:20, 2:4].mean(0))
        columns = {"time_s": time, "speed_rad_s": RPM * turns, "friction_torque_Nm": right - left - rest}
        save(out, f"small_copter_{name}", columns)


def cube_wheel(mirrors: Path, out: Path) -> None:
    """From MikkelSPedersen/P6_Regulering_af_Cubli (no licence): the reaction wheel of a cube at constant speeds.

    500 to 5000 rpm in steps of 500, 10 s each, 51 Hz; the motor's current (A) stands for the torque; means of ten rows,
    one speed after the other, here half a minute apart.
    """
    clock, rows = 0.0, []
    for turns in range(500, 5001, 500):
        path = f"Test/Parameter/B_H/{turns}.csv"
        log = git_table(mirrors, "MikkelSPedersen/P6_Regulering_af_Cubli", path, delimiter=",")
        t, current, speed = means(10, *log.T)
        rows.append(np.column_stack([clock + t / 1e3, RPM * speed, current]))
        clock += 30.0
    t, v, f = np.concatenate(rows).T
    save(out, "cube_wheel", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def rotors(mirrors: Path, out: Path) -> None:
    """From dli43/Elec391 (no licence): two rotors of a flying model, their speed over the duty from −255 to 255.

    Duty stands for the torque (what the turning motor induces is its viscous part), speed from a magnetic sensor, where
    they turn; no times: a row a second.
    """
    path = "final-demo/rotor-speed-characteristic/rotor_speed_data.csv"
    log = git_table(mirrors, "dli43/Elec391", path, delimiter=",", skip_header=1)
    for name, column in (("rotor_left", 2), ("rotor_right", 4)):
        rows = log[np.abs(log[:, column]) > 1.0]
        t = np.arange(len(rows), dtype=float)
        save(out, name, {"time_s": t, "speed_rad_s": rows[:, column], "friction_torque_Nm": rows[:, 0]}, dead_band=0.5)


def robot_joints(mirrors: Path, out: Path) -> None:
    """From YanjunLIU-ac/Dynamic_Parameter_Identification_for_Rokae_xMate (no licence): joints of a robot, all moving.

    1 kHz, 20 s: angle, torque of the motor in units of its own (N m before the gear) and of a sensor behind the gear
    (N m), low-pass filtered at 5 Hz, speed from the angle. Friction = k · motor − J dω/dt − sensor, k and J by least
    squares beside dry and viscous friction; so the weight of the arm drops out. Means of 50 rows, half a second left
    out at both ends.
    """
    repo, folder = "YanjunLIU-ac/Dynamic_Parameter_Identification_for_Rokae_xMate", "filtering/data/excit"
    logs = [git_table(mirrors, repo, f"{folder}/excit_{kind}_record.txt") for kind in ("ang", "motor", "torque")]
    for joint in range(6):
        angle, motor, sensor = (smooth(1000.0, 5.0, log[:, joint]) for log in logs)
        speed = np.gradient(angle, 1e-3)
        slope = np.gradient(speed, 1e-3)
        on = np.abs(speed) > 0.02
        base = np.column_stack([motor, -slope, -np.sign(speed), -speed])
        k, inertia = np.linalg.lstsq(base[on], sensor[on], rcond=None)[0][:2]
        time = 1e-3 * np.arange(angle.size)
        t, v, f, m = (x[10:-10] for x in means(50, time, speed, k * motor - inertia * slope - sensor, k * motor))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "motor_torque_Nm": m}
        save(out, f"xmate_{joint + 1}", columns, {"inertia_kg_m2": float(f"{inertia:.4g}")}, dead_band=0.02)


def cart_pendulum(mirrors: Path, out: Path) -> None:
    """From francofusco/pendule_pi (BSD-3): a pendulum on a cart that a geared motor moves by a belt along 0.55 m.

    Every 5 ms. `cart_runs`, `cart_runs_again`: the duty (of 255) from 50 to 250, forth and back, a run each
    (logged_motion, logged_motion_no_offsets). Duty stands for the torque (what the turning motor induces is its viscous
    part), speed (m/s) from the place, low-pass filtered at 5 Hz; friction = duty − J dω/dt, J by least squares beside
    dry and viscous friction and an offset; means of 20 rows, 0.2 s left out at both ends of a run. `swung_high`,
    `swung_low`: the pendulum swings freely, encoder with 4000 counts a turn, pieces of 5 s with pauses: half swings of
    each piece as in `third_validation`, in terms of m g l; the second run begins upright.
    """
    repo, folder = "francofusco/pendule_pi", "src/bin/identification"
    for name, file in (("cart_runs", "logged_motion"), ("cart_runs_again", "logged_motion_no_offsets")):
        log = git_table(mirrors, repo, f"{folder}/{file}.csv", delimiter=",", skip_header=1)
        parts = []
        for run in np.split(log, np.flatnonzero(np.diff(log[:, 1]) > 2e4) + 1):
            speed = np.gradient(smooth(200.0, 5.0, run[:, 2]), 5e-3)
            within = (x[40:-40] for x in (run[:, 1] * 1e-6, speed, np.gradient(speed, 5e-3), run[:, 0]))
            parts.append(means(20, *within))
        t, v, slope, duty = np.concatenate(parts, axis=1)
        base = np.column_stack([slope, np.sign(v), v, np.ones_like(v)])
        inertia = float(f"{np.linalg.lstsq(base, duty, rcond=None)[0][0]:.4g}")
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": duty - inertia * slope}
        save(out, name, columns, dead_band=0.02)

    log = git_table(mirrors, repo, f"{folder}/logged_angles.csv", delimiter=",", skip_header=1)
    tables = []
    for piece in range(10):
        rows = log[log[:, 0] == piece]
        angle = (rows[:, 2] - (0.0 if piece < 5 else 4000.0)) * 2 * np.pi / 4000.0
        first = int(np.flatnonzero(np.diff(np.sign(angle)) != 0)[0])
        tables.append(half_swings(1e-6 * rows[first:, 1], angle[first:], 1.0, 10, 0.03))
    save(
        out, "cart_swings", {key: np.concatenate([table[key] for table in tables]) for key in tables[0]}, dead_band=0.05
    )


ALL = (*(running_down, table_axis, copter, small_propeller, cube_wheel, rotors, robot_joints, cart_pendulum),)

if __name__ == "__main__":
    convert(ALL)
