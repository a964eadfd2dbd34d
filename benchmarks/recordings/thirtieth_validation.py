"""The thirtieth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.thirtieth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import ramps, smooth
from benchmarks.recordings.ninth_validation import sheet
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.twentieth_validation import less_inertia
from benchmarks.recordings.twentyseventh_validation import without
from benchmarks.recordings.validation import convert, means, save


def rack_and_pinion(mirrors: Path, out: Path) -> None:
    """From KonradMnich/friction-identification (no licence): a rack that a servo motor drives, with a load cell.

    0.68 s: force at 2 kHz (200 N/V, its zero the first ten rows), speed of the motor at 1.5 kHz (turns a minute, 20 mm
    a turn), the force 4 ms later (conditioning.m); both low-pass filtered at 30 Hz, friction = force − 24.7 kg dv/dt
    (extraction.m), means of 3 rows where it moves.
    """
    repo = "KonradMnich/friction-identification"
    motor = git_table(mirrors, repo, "input/a3MR.csv", delimiter=",", skip_header=5, usecols=(0, 1))
    cell = git_table(mirrors, repo, "input/a3NI.csv", delimiter=",", skip_header=4, usecols=(0, 1))
    time, v = motor[:, 0] / 1e3, -motor[:, 1] * 0.02 / 60
    force = np.interp(time, cell[:, 0] + 0.004, -200.0 * (cell[:, 1] - cell[:10, 1].mean()))
    rate = 1 / float(np.median(np.diff(time)))
    v, force = smooth(rate, 30.0, v), smooth(rate, 30.0, force)
    t, v, f = means(3, time, v, force - 24.7 * np.gradient(v, 1 / rate))
    on = np.abs(v) > 0.01
    save(out, "rack_stroke", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}, dead_band=0.01)


def diving_robot(mirrors: Path, out: Path) -> None:
    """From michoy/system_identification (MIT): a robot with eight thrusters in a pool.

    10 Hz, forces (N) and torque (N m) of its thrusters from their pulses, speeds along and about its axes from cameras,
    low-pass filtered at 0.5 Hz; friction = force − what its acceleration takes, by least squares beside dry, viscous
    and quadratic friction and an offset, which stays in it; means of 5 rows above a tenth of the fastest. `dive`: up
    and down for 263 s; `dive_mixed`, `swim_on`, `swim_aside`, `swim_turn`: all at once for 300 s, down, ahead, aside
    and about.
    """
    for name, file, force, speed in (
        ("dive", "heave", "force_z", "heave_vel"),
        ("dive_mixed", "random", "force_z", "heave_vel"),
        ("swim_on", "random", "force_x", "surge_vel"),
        ("swim_aside", "random", "force_y", "sway_vel"),
        ("swim_turn", "random", "torque_z", "yaw_vel"),
    ):
        data = fetch(mirrors, "michoy/system_identification", f"data/preprocessed/{file}-1.csv")
        heads = data.decode().splitlines()[0].split(",")
        log = np.genfromtxt(io.BytesIO(data), delimiter=",", skip_header=1)
        time, v, f = (log[:, heads.index(key)] for key in ("Time", speed, force))
        v, f = smooth(10.0, 0.5, v), smooth(10.0, 0.5, f)
        others = np.column_stack([np.sign(v), v, v * np.abs(v), np.ones_like(v)])
        on = np.abs(v) > 0.1 * float(np.quantile(np.abs(v), 0.99))
        f = without(f, np.gradient(v, 0.1)[:, None], others, on)
        t, v, f = means(5, *(x[10:-10] for x in (time, v, f)))
        on = np.abs(v) > 0.1 * float(np.quantile(np.abs(v), 0.99))
        columns = {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}
        save(out, name, columns, dead_band=float(np.abs(v[on]).min()), period=0.5)


def crane(mirrors: Path, out: Path) -> None:
    """From emilah-png/Bachelor (no licence): the cylinders of a hydraulic crane that lift its boom and its jib.

    100 Hz for 27 to 62 s, pressures on both sides of a cylinder (bar; behind the valve for the rod's side of the
    boom's), length and speed (m, m/s), low-pass filtered at 4 Hz, means of 5 rows where it is faster than a tenth of
    the fastest; friction (bar of the piston's side) = its pressure − what the other pressure, the acceleration and a
    cubic of the length, for the load, take, by least squares beside dry and viscous friction. `jib`, `boom`: on courses
    by a controller, `jib_valve`, `boom_valve`: under steps of the valve.
    """
    for name, file, sides, moved in (
        ("jib", "JibSTDTest2_270325", ("JibPaCyl", "JibPbCyl"), ("JibPistonPosition", "JibVelocity")),
        ("jib_valve", "JibValveResponseTime_010425", ("JibPaCyl", "JibPbCyl"), ("JibPistonPosition", "JibVelocity")),
        ("boom", "MainSTDTest1_270325", ("MainPaCyl", "MainPbDCV"), ("MainPistonPosition", "MainPistonVelocity")),
        (
            "boom_valve",
            "MainValveResponseTime_010425",
            ("MainPaCyl", "MainPbDCV"),
            ("MainPistonPosition", "MainPistonVelocity"),
        ),
    ):
        lines = fetch(mirrors, "emilah-png/Bachelor", f"Datalogs/Validerings data/{file}.csv").decode().splitlines()
        first = next(k for k, line in enumerate(lines) if line.startswith("Name,MainPaDCV"))
        heads = lines[first].split(",")
        rows = [line.split(",")[: len(heads)] for line in lines[first + 2 :] if line[:1].isdigit()]
        log = np.array(rows, dtype=float)
        push, pull, place, v = (smooth(100.0, 4.0, log[:, heads.index(key)]) for key in (*sides, *moved))
        time = log[:, 0] / 1e3
        columns = (x[50:-50] for x in (time, push, pull, place, v, np.gradient(v, 0.01)))
        t, push, pull, place, v, slope = means(5, *columns)
        on = np.abs(v) > 0.1 * float(np.abs(v).max())
        load = [(place - place.mean()) ** power for power in range(4)]
        f = without(push, np.column_stack([pull, slope, *load]), np.column_stack([np.sign(v), v]), on)
        columns_on = {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}
        save(out, name, columns_on, dead_band=float(np.abs(v[on]).min()), period=0.05)


def master_arm(mirrors: Path, out: Path) -> None:
    """From wangyanhit/mtm_dynamics_identification (no licence): the master arm of a surgical robot (dVRK), all moved.

    25 s at 200 Hz, angle, speed and torque (in units of its own) of three joints, low-pass filtered at 10 Hz;
    friction = torque − what the accelerations of all and the sines and cosines of all angles and of their sums with the
    one before take + what it is at rest, by least squares beside dry and viscous friction; means of 2 rows. `master_…`:
    its outer yaw, shoulder and elbow, `_again`: another run of the same course.
    """
    names = ("outer_yaw", "shoulder_pitch", "elbow_pitch")
    for name, run, joint in (
        ("master_yaw", "50s-1", 0),
        ("master_yaw_again", "50s-2", 0),
        ("master_shoulder", "50s-1", 1),
        ("master_elbow", "50s-1", 2),
    ):
        logs = []
        for one in names:
            path = f"data/experiment_data/{run}/{one}_joint_states.csv"
            log = git_table(mirrors, "wangyanhit/mtm_dynamics_identification", path, delimiter=",")
            logs.append([smooth(200.0, 10.0, x) for x in log.T])
        angles, speeds = (np.array([log[k] for log in logs]) for k in (0, 1))
        v, f = speeds[joint], logs[joint][2]
        sums = [*angles, angles[1] + angles[2], angles[1] - angles[2]]
        waves = [wave(x) for x in sums for wave in (np.sin, np.cos)]
        base = np.column_stack([*np.gradient(speeds, 0.005, axis=1), *waves, np.ones_like(v)])
        f = without(f, base, np.column_stack([np.sign(v), v]), np.abs(v) > 0.1)
        time = np.arange(v.size) / 200
        t, angle, v, f = means(2, *(x[50:-50] for x in (time, angles[joint], v, f)))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": angle - angle.mean()}
        save(out, name, columns, dead_band=0.1)


def driven_mass(mirrors: Path, out: Path) -> None:
    """From johnstonbrendan/MTE360_Project_1 (no licence): the mass that a motor drives of a course at Waterloo.

    100 Hz for 4 s, another team than in the twenty-ninth set: ±1.5 V and speed (mm/s to m/s), low-pass filtered at 8
    Hz, friction = volts − J dv/dt, J by least squares beside dry and viscous friction and an offset, where it is faster
    than 20 mm/s.
    """
    data = io.BytesIO(fetch(mirrors, "johnstonbrendan/MTE360_Project_1", "DataSet/velocity_response_2_1.mat"))
    scope = loadmat(data)  # type: ignore[arg-type]
    log = np.asarray(scope["velocity_response_4_1_data"], dtype=float)
    v, f = less_inertia(100.0, log[:, 1], log[:, 2] / 1e3, 8.0, 0.02)
    kept = slice(10, -10)
    columns = {"time_s": log[kept, 0], "speed_rad_s": v[kept], "friction_torque_Nm": f[kept]}
    save(out, "mass_square", columns, dead_band=0.02)


def robots_on_ramps(mirrors: Path, out: Path) -> None:
    """From two teams of robots (BSD 3-Clause): robots on the ground under a voltage in slow ramps, 200 Hz.

    As in `fifteenth_validation`, left side: volts stand for the torque, speed low-pass filtered at 5 Hz, J by least
    squares beside dry and viscous friction and an offset, means of 10 rows. `robot`, `robot_later`: frc2881/2022-Robot
    on two days (turns/s); `windsor`, `windsor_later`: Lynzzyr/2023-BishopOrchestra, twice on a day (speed in
    units of its own).
    """
    first, second = "frc2881/2022-Robot", "Lynzzyr/2023-BishopOrchestra"
    for name, repo, file, unit in (
        ("robot", first, "sysid_data20220130-130644", 2 * np.pi),
        ("robot_later", first, "sysid_data20220227-150426", 2 * np.pi),
        ("windsor", second, "characterization/sysid_data20230211-110538_windsorarm", 1e5),
        ("windsor_later", second, "characterization/sysid_data20230211-153951_windsorarm", 1e5),
    ):
        logs = json.loads(fetch(mirrors, repo, f"{file}.json"))
        runs = [logs[run] for run in ("slow-forward", "slow-backward")]
        save(out, name, ramps(runs, (1, 5), unit, 5.0, 10, 2.0), dead_band=2.0)


def blood(mirrors: Path, out: Path) -> None:
    """From BloodRheology/t-ESSTV_ParallelTempering (Apache 2.0): blood in a rheometer, its rate of shear in steps.

    Three steps from 5, 10 and 20 1/s to 0.1, then three from 0.1 to 5, 10 and 20, 300 s between two; some 45 rows
    behind each from 0.1 s, when the rate is reached, to a minute or so; rate of shear (1/s, stands for the speed) and
    stress (Pa).
    """
    data = fetch(mirrors, "BloodRheology/t-ESSTV_ParallelTempering", "ParTemp_tESSTV/DATA/Steps.xlsx")
    logs = [sheet(data, number, "A B D") for number in range(1, 7)]
    kept = [log[log[:, 0] > 0.1] + np.array([300.0 * k, 0.0, 0.0]) for k, log in enumerate(logs)]
    t, f, v = np.concatenate(kept).T
    save(out, "blood_steps", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


ALL = (rack_and_pinion, diving_robot, crane, master_arm, driven_mass, robots_on_ramps, blood)

if __name__ == "__main__":
    convert(ALL)
