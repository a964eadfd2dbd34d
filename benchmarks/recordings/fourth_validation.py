"""The fourth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.fourth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.recordings.second_validation import git_table
from benchmarks.recordings.validation import convert, means, save, slope

ROWING = "JaapvanEkris/openrowingmonitor"
COGGING = "heitor-andrade/laas_anti_cogging"
ERGOMETERS = {  # magnets a turn and inertia [kg m²] (config/rowerProfiles.js)
    "Concept2_Model_C": (3, 0.10148),
    "Concept2_RowErg_Session_2000meters": (6, 0.101545),
    "KayakFirst_Blue_4x500m": (6, 0.039),
    "Merach_R50_510m": (1, 0.105),
    "Oartec_Slider": (3, 0.1057),
    "RX800": (4, 0.180),
    "Schwinn_Windrigger": (1, 0.08),
}


def flywheel(mirrors: Path, name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Return times and speeds of whole turns (so that the spacing of the magnets cancels) and the inertia.

    The file holds the times between pulses. A pulse that was missed doubles its time: such times are halved. A pulse
    that comes within a fifth of the usual time bounced.
    """
    magnets, inertia = ERGOMETERS[name]
    step = git_table(mirrors, ROWING, f"recordings/{name}.csv")
    usual = np.array([np.median(step[max(k - 4, 0) : k + 5]) for k in range(step.size)])
    pulse = np.cumsum(step)
    missed = (step > 1.7 * usual) & (step < 2.4 * usual)
    pulse = np.sort(np.concatenate([pulse[step > 0.2 * usual], (pulse - step / 2)[missed]]))
    turn = pulse[::magnets]
    return (turn[1:] + turn[:-1]) / 2, 2 * np.pi / np.diff(turn), inertia


def ergometer_stops(mirrors: Path, out: Path) -> None:
    """From JaapvanEkris/openrowingmonitor (GPL-3.0): flywheels of rowing machines running down after the last stroke.

    Fans in air. From `first` s on down to the slowest speed, one row a turn.
    """
    for name, file, first, slowest in (
        ("erg_model_c", "Concept2_Model_C", 164.0, 36.0),
        ("erg_kayak", "KayakFirst_Blue_4x500m", 1324.0, 6.0),
        ("erg_oartec", "Oartec_Slider", 48.5, 10.0),
        ("erg_schwinn", "Schwinn_Windrigger", 113.3, 6.0),
        ("erg_schwinn_pause", "Schwinn_Windrigger", 94.4, 43.0),
        ("erg_merach", "Merach_R50_510m", 162.3, 10.0),
    ):
        time, speed, inertia = flywheel(mirrors, file)
        start = int(np.searchsorted(time, first))
        slow = np.flatnonzero(speed[start:] < slowest)
        part = slice(start, start + int(slow[0]) if slow.size else None)
        save(out, name, {"time_s": time[part], "speed_rad_s": speed[part]}, {"inertia_kg_m2": inertia}, True, 0.5)


def ergometer_strokes(mirrors: Path, out: Path) -> None:
    """From JaapvanEkris/openrowingmonitor (GPL-3.0): flywheels of rowing machines between two pulls.

    Fans in air. Turns after the fastest of a stroke and before the next pull, less two at each end; friction =
    −J dω/dt, the slope of a parabola over five rows. The first strokes count.
    """
    for name, file, strokes in (
        ("erg_rowerg_strokes", "Concept2_RowErg_Session_2000meters", 40),
        ("erg_merach_strokes", "Merach_R50_510m", 35),
        ("erg_rx800_strokes", "RX800", 60),
    ):
        time, speed, inertia = flywheel(mirrors, file)
        falls = np.diff(speed, append=speed[-1]) < 0
        turning = np.flatnonzero(np.diff(np.concatenate([[False], falls, [False]]).astype(int)))
        parts = []
        for first, last in zip(turning[::2] + 2, turning[1::2] - 1, strict=True):
            if last - first > 6:
                rows, rate = slope(time[first:last], speed[first:last], 2)
                parts.append(np.column_stack([time[first + rows], speed[first + rows], -inertia * rate]))
        table = np.vstack(parts[2 : 2 + strokes])
        columns = {"time_s": table[:, 0], "speed_rad_s": table[:, 1], "friction_torque_Nm": table[:, 2]}
        save(out, name, columns, {"inertia_kg_m2": inertia})


