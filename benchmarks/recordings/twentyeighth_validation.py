"""The twenty-eighth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.twentyeighth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import smooth
from benchmarks.recordings.ninth_validation import sheet
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.twentyseventh_validation import without
from benchmarks.recordings.validation import convert, git_list, means, save


def servo_triangles(mirrors: Path, out: Path) -> None:
    """From TeacherRock/Lorenz_Friction (no licence): a servo motor with a mass under triangles of its speed.

    1 kHz for 8 s, speed (rad/s, in steps of 0.06) and torque that its controller asks for (N m), both low-pass filtered
    at 8 Hz, friction = torque − J dω/dt, J by least squares beside dry and viscous friction, means of 20 rows where it
    turns. `lorenz`, `lorenz_later`: to 60 rad/s and back, the first and the last of ten; `lorenz_slower`: to 40 rad/s,
    on an earlier day; `lorenz_helped`: what the feedback asks for where the inertia's torque is fed forward.
    """
    for name, path in (
        ("lorenz", "data/Lorenz_Jm_1"),
        ("lorenz_later", "data/Lorenz_Jm_10"),
        ("lorenz_slower", "Lorenz_id/Lorenz_id/data/data_1"),
        ("lorenz_helped", "data/Lorenz_Bm_1"),
    ):
        log = git_table(mirrors, "TeacherRock/Lorenz_Friction", f"{path}.txt")[:8000]
        v, drive = (smooth(1000.0, 8.0, log[:, k]) for k in (1, 4))
        time = np.arange(v.size) / 1000
        t, v, f, gain = means(20, *(x[100:-100] for x in (time, v, drive, np.gradient(v, 1e-3))))
        base = np.column_stack([np.sign(v), v, np.ones_like(v)])
        f = without(f, gain[:, None], base, np.abs(v) > 1.0)
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.5)


def humanoid_arm(mirrors: Path, out: Path) -> None:
    """From saloutos/system_identification (no licence): joints of a robot arm with low gears, all moved at once.

    Some 300 Hz for 25 s, angles, speeds and torques (from the currents) of six joints, as their Savitzky-Golay filter
    leaves them; made even, low-pass filtered at 8 Hz, means of 4 rows; friction = torque − what the accelerations of
    all joints, the sines and cosines of all angles and of the sum of this one and the one before it take + what it is
    at rest, by least squares beside dry and viscous friction, where it is faster than 0.15 rad/s. `limb_wrist`: its
    fifth, which moves for some 4 s.
    """
    path = "data/example_arm_logs/armlog2_processed_data.mat"
    data = io.BytesIO(fetch(mirrors, "saloutos/system_identification", path))
    log = loadmat(data, squeeze_me=True)  # type: ignore[arg-type]
    clock = np.asarray(log["t"], dtype=float)
    grid = np.arange(clock[0], clock[-1], 1 / 300)
    angles, speeds, torques = (
        np.array(
            [
                smooth(300.0, 8.0, np.interp(grid, clock, column))
                for column in np.array([np.asarray(row, dtype=float) for row in log[key]]).T
            ]
        )
        for key in ("q", "qd", "tau")
    )
    slopes = np.gradient(speeds, 1 / 300, axis=1)
    joint = 4
    sums = [*angles, angles[joint] + angles[joint - 1]]
    t, angle, v, f, *base = means(
        4,
        *(
            x[30:-30]
            for x in (
                *(grid, angles[joint], speeds[joint], torques[joint]),
                *slopes,
                *(wave(x) for x in sums for wave in (np.sin, np.cos)),
            )
        ),
    )
    columns = np.column_stack([*base, np.ones_like(v)])
    f = without(f, columns, np.column_stack([np.sign(v), v]), np.abs(v) > 0.15)
    kept = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": angle - angle.mean()}
    save(out, "limb_wrist", kept, dead_band=0.15)


def duty_motor(mirrors: Path, out: Path) -> None:
    """From tutla53/dc-motor (Apache 2.0): a small geared motor over its duty, in some hundred steps from rest.

    1 kHz, speed (turns a minute) and duty (thousands of its counts, stands for the torque, what it induces is its
    viscous part), from backward over rest to forward. `ladder`: of each step that turns it and lies below full duty,
    from 0.5 s behind its start on, means of 0.1 s. `spins`: every eighth of these steps from its start to 0.8 s behind
    it, low-pass filtered at 12 Hz, friction = duty − J dω/dt, J by least squares beside dry and viscous friction, means
    of 10 rows where it turns.
    """
    repo, folder = "tutla53/dc-motor", "assets/01_System_Identification/open-loop-responses"
    steady, spins = [], []
    for place, path in enumerate(git_list(str(mirrors / f"{repo.replace('/', '+')}.git"), f"{folder}/")):
        log = git_table(mirrors, repo, path, delimiter=",", skip_header=1)
        time, v, duty = log[:, 0] / 1e3 + 2.5 * place, np.pi / 30 * log[:, 1], log[1000, 2] / 1e3
        first = int(np.argmax(log[:, 2] != log[0, 2]))
        if not 0.95 < abs(duty) < 4.5:
            continue
        steady.append([*means(100, *(x[first + 500 : first + 1400] for x in (time, v))), np.full(9, duty)])
        if place % 8 == 0:
            slow = smooth(1000.0, 12.0, v)
            rows = means(10, *(x[first : first + 800] for x in (time, slow, np.gradient(slow, 1e-3))))
            spins.append([*rows, np.full(80, duty)])
    t, v, f = np.concatenate(steady, axis=1)
    save(out, "ladder", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, period=0.1)
    t, v, gain, f = np.concatenate(spins, axis=1)
    on = np.abs(v) > 5.0
    f = without(f, gain[:, None], np.column_stack([np.sign(v), v]), on)
    save(out, "spins", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}, period=0.01)


def voltage_motor(mirrors: Path, out: Path) -> None:
    """From pboon09/FRA233_LAB_19_31_37_77 (no licence): a small motor under a voltage that a course prescribes.

    1 kHz for 30 s, volts (stand for the torque, what it induces is its viscous part) and speed (rad/s, in steps of
    0.77), which lie one behind the other in the files (volts as doubles, speeds as singles); low-pass filtered at 10
    Hz, friction = volts − J dω/dt, J by least squares beside dry and viscous friction, means of 20 rows where it turns.
    Sines and triangles of 12 V and a chirp of sines, the bridge at 100 kHz and (`…_1k`) at 1 kHz.
    """
    for name, path in (
        ("volts_sine", "Sine/100000"),
        ("volts_sine_1k", "Sine/1000"),
        ("volts_triangle", "Triangle/100000"),
        ("volts_triangle_1k", "Triangle/1000"),
        ("volts_chirp", "Chirp/100000"),
    ):
        data = fetch(mirrors, "pboon09/FRA233_LAB_19_31_37_77", f"{path}.mat")
        volts = np.frombuffer(data, "<f8", 30001, 8 * 1866)
        v, drive = (smooth(1000.0, 10.0, x) for x in (np.frombuffer(data, "<f4", 30001, 4 * 69268), volts))
        time = np.arange(v.size) / 1000
        t, v, f, gain = means(20, *(x[100:-100] for x in (time, v, drive, np.gradient(v, 1e-3))))
        on = np.abs(v) > 5.0
        f = without(f, gain[:, None], np.column_stack([np.sign(v), v, np.ones_like(v)]), on)
        near = np.convolve(on, np.ones(5), "same") > 0
        t, v, f = (x[near] for x in (t, v, f))
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=5.0)


def bench_steps(mirrors: Path, out: Path) -> None:
    """From guanlunlu/motor_system_identification (no licence): a motor after steps of its voltage to 6, 12 and 24 V.

    10 ms, speed; three runs of 5 s one after the other, from 0.1 s behind each step on, when it turns, 1 s put between
    them; low-pass filtered at 5 Hz, friction = volts − J dω/dt, J by least squares beside dry and viscous friction,
    means of 4 rows. `steps`: the first run at each voltage, `steps_again`: the last.
    """
    for name, files in (
        ("steps", ("6v_step/1st_6V", "12v_step/1st_12V", "24v_step/1st_24V")),
        ("steps_again", ("6v_step/3st_6V", "12v_step/3rd_12V", "24v_step/3rd_24V")),
    ):
        parts = []
        for place, (file, volts) in enumerate(zip(files, (6.0, 12.0, 24.0), strict=True)):
            repo = "guanlunlu/motor_system_identification"
            log = git_table(mirrors, repo, f"{file}_noLoadStep_10ms.csv", delimiter=",")
            log = log[int(np.flatnonzero(log[:, 1] > 1.0)[0]) :]
            v = smooth(100.0, 5.0, log[:, 1])
            columns = (log[:, 0] + 6.0 * place, v, np.full(v.size, volts), np.gradient(v, 0.01))
            parts.append(np.array(means(4, *(x[10:-5] for x in columns))))
        t, v, f, gain = np.concatenate(parts, axis=1)
        f = without(f, gain[:, None], np.column_stack([np.ones_like(v), v]), np.ones(v.size, dtype=bool))
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def arm_with_propeller(mirrors: Path, out: Path) -> None:
    """From helonayala/sysid (public domain): an arm on a level axis that a propeller at its end lifts, in closed loop.

    100 Hz, angle (degrees) and command (per cent), 20 to 88 s; angle and the square of the command low-pass filtered at
    3 Hz, J = 1, means of 4 rows; friction = k times the command's square, behind it by what leaves least, − dω/dt −
    what the sine and the cosine of the angle take, all by least squares beside dry and viscous friction, where it is
    faster than 0.1 rad/s. `lifted_sine`: a sine that grows faster, `lifted_mixed`: many sines.
    """
    for name, file in (("lifted_sine", "sinal3_swept_sine"), ("lifted_mixed", "sinal4_multiseno")):
        path = f"data/quarter_drone/{file}_malha_fechada.csv"
        log = git_table(mirrors, "helonayala/sysid", path, delimiter=",", skip_header=1)
        angle = smooth(100.0, 3.0, np.radians(log[:, 2]))
        v = np.gradient(angle, 0.01)
        gain, thrust = np.gradient(v, 0.01), smooth(100.0, 3.0, (log[:, 3] / 100) ** 2)
        best = (np.inf, np.empty((0, 0)))
        for late in range(40):
            pushed = np.roll(thrust, late)
            rows = means(4, *(x[2000:8800] for x in (log[:, 0], angle, v, gain, pushed)))
            terms = np.column_stack(
                [rows[4], np.sin(rows[1]), np.cos(rows[1]), np.ones_like(rows[2]), np.sign(rows[2]), rows[2]]
            )
            fast = np.abs(rows[2]) > 0.1
            left = np.linalg.lstsq(terms[fast], rows[3][fast], rcond=None)[1]
            if left[0] < best[0]:
                best = (float(left[0]), np.array(rows))
        t, turned, v, gain, pushed = best[1]
        base = np.column_stack([pushed, np.sin(turned), np.cos(turned), np.ones_like(v)])
        f = without(-gain, base, np.column_stack([np.sign(v), v]), np.abs(v) > 0.1)
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned.mean()}
        save(out, name, columns, dead_band=0.1)


def bobs(mirrors: Path, out: Path) -> None:
    """From Togohogo1-Archive/phy180-pendulum-report (no licence): bobs on threads, filmed at 30 Hz.

    Amplitudes (rad, means of both sides) some 20 to 40 s apart; friction = loss of 1 − cos a over the way between two
    of them, in terms of m g l, speed = way over time. `bob_4`, `bob_7`, `bob_9`: ever longer threads.
    """
    for name, number, period in (("bob_4", 5, 1.00667), ("bob_7", 8, 1.27333), ("bob_9", 10, 1.40667)):
        data = fetch(mirrors, "Togohogo1-Archive/phy180-pendulum-report", "plotting/raw_retake.xlsx")
        t, a = sheet(data, number, "M N").T
        way = 2.0 * (a[1:] + a[:-1]) * np.diff(t) / period
        columns = {"speed_rad_s": way / np.diff(t), "friction_torque_Nm": (np.cos(a[1:]) - np.cos(a[:-1])) / way}
        save(out, name, {"time_s": (t[1:] + t[:-1]) / 2, **columns})


ALL = (servo_triangles, humanoid_arm, duty_motor, voltage_motor, bench_steps, arm_with_propeller, bobs)

if __name__ == "__main__":
    convert(ALL)
