"""The twenty-seventh set of public recordings to friction tables, judged by physics and least squares before a search.

    python -m benchmarks.recordings.twentyseventh_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.recordings.fifteenth_validation import smooth
from benchmarks.recordings.ninth_validation import sheet
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.twentysixth_validation import matrix
from benchmarks.recordings.validation import convert, means, save, slope


def without(friction: np.ndarray, base: np.ndarray, others: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return friction without what the columns of `base` explain, by least squares beside `others` in some rows."""
    fit = np.linalg.lstsq(np.column_stack([base, others])[rows], friction[rows], rcond=None)[0]
    return np.asarray(friction - base @ fit[: base.shape[1]])


def motorcycle(mirrors: Path, out: Path) -> None:
    """From Licence-to-Fab/dino (no licence): the motor of an electric motorcycle that drives the drum of a dynamometer.

    50 Hz, speed (turns a minute) and torque (N m) that its controller tells from the currents, up and down as a hand
    asks, with a small braking torque where it is off; both low-pass filtered at 1 Hz, friction = torque − J dω/dt, J
    (with that of the drum) by least squares beside dry and viscous friction, means of 5 rows above 5 rad/s.
    """
    for name, file in (("motorcycle", "195616"), ("motorcycle_next", "195728")):
        path = f"battery_runs/Archive/miguel_dc/maybe_real_data/log_141023_{file}.csv"
        lines = fetch(mirrors, "Licence-to-Fab/dino", path).decode().splitlines()
        heads, count = lines[0].split(","), lines[0].count(",")
        log = np.genfromtxt([line for line in lines[1:] if line.count(",") == count], delimiter=",")
        turns, torque = (next(k for k, head in enumerate(heads) if what in head) for what in ("Velocity RPM", "actual"))
        grid = np.arange(log[0, turns - 1], log[-1, turns - 1], 0.02)
        v, drive = (smooth(50.0, 1.0, np.interp(grid, log[:, k - 1], log[:, k])) for k in (turns, torque))
        v *= np.pi / 30
        t, v, f, gain = means(5, *(x[25:-25] for x in (grid, v, drive, np.gradient(v, 0.02))))
        on = v > 5.0
        f = without(f, gain[:, None], np.column_stack([np.ones_like(v), v]), on)
        save(out, name, {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]})


def exoskeleton(mirrors: Path, out: Path) -> None:
    """From JinJiaC-job/My_exeleton_dynamic_calibration_optimized (no licence): axes of an exoskeleton on one path.

    20 Hz for 20 s, angles, speeds and torques of six axes, all low-pass filtered at 2 Hz; friction = torque − what
    the accelerations of all and the sines and cosines of its angle and of its sums with one and two before it take +
    what it is at rest, by least squares beside dry and viscous friction, where it is faster than 0.05 rad/s. `exo_3`
    to `exo_6`: its last four axes.
    """
    repo, path = "JinJiaC-job/My_exeleton_dynamic_calibration_optimized", "dynamics/data/mat/excit_filtering"
    angles, speeds, torques = (
        np.array([smooth(20.0, 2.0, column) for column in matrix(mirrors, repo, path, key).T])
        for key in ("q_raw", "qd_raw", "m_raw")
    )
    time = np.arange(angles.shape[1]) / 20
    slopes = [np.gradient(x, 0.05) for x in speeds]
    for axis in (3, 4, 5, 6):
        sums = [angles[axis - 1], angles[axis - 2] + angles[axis - 1], angles[axis - 3 : axis].sum(axis=0)]
        v = speeds[axis - 1]
        waves = [wave(x) for x in sums for wave in (np.sin, np.cos)]
        base = np.column_stack([*slopes, *waves, np.ones_like(v)])
        f = without(torques[axis - 1], base, np.column_stack([np.sign(v), v]), np.abs(v) > 0.05)
        kept = slice(5, -5)
        angle = angles[axis - 1][kept]
        columns = {"time_s": time[kept], "speed_rad_s": v[kept], "friction_torque_Nm": f[kept]}
        save(out, f"exo_{axis}", {**columns, "angle_rad": angle - angle.mean()}, dead_band=0.05)