def small_motor(mirrors: Path, out: Path) -> None:
    """From jacobkingery/elecanisms_mp1: a small motor with gearhead running down, angle at 4 kHz.

    Speed over blocks of 20 rows (5 ms), from 20 ms to the stop. J is not given: 1e-6 kg m² (scales everything alike).
    """
    rows = git_table(mirrors, "jacobkingery/elecanisms_mp1", "spin_down.csv", delimiter=",", skip_header=1)
    at, angle = rows[::20, 0], np.unwrap(np.radians(rows[:, 1]))[::20]
    time, speed = (at[1:] + at[:-1]) / 2, np.diff(angle) / np.diff(at)
    part = (time > 0.02) & (time < 0.34)
    save(out, "small_motor", {"time_s": time[part], "speed_rad_s": speed[part]}, {"inertia_kg_m2": 1e-6}, True, 10.0)


def dc_motor(mirrors: Path, out: Path) -> None:
    """From Nicholas-Navarrete/DC-Motor-Characterization: a small brushed motor with a slotted disc, current cut off.

    Photodiode behind 18 slots at 4.2 kHz, one row a turn; J = 4.872e-5 kg m² (measured). Two stops of one recording.
    """
    path = "Data/Arduino motor data_20260522_130512_84996pts.csv"
    rows = git_table(mirrors, "Nicholas-Navarrete/DC-Motor-Characterization", path, delimiter=",", skip_header=1)
    high = rows[:, 3] > (rows[:, 3].min() + rows[:, 3].max()) / 2
    edge = np.flatnonzero(high[1:] & ~high[:-1])
    turn = ((rows[edge, 1] + rows[edge + 1, 1]) / 2)[::18]
    time, speed = (turn[1:] + turn[:-1]) / 2, 2 * np.pi / np.diff(turn)
    for name, first, last in (("dc_motor_slow", 4.9, 9.65), ("dc_motor_fast", 14.9, 18.7)):
        part = (time > first) & (time < last)
        wheel = {"inertia_kg_m2": 4.872e-5}
        save(out, name, {"time_s": time[part], "speed_rad_s": speed[part]}, wheel, True, 1.0)


def servo(mirrors: Path, out: Path) -> None:
    """From TeacherRock/LuGre_Friction: a bare servo motor under triangles of torque, 1 kHz.

    Torque command and speed in N m and rad/s as logged, means of 10 rows; J = 1.7592e-4 kg m² (their identification).
    """
    for name, number in (("servo_triangles_1", 1), ("servo_triangles_5", 5), ("servo_triangles_9", 9)):
        rows = git_table(mirrors, "TeacherRock/LuGre_Friction", f"data/LuGre_J_{number}.txt")
        time, speed, torque = means(10, np.arange(len(rows)) * 1e-3, rows[:, 1], rows[:, 4])
        save(
            out,
            name,
            {"time_s": time, "speed_rad_s": speed, "motor_torque_Nm": torque},
            {"inertia_kg_m2": 1.7592e-4},
            dead_band=0.5,
        )


