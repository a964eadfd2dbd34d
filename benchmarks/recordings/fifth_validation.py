"""The fifth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.fifth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.third_validation import half_swings
from benchmarks.recordings.validation import convert, means, save

AK80 = "neurobionics/TMotorCANControl"


def numbers(data: bytes, columns: int, header: int = 1) -> np.ndarray:
    """Return the first columns of the rows of a table that are complete; quotes do not count."""
    rows = []
    for line in data.decode("utf-8-sig").replace('"', "").splitlines()[header:]:
        try:
            rows.append([float(x) for x in line.split(",")[:columns]])
        except ValueError:
            continue
    return np.array([row for row in rows if len(row) == columns])


def shooter(mirrors: Path, out: Path) -> None:
    """From theol0403/7842F-Competition-Code: flywheel of a ball shooter (VEX motor, power 0) running down in air.

    Speed at 100 Hz, logged as rpm / 4; rows that are 5 % off the median of 25 are dropped, means of 25 rows. J is not
    given: 1e-3 kg m² (scales everything alike).
    """
    rows = numbers(fetch(mirrors, "theol0403/7842F-Competition-Code", "data/rampDown.csv"), 6)
    time, speed = rows[:, 0] / 1e3, rows[:, 2] * 4 * np.pi / 30
    part = (time > 30.0) & (time < 80.5)
    time, speed = time[part], speed[part]
    middle = np.array([np.median(speed[max(k - 12, 0) : k + 13]) for k in range(speed.size)])
    good = np.abs(speed / middle - 1) < 0.05
    t, v = means(25, time[good], speed[good])
    save(out, "shooter_flywheel", {"time_s": t, "speed_rad_s": v}, {"inertia_kg_m2": 1e-3}, True, 2.0)


def amplitudes(time: np.ndarray, angle: np.ndarray, periods: int, period: float, smallest: float) -> np.ndarray:
    """Return middle, amplitude and period of each window of some periods of a swing that dies down.

    Least squares of a middle, a sine that grows or shrinks linearly and its third harmonic; the period follows the
    phase.
    """
    rows, start = [], time[0]
    while start + periods * period < time[-1]:
        part = (time >= start) & (time < start + periods * period)
        x, middle = time[part] - start - periods * period / 2, start + periods * period / 2
        start += periods * period
        if x.size < 12:
            continue
        c, size, phase = np.zeros(7), 0.0, 0.0
        for _ in range(6):
            w = 2 * np.pi / period
            sine, cosine = np.sin(w * x), np.cos(w * x)
            base = [np.ones(x.size), cosine, sine, np.cos(3 * w * x), np.sin(3 * w * x), x * cosine, x * sine]
            c = np.linalg.lstsq(np.column_stack(base), angle[part], rcond=None)[0]
            size, phase = np.hypot(c[1], c[2]), np.arctan2(c[2], c[1])
            period = 2 * np.pi / (w - (c[1] * c[6] - c[2] * c[5]) / size**2)
        rows.append((middle, size + c[3] * np.cos(3 * phase) + c[4] * np.sin(3 * phase), period))
        if size < smallest:
            break
    return np.array(rows)


def loss(rows: np.ndarray, energy: np.ndarray) -> dict[str, np.ndarray]:
    """Return the mean friction between two windows: loss of energy over the way, four amplitudes a period."""
    time, size, period = rows.T
    lapse = np.diff(time)
    way = 4 * lapse * (size[1:] + size[:-1]) / (period[1:] + period[:-1])
    return {
        "time_s": (time[1:] + time[:-1]) / 2,
        "speed_rad_s": way / lapse,
        "friction_torque_Nm": (energy[:-1] - energy[1:]) / way,
    }


def thrust_stand(mirrors: Path, out: Path) -> None:
    """From thamirislibard/thrust-stand-calibration: a pendulum on flexure pivots (thrust stand) swinging freely.

    Deflection at 62 Hz in arbitrary units, a spring: the loss of a²/2 from window to window over the way, a the
    amplitude. `swings`: data13 from 40 s, when the beat has died down, to 320 s, before the ground moves it as much,
    windows of two periods; `wide_swings`: data10, several times as wide, windows of one.
    """
    for name, file, begin, end, periods in (
        ("thrust_stand_swings", 13, 40.0, 320.0, 2),
        ("thrust_stand_wide_swings", 10, 0.0, 154.0, 1),
    ):
        text = fetch(mirrors, "thamirislibard/thrust-stand-calibration", f"src/Live_Plotter/hector data/data{file}.txt")
        data = np.genfromtxt(io.StringIO(text.decode().replace(",", ".")), invalid_raise=False)
        time = np.arange(len(data)) * float(np.median(np.diff(data[:, 0])))
        keep = (time > begin) & (time < end)
        rows = amplitudes(time[keep], data[keep, 1] - data[keep, 1].mean(), periods, 1.76, 0.0005)
        save(out, name, loss(rows, rows[:, 1] ** 2 / 2))


def pendulum(mirrors: Path, out: Path) -> None:
    """From y-fysiks/PHY180-Pendulum-datafit: pendulums on an encoder, swinging freely.

    `pendulum_wide_*`: data31–33, from 1.2 rad, 100 Hz, windows of one period; `pendulum_10cm`, `_15cm`: from 0.5 rad,
    rows where the encoder (0.15°) changed, windows of two periods. Loss of 1 − cos a over the way: friction is
    in terms of m g l, which is not given. Down to 0.04 rad.
    """
    for name, file, periods, period in (
        ("pendulum_wide_1", "data31", 1, 1.06),
        ("pendulum_wide_2", "data32", 1, 1.06),
        ("pendulum_wide_3", "data33", 1, 1.06),
        ("pendulum_10cm", "Lab2/data2_10", 2, 1.48),
        ("pendulum_15cm", "Lab2/data2_15", 2, 1.36),
    ):
        data = numbers(fetch(mirrors, "y-fysiks/PHY180-Pendulum-datafit", f"{file}.csv"), 2)
        rows = amplitudes(data[:, 0], data[:, 1], periods, period, 0.04)
        rows = rows[(rows[:, 1] < 1.2) & (rows[:, 1] > 0.04)]
        save(out, name, loss(rows, -np.cos(rows[:, 1])))


def water(mirrors: Path, out: Path) -> None:
    """From Vicber507/Damped-Pendulum: a pendulum in water (Agua2), salt water and denser salt water.

    Angle in degrees from films at 30 Hz, let go twice, 5 s between; one row for each half swing as in
    `third_validation`, friction in terms of m g l (less buoyancy), which is not given.
    """
    for name, file in (("water", "Agua2"), ("salt", "Salt"), ("brine", "Dense")):
        data = np.genfromtxt(
            io.BytesIO(fetch(mirrors, "Vicber507/Damped-Pendulum", f"dataframe/{file}.csv")),
            delimiter=";",
            skip_header=1,
        )
        parts, clock = [], 0.0
        for first in (0, 3):
            run = data[np.isfinite(data[:, first : first + 2]).all(1), first : first + 2]
            rows = half_swings(run[:, 0], np.radians(run[:, 1]), 1.0, 6, 0.005)
            parts.append(np.column_stack([rows["time_s"] + clock, rows["speed_rad_s"], rows["friction_torque_Nm"]]))
            clock = parts[-1][-1, 0] + 5.0
        table = np.vstack(parts)
        columns = {"time_s": table[:, 0], "speed_rad_s": table[:, 1], "friction_torque_Nm": table[:, 2]}
        save(out, f"pendulum_{name}", columns, dead_band=0.008)


def panda(mirrors: Path, out: Path) -> None:
    """From marcocognetti/FrankaEmikaPandaDynModel: joint 7 of a Franka Panda on an exciting trajectory, 1 kHz.

    The last joint, in line with the flange: no weight. Torque of the sensor behind the gear and speed, means of 10
    rows; the inertia is next to nothing.
    """
    base = "matlab/data/Exciting_Traj/Trajectory_1/rbt_log/exciting_traj_"
    time, speed, torque = (
        git_table(mirrors, "marcocognetti/FrankaEmikaPandaDynModel", f"{base}{key}.txt", invalid_raise=False)
        for key in ("time", "velocity", "torques")
    )
    t, v, f = means(10, time, speed.reshape(-1, 7)[:, 6], torque.reshape(-1, 7)[:, 6])
    save(out, "panda_joint7", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.005)


def kr300(mirrors: Path, out: Path) -> None:
    """From JonasWeigand/Robot_Identification: joint 6 of a KUKA KR300 R2500 on three paths of 10 s, 250 Hz.

    Torque of the motor as logged (N m of the motor), speed of the motor (that of the joint times the gear, 154.3),
    J by least squares. Rows within 12 of a jump of the speed (the encoder changes its sign) are dropped.
    """
    for path, inertia in (("A", 0.00317), ("B", 0.00331), ("C", 0.00306)):
        file = f"data/recorded_trajectories/2020-10-21 10s FF {path} 08ms/data.mat"
        content = io.BytesIO(fetch(mirrors, "JonasWeigand/Robot_Identification", file))
        record = loadmat(content)["rec"][0, 0]  # type: ignore[arg-type]
        time, torque = record["time_cont"].ravel(), record["act_torque_abs_nm"][5]
        speed = np.radians(record["act_vel_mot_deg_per_s"][5]) * 154.32313
        middle = np.array([np.median(speed[max(k - 5, 0) : k + 6]) for k in range(speed.size)])
        good = np.convolve(np.abs(speed - middle) >= 2.0, np.ones(25), "same") == 0
        columns = {"time_s": time[good], "speed_rad_s": speed[good], "motor_torque_Nm": torque[good]}
        save(out, f"kr300_joint6_{path.lower()}", columns, {"inertia_kg_m2": inertia}, dead_band=0.5)


def electric_arm(mirrors: Path, out: Path) -> None:
    """From Naruton94/robot_identification: joint 1 (vertical axis) of a six-joint arm (Shanghai Electric), three paths.

    500 Hz, each value logged three times: every third row. Torque of the motor times its unit and the gear of 101
    (another/main.m), speed of the joint, J by least squares (the arm is folded otherwise on each path).
    """
    for path, inertia in ((1, 0.83), (2, 1.94), (3, 1.55)):
        base = f"matlab_identification/data/DataOutput_Traj{path}/DataOutput_"
        speed, angle, torque = (
            np.array([float(x) for x in re.findall(r":=(-?[\d.]+(?:[eE][-+]?\d+)?)", text.decode())])
            for text in (
                fetch(mirrors, "Naruton94/robot_identification", f"{base}{key}1.txt")
                for key in ("velocity", "theta", "torque")
            )
        )
        rows = np.flatnonzero(np.diff(angle, prepend=angle[0] - 1) != 0)
        columns = {
            "time_s": rows * 0.002,
            "speed_rad_s": speed[rows],
            "motor_torque_Nm": 3.442383e-4 * 101 * torque[rows],
        }
        save(out, f"electric_arm_joint1_{path}", columns, {"inertia_kg_m2": inertia}, dead_band=0.02)


def hsm(mirrors: Path, out: Path) -> None:
    """From malik-robert/HSM150-data: one motor of a two-motor bench (HSM150) through two steps of torque, 1 kHz.

    From rest, 10 s at a first torque, 10 s at a second; measured current (less its offset, which is taken off there),
    speed of the encoder, means of 10 rows. K_T = 0.0458 N m/A, J = 1.2e-4 kg m² (both in the files).
    """
    for name, file in (
        ("hsm_forward_60", "pos_0.06_1"),
        ("hsm_forward_65", "pos_0.065_1"),
        ("hsm_backward_40", "neg_0.04_1"),
        ("hsm_backward_45", "neg_0.045_1"),
    ):
        content = io.BytesIO(fetch(mirrors, "malik-robert/HSM150-data", f"Data/Identification/idf_{file}.mat"))
        data = loadmat(content)["data"]  # type: ignore[arg-type]
        time, speed, current = means(10, data[:, 0], data[:, 3], data[:, 6])
        part = time > 0.1
        columns = {"time_s": time[part], "speed_rad_s": speed[part], "motor_current_A": current[part]}
        save(out, name, columns, {"inertia_kg_m2": 1.2e-4, "torque_constant_Nm_A": 0.0458}, dead_band=3.0)


def mill(mirrors: Path, out: Path) -> None:
    """From ejhusom/cnc_milling_tool_wear (University of Michigan SMART lab): axes of a milling machine cutting wax.

    Speed [mm/s] and current [A] of the X and Y axes at 10 Hz in one experiment; K_T = 1.
    """
    for axis, number in (("X", 1), ("X", 11), ("Y", 1), ("Y", 6)):
        text = fetch(mirrors, "ejhusom/cnc_milling_tool_wear", f"data/experiment_{number:02d}.csv")
        head = text.decode().splitlines()[0].split(",")
        rows = np.genfromtxt(io.BytesIO(text), delimiter=",", skip_header=1)
        speed, current = (rows[:, head.index(f"{axis}1_{key}")] for key in ("ActualVelocity", "CurrentFeedback"))
        columns = {"time_s": 0.1 * np.arange(len(rows)), "speed_rad_s": speed, "friction_torque_Nm": current}
        save(out, f"mill_{axis.lower()}_{number}", columns, dead_band=0.3)


def ak80(mirrors: Path, out: Path) -> None:
    """From neurobionics/TMotorCANControl (GPL-3.0): a T-Motor AK80-9 with its gear on a bench with a torque sensor.

    Turned to and fro by another motor while it holds steps of torque, 100 Hz: friction = its torque as it reports it
    (from the current) + that of the sensor (which has the other sign); means of 4 rows at steady speed. `loaded`:
    system_id_test_opposing_motor_2; `fast`: system_id_test_1 (up to 5 rad/s); `compensated`:
    system_id_torque_compensation_worked (it reports its torque by a model that has the torque constant and the friction
    of those fitted). `ak80_idle`: a ladder of slow speeds without load, 200 Hz, current i_q, K_T = 0.095 · 9 N m/A.
    """
    for name, file in (
        ("ak80_loaded", "system_id_test_opposing_motor_2"),
        ("ak80_fast", "system_id_test_1"),
        ("ak80_compensated", "system_id_torque_compensation_worked"),
    ):
        rows = numbers(
            fetch(mirrors, AK80, f"src/TMotorCANControl/test/saved_logs/SysID/{file}/log_adc_and_motor.csv"), 6
        )
        t, v, sensor, motor = means(4, rows[:, 0], rows[:, 5], rows[:, 2], rows[:, 3])
        spread = rows[: v.size * 4, 5].reshape(-1, 4).std(1)
        keep = (np.abs(v) > 0.5) & (np.abs(v) < 8.0) & (spread < 0.3)
        columns = {
            "time_s": t[keep],
            "speed_rad_s": v[keep],
            "friction_torque_Nm": (motor + sensor)[keep],
            "motor_torque_Nm": motor[keep],
        }
        save(out, name, columns)
    rows = numbers(fetch(mirrors, AK80, "src/TMotorCANControl/test/servo_can/Measuring_velocities_1_rps.csv"), 9)
    t, v, current = means(4, rows[:, 1], rows[:, 2], rows[:, 5])
    part = t > 1.3
    save(
        out,
        "ak80_idle",
        {"time_s": t[part], "speed_rad_s": v[part], "motor_current_A": current[part]},
        {"inertia_kg_m2": 0.0049, "torque_constant_Nm_A": 0.095 * 9},
        dead_band=0.02,
    )


def ripple_bench(mirrors: Path, out: Path) -> None:
    """From Otteri/torque-ripple-data: a motor of 6 kW (MS4887) turned at 60 rpm against a torque transducer, 1 kHz.

    Torque as logged (its unit is not given), at 0, 50 and 80 % load, compensation off; the speed, held to 0.1 % on the
    mean (the lines of the torque lie at whole Hz), is taken as 60 rpm: it was logged in other runs. Means of 50 rows
    (that takes out a strong line of 60 a turn).
    """
    for name, file in (
        ("ripple_bench_0", "PI-ILC-MS4887/generating/60rpm-torque/ILC-OFF_0%-load.txt"),
        ("ripple_bench_50", "PI-QLR-MS4887/torque_60rpm/Qlr-OFF_50%-load.Monitor.txt"),
        ("ripple_bench_80", "PI-ILC-MS4887/generating/60rpm-torque/ILC-OFF_80%-load.txt"),
    ):
        text = fetch(mirrors, "Otteri/torque-ripple-data", f"experimental-data/{file}").decode("latin1")
        rows = [line.split("\t")[:2] for line in text.replace(",", ".").splitlines()[1:]]
        data = np.array([[float(x) for x in row] for row in rows if len(row) == 2 and row[1].strip()])
        t, torque = means(50, data[:, 0], data[:, 1])
        speed = np.full(t.size, 2 * np.pi)
        save(out, name, {"time_s": t, "speed_rad_s": speed, "friction_torque_Nm": np.sign(torque.mean()) * torque})


ALL = (shooter, thrust_stand, pendulum, water, panda, kr300, electric_arm, hsm, mill, ak80, ripple_bench)

if __name__ == "__main__":
    convert(ALL)