def haptic_device(mirrors: Path, out: Path) -> None:
    """From agiammarino96/PHRI-Project (no licence): a haptic paddle that a hand moves by its force sensor, motor off.

    1 kHz (2 kHz the last), speed (degrees/s) and force at 65 mm, low-pass filtered at 10 Hz; the speed is behind the
    force by 35 ms (where least squares leave least, alike in all), which is taken out; friction = torque − J dω/dt, J
    by least squares beside dry and viscous friction and an offset, means of 10 ms, a dead band of 0.3 rad/s.
    """
    folder = "src/MatLab"
    for name, run, force, rate in (
        ("paddle_free", "Low admittance experiments/First exp low admittance I=0.5 f=1000 K=0 B=0", "Fmeas", 1000),
        (
            "paddle_free_b",
            "Transparency Experiments/Fourth Experiment Transp Planes GOOD I=0.000003 f=1000",
            "FMeas",
            1000,
        ),
        (
            "paddle_free_c",
            "Transparency Experiments/Fifth Experiment Transp Planes GOOD I=0.000001 f=2000",
            "FMeas",
            2000,
        ),
    ):
        v, f = (
            smooth(
                rate,
                10.0,
                sheet(fetch(mirrors, "agiammarino96/PHRI-Project", f"{folder}/{run}/{key}.xlsx"), 1, "A")[:, 0],
            )
            for key in ("Vmeas", force)
        )
        late = 35 * rate // 1000
        v, f = np.radians(v)[late:], -0.065 * f[:-late]
        time = np.arange(v.size) / rate
        kept = slice(rate // 10, -rate // 10)
        t, v, f, gain = means(rate // 100, *(x[kept] for x in (time, v, f, np.gradient(v, 1 / rate))))
        f = without(f, gain[:, None], np.column_stack([np.sign(v), v, np.ones_like(v)]), np.abs(v) > 0.3)
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.3)


def pushed_robot(mirrors: Path, out: Path) -> None:
    """From AlbericDeLajarte/panda_control (no licence): the first joint of a robot arm (Franka), pushed by a torque.

    About 350 Hz, angle and the torque that is asked for, which rises and falls within three seconds; made even,
    low-pass filtered at 8 Hz, means of 5 rows where it is faster than 0.01 rad/s; friction = torque − J dω/dt, J as
    logged.
    """
    log = git_table(mirrors, "AlbericDeLajarte/panda_control", "data_friction.txt")
    grid = np.arange(0.2, 4.8, 1 / 350)
    angle, torque, inertia = (np.interp(grid, log[0], log[k]) for k in (1, 15, 29))
    v = np.gradient(smooth(350.0, 8.0, angle), 1 / 350)
    f = smooth(350.0, 8.0, torque) - inertia * np.gradient(v, 1 / 350)
    t, v, f = means(5, *(x[np.abs(v) > 0.01] for x in (grid, v, f)))
    save(out, "pushed_robot", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def brachiators(mirrors: Path, out: Path) -> None:
    """From dfki-ric-underactuated-lab/acromonk and …/ricmonk (BSD 3-clause): robots that swing from bar to bar.

    Some 320 and 150 Hz, angle and speed of the arm that holds the bar; angle, speed and measured torque of a motor: the
    elbow of the first robot (two controllers), the shoulder of the body that hangs on the arm (`tail…`) and of the
    other arm (`grip…`) of the second, forward and backward; all made even and low-pass filtered at 6 Hz, rows between
    a grip and the next; friction = torque − what its own acceleration, that of the arm alone and with the cosine of
    the angle, the square of the arm's speed with its sine, and the sines of both angles and of their sum take + what
    it is at rest, by least squares beside dry and viscous friction, where it is faster than 0.2 rad/s; means of 10 ms.
    """
    for repo, name, file, rate, motor, state in (
        ("acromonk", "elbow_pd", "real_system/csvs/BF_pd_5x", 300, 6, 19),
        ("acromonk", "elbow_lqr", "real_system/csvs/BF_tvlqr_5x", 300, 6, 19),
        ("ricmonk", "tail_forward", "multipleBrachiation_tvlqr/TVLQR_6xForward/measured", 200, 6, 39),
        ("ricmonk", "tail_backward", "multipleBrachiation_tvlqr/TVLQR_6xBackward/measured", 200, 6, 39),
        ("ricmonk", "grip_forward", "multipleBrachiation_tvlqr/TVLQR_6xForward/measured", 200, 14, 39),
        ("ricmonk", "grip_backward", "multipleBrachiation_tvlqr/TVLQR_6xBackward/measured", 200, 14, 39),
    ):
        path = f"results/{file}.csv"
        log = git_table(mirrors, f"dfki-ric-underactuated-lab/{repo}", path, delimiter=",", skip_header=1)
        grid = np.arange(log[0, 0], log[-1, 0], 1 / rate)
        hold, spin, angle, v, f = (
            smooth(rate, 6.0, np.interp(grid, log[:, 0], log[:, k])) for k in (2, 4, motor, motor + 2, motor + 4)
        )
        gain, swing = np.gradient(v, 1 / rate), np.gradient(spin, 1 / rate)
        base = np.column_stack(
            [
                *(gain, swing, np.cos(angle) * swing, np.sin(angle) * spin**2),
                *(np.sin(hold), np.sin(angle), np.sin(hold + angle), np.ones_like(v)),
            ]
        )
        free = np.interp(grid, log[:, 0], log[:, state]) == 1.0
        f = without(f, base, np.column_stack([np.sign(v), v]), free & (np.abs(v) > 0.2))
        t, v, f, turned = means(rate // 100, *(x[free] for x in (grid, v, f, angle)))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned.mean()}
        save(out, name, columns, dead_band=0.2)


def spun_wheel(mirrors: Path, out: Path) -> None:
    """From jrsniderusafa/Reaction-Wheel-Code (no licence): a reaction wheel that its drive spins up.

    Every 4 ms, speed (turns a minute, from the time between two marks, ± a tenth) and current (some 3 A), its first
    run to 2500 turns a minute in 4.9 s; means of 25 rows, torque constant 1; friction = current − J dω/dt, J by least
    squares beside viscous friction, slopes of parabolas over 9 of those rows.
    """
    log = git_table(mirrors, "jrsniderusafa/Reaction-Wheel-Code", "velocity.csv", delimiter=",", skip_header=1)
    log = log[: int(np.flatnonzero(np.diff(log[:, 2]) < 0.0)[0]) + 1]
    time, v, current = means(25, log[:, 2] / 1e3, np.pi / 30 * log[:, 0], log[:, 1] / 1e3)
    rows, slopes = slope(time, v, 4)
    f = without(current[rows], slopes[:, None], v[rows][:, None], np.ones(rows.size, dtype=bool))
    save(out, "spun_wheel", {"time_s": time[rows], "speed_rad_s": v[rows], "friction_torque_Nm": f})


ALL = (motorcycle, exoskeleton, haptic_device, pushed_robot, brachiators, spun_wheel)

if __name__ == "__main__":
    convert(ALL)