def ur10e(mirrors: Path, out: Path) -> None:
    """From shamilmamedov/dynamic_calibration: one joint of a UR10e at a time through a sine, 100 Hz.

    Joint 1 has a vertical axis, joints 5 and 6 carry next to no weight. Motor torque = current times the torque
    constant behind the gear (UR10E_parameters.txt), less the weight of what is behind joints 3 (-37.34 N m sin q) and
    4 (-3.02 N m cos q); these and the inertias by least squares over the sine.
    """
    for joint, constant, inertia, sine, cosine in (
        (1, 10.0, 5.44, 0.0, 0.0),
        (3, 8.4566, 4.01, -37.34, 0.16),
        (4, 9.0029, 0.24, 0.06, -3.02),
        (5, 9.48, 0.64, 0.0, 0.0),
        (6, 10.1232, 0.477, 0.0, 0.0),
    ):
        path = f"dataset_ur10e/jointwise_motion/ur-20_01_22-joint_{joint}.csv"
        rows = git_table(mirrors, "shamilmamedov/dynamic_calibration", path, delimiter=",")
        time = rows[:, 0] - rows[0, 0]
        keep = (time > 9.0) & (time < 60.0) & np.concatenate([[True], np.diff(time) > 1e-4])
        angle, speed, current = (rows[keep, first + joint] for first in (0, 6, 12))
        torque = constant * current - sine * np.sin(angle) - cosine * np.cos(angle)
        columns = {"time_s": time[keep], "speed_rad_s": speed, "motor_torque_Nm": torque}
        save(out, f"ur10e_joint{joint}", columns, {"inertia_kg_m2": inertia}, dead_band=0.02)


def kinova(mirrors: Path, out: Path) -> None:
    """From HBRS-SDP/joint-friction-model (MIT in its sources): the last joint of a Kinova Gen3 at ten constant speeds.

    One way, 1 kHz. Measured current times 7.6 N m/A (configs/constants.yml), speed from the angle, half a second after
    the start on, means of 250 rows; the speeds in growing order, 5 s between them.
    """
    parts, clock = [], 0.0
    for speed in ("0.03", "0.05", "0.09", "0.10", "0.30", "0.50", "0.70", "0.90", "1.30", "1.50"):
        rows = git_table(mirrors, "HBRS-SDP/joint-friction-model", f"data/velocity_{speed}0000readings.csv")[500:]
        angle = np.unwrap(rows[:, 1])
        time, rate, torque = means(250, np.arange(len(rows)) / 999, np.gradient(angle) * 999, 7.6 * rows[:, 5])
        parts.append(np.column_stack([clock + time, rate, torque]))
        clock += time[-1] + 5.0
    table = np.vstack(parts)
    columns = {"time_s": table[:, 0], "speed_rad_s": table[:, 1], "friction_torque_Nm": table[:, 2]}
    save(out, "kinova_joint7", columns, dead_band=0.005)


def bare_motor(mirrors: Path, out: Path) -> None:
    """From heitor-andrade/laas_anti_cogging (BSD-3-Clause): a bare brushless motor with its driver (ODRI), 1 kHz.

    `cogging_slow`: turned slowly by a speed controller, `_after` without (or with) compensation of the cogging torque;
    `_again` a second recording; `cogging_sine`: a sine of current. Speed from the angle (sine: as logged). Means of 2
    rows, 4 where the angle jumps at the index of the encoder and for the sine. K_T = 0.025 N m/A (the motor's data); J
    by least squares over the sine.
    """
    wheel = {"inertia_kg_m2": 4.86e-6, "torque_constant_Nm_A": 0.025}
    for name, path, first, last, count in (
        ("cogging_slow", "Testing/speed_data/speed_test", 0.5, 7.9, 2),
        ("cogging_slow_after", "Testing/speed_data/speed_test", 8.5, 16.0, 4),
        ("cogging_again", "Testing/speed_data/speed_test1", 0.5, 8.0, 2),
        ("cogging_again_after", "Testing/speed_data/speed_test1", 15.5, 30.0, 4),
        ("cogging_sine", "done/acceleration_data/acc_current", 5.0, 15.0, 4),
    ):
        rows = git_table(mirrors, COGGING, f"codes/{path}.txt", delimiter=",", skip_header=1)
        rows = rows[(rows[:, 0] > first) & (rows[:, 0] < last)]
        sine = name == "cogging_sine"
        time, angle, speed, current = means(count, *rows[:, :3].T, rows[:, 3 if sine else 4])
        speed = speed if sine else np.gradient(angle, time)
        columns = {"time_s": time, "speed_rad_s": speed, "motor_current_A": current}
        save(out, name, columns, wheel, dead_band=2.0 if sine else 0.3)


def tiago(mirrors: Path, out: Path) -> None:
    """From thanhndv212/figaroh-examples: torso lift and first joint of a TIAGo arm (vertical axis), 100 Hz.

    Lift: effort as logged (N), means of 5 rows; it carries the weight of the arm. Arm: current, 13.6 N m/A behind the
    gear (identification.py), inertia by least squares.
    """
    effort, speed = (
        git_table(
            mirrors,
            "thanhndv212/figaroh-examples",
            f"examples/tiago/data/identification/dynamic/tiago_{key}.csv",
            delimiter=",",
            skip_header=1,
        )
        for key in ("effort", "velocity")
    )
    for name, column, first, last, band in (("tiago_lift", 1, 10.0, 66.0, 2e-3), ("tiago_arm1", 2, 8.5, 68.0, 5e-3)):
        keep = (effort[:, 0] > first) & (effort[:, 0] < last)
        time, v, torque = means(5, effort[keep, 0], speed[keep, column], effort[keep, column])
        columns = {"time_s": time, "speed_rad_s": v}
        if column == 1:
            save(out, name, {**columns, "friction_torque_Nm": torque}, dead_band=band)
        else:
            wheel = {"inertia_kg_m2": 7.6, "torque_constant_Nm_A": 13.6}
            save(out, name, {**columns, "motor_current_A": torque}, wheel, dead_band=band)


def propeller(mirrors: Path, out: Path) -> None:
    """From HeinzGerhard/RCBenchmark: a large propeller on a stand (RCbenchmark), swept up, in wind.

    Torque of the cell (sign turned) and optical speed; the torque passes zero where the wind alone turns it. Means of
    8 rows of the two long files (the sweep alone); rows whose speed is 3 % off the median of five are dropped.
    """
    for name, file, count, first, last in (
        ("prop_wind_a", "2021-11-19_165606", 1, 0.0, 100.0),
        ("prop_wind_b", "2021-11-19_170044", 1, 0.0, 100.0),
        ("prop_wind_c", "2021-11-19_170538", 1, 0.0, 100.0),
        ("prop_sweep_a", "2021-06-18_140528", 8, 0.0, 61.0),
        ("prop_sweep_b", "2021-06-18_141700", 8, 10.5, 68.0),
    ):
        rows = git_table(
            mirrors,
            "HeinzGerhard/RCBenchmark",
            f"Polar_{file}.csv",
            delimiter=",",
            skip_header=1,
            usecols=(0, 3, 7),
            invalid_raise=False,
            encoding="utf-8-sig",
        )
        rows = rows[np.isfinite(rows).all(1) & (rows[:, 2] > 500)]
        rows = rows[np.concatenate([[True], np.diff(rows[:, 0]) > 0])]
        rows = rows[(rows[:, 0] >= first) & (rows[:, 0] < last)]
        middle = np.array([np.median(rows[max(k - 2, 0) : k + 3, 2]) for k in range(len(rows))])
        rows = rows[np.abs(rows[:, 2] / middle - 1) < 0.03]
        time, torque, speed = means(count, *rows.T)
        save(out, name, {"time_s": time, "speed_rad_s": speed * np.pi / 30, "friction_torque_Nm": -torque})


ALL = (
    ergometer_stops,
    ergometer_strokes,
    small_motor,
    dc_motor,
    servo,
    ur10e,
    kinova,
    bare_motor,
    tiago,
    propeller,
)

if __name__ == "__main__":
    convert(ALL)
