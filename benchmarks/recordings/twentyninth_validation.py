"""The twenty-ninth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.twentyninth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import io
from itertools import groupby
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import smooth
from benchmarks.recordings.ninth_validation import sheet
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.twentyseventh_validation import without
from benchmarks.recordings.validation import convert, means, save


def liquids(mirrors: Path, out: Path) -> None:
    """From imewei/rheojax (MIT): liquids in rotational rheometers, stress or torque over the rate of shear.

    Ethyl cellulose in a solvent, its speed (turns a minute to rad/s) and torque (micronewton metres) over 43 rates from
    slow to fast, the share of it in the names (per cent); a thixotropic gel (Wei and others, J. Rheol. 2018), rate of
    shear (1/s, stands for the speed) and stress (Pa): `gel_stress`, steps of the stress, and `gel_rate`, steps of the
    rate, each up and down, and `gel_steps`, seven steps of the rate, each from the one that the last one went to, 55
    rows each from 0.1 to 295 s behind it. The times of rows are not known where each is a steady state: 10 s stand for
    them; 300 s between two steps.
    """
    repo, folder = "imewei/rheojax", "examples/data"
    for share in ("10", "05"):
        path = f"{folder}/flow/solutions/ec_shear_viscosity_{share}-00.csv"
        text = fetch(mirrors, repo, path).decode("latin-1").replace(",", ".")
        log = np.genfromtxt(io.StringIO(text), delimiter=";", skip_header=2)
        columns = {"speed_rad_s": np.pi / 30 * log[:, 3], "friction_torque_Nm": log[:, 4] / 1e6}
        save(out, f"cellulose_{share}", {"time_s": 10.0 * np.arange(len(log)), **columns})
    data = fetch(mirrors, repo, f"{folder}/ikh/ML-IKH Experimental data.xlsx")
    for name, up, down in (("gel_stress", "A B", "C D"), ("gel_rate", "F G", "H I")):
        log = np.concatenate([sheet(data, 1, up), sheet(data, 1, down)])
        columns = {"speed_rad_s": log[:, 0], "friction_torque_Nm": log[:, 1]}
        save(out, name, {"time_s": 10.0 * np.arange(len(log)), **columns})
    parts = []
    letters = ("M N", "C D", "K L", "E F", "A B", "G H", "I J")
    for place, (pair, rate) in enumerate(zip(letters, (5, 9, 7, 5, 7, 9, 5), strict=True)):
        log = sheet(data, 7, pair)[-55:]
        parts.append([log[:, 0] + 300.0 * place, np.full(55, float(rate)), log[:, 1]])
    t, v, f = np.concatenate(parts, axis=1)
    save(out, "gel_steps", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def cones(mirrors: Path, out: Path) -> None:
    """From AC-Formulations-SDL5/Automated_Viscometry (no licence): a cone that turns in a liquid and comes down.

    A machine lowers the cone of a viscometer towards a plate by 0.02 mm at a time, and at each height turns it at 4 to
    10 speeds, one after the other, 15 to 35 s each; torque in per cent of its greatest, the last reading of each. Times
    are the sums of the times at each. `cone_peg`, `cone_peg_again`: a polymer in water (PEG 300K, 5 %), at 4 and at 10
    speeds; `cone_carbopol` and `cone_sepineo`: gels (0.3 and 2 %).
    """
    for name, file, cell, row in (
        ("cone_peg", "PEG", "5%300K_577", 13),
        ("cone_peg_again", "PEG", "5%300K_577", 17),
        ("cone_carbopol", "carbopol", "980carb0.3%_49810", 1),
        ("cone_sepineo", "sepineo", "2%sep_50110", 7),
    ):
        path = f"results/auto_runs/All readings/{file}.csv"
        text = fetch(mirrors, "AC-Formulations-SDL5/Automated_Viscometry", path).decode("latin-1")
        lines = [line.split(",") for line in text.splitlines()[1:]]
        runs = [list(run) for _, run in groupby(lines, key=lambda line: line[:3])]
        stays = [list(stay)[-1] for _, stay in groupby(runs[row - 1], key=lambda line: line[3:5])]
        log = np.array([line[3:7] for line in stays if line[2] == cell and "SKIPPED" not in line], dtype=float)
        columns = {"speed_rad_s": np.pi / 30 * log[:, 1], "friction_torque_Nm": log[:, 3]}
        save(out, name, {"time_s": np.cumsum(log[:, 2]), **columns})


def bar_on_motor(mirrors: Path, out: Path) -> None:
    """From eliferin14/Gravity-compensation (GPL 3.0): a small geared motor that swings a bar, by its duty.

    100 Hz for 10 s, angle and duty (stands for the torque, what it induces is its viscous part), both low-pass filtered
    at 6 Hz, friction = duty − what dω/dt and the sine and the cosine of the angle take, by least squares beside dry and
    viscous friction and an offset, where it is faster than 0.5 rad/s; means of 2 rows. `bar_sine`, `bar_mixed`: as the
    duty is.
    """
    for name, number in (("bar_sine", 2), ("bar_mixed", 3)):
        path = f"System_identification/data{number}.mat"
        data = io.BytesIO(fetch(mirrors, "eliferin14/Gravity-compensation", path))
        log = loadmat(data, squeeze_me=True)  # type: ignore[arg-type]
        turn = smooth(100.0, 6.0, np.asarray(log["y"], dtype=float))
        drive = smooth(100.0, 6.0, np.asarray(log["u"], dtype=float))
        v = np.gradient(turn, 0.01)
        time = np.arange(v.size) / 100
        kept = slice(20, -20)
        t, angle, v, f, gain = means(2, *(x[kept] for x in (time, turn, v, drive, np.gradient(v, 0.01))))
        base = np.column_stack([gain, np.sin(angle), np.cos(angle)])
        f = without(f, base, np.column_stack([np.sign(v), v, np.ones_like(v)]), np.abs(v) > 0.5)
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": angle - angle.mean()}
        save(out, name, columns, dead_band=0.5)


def light_robot(mirrors: Path, out: Path) -> None:
    """From halpersim/parameter_identification (no licence): joints of a robot (KUKA LBR iiwa), all moved at once.

    27 s at 25 Hz, angles as planned and torques as measured (means of ten runs, not filtered); friction = torque − what
    the accelerations of all, the sines and cosines of all angles and of its sum with and difference from the one before
    take + what it is at rest, by least squares beside dry and viscous friction, where it is faster than 0.1 rad/s.
    Rows above 0.01 rad/s. `light_1`, `light_5`, `light_6`, `light_7`: its base and its wrist.
    """
    repo, folder = "halpersim/parameter_identification", "parameter_identification/csv"
    log = git_table(mirrors, repo, f"{folder}/traj_27.csv", delimiter=",", skip_header=1)[:675]
    angles = log[:, 1:].T
    speeds = np.gradient(angles, 0.04, axis=1)
    gains = np.gradient(speeds, 0.04, axis=1)
    for joint in (0, 4, 5, 6):
        path = f"{folder}/traj_27_{joint + 1}.csv"
        f = git_table(mirrors, repo, path, delimiter=",", skip_header=1)[:675, 1]
        v = speeds[joint]
        sums = [*angles, angles[joint] + angles[joint - 1], angles[joint] - angles[joint - 1]]
        base = np.column_stack([*gains, *(wave(x) for x in sums for wave in (np.sin, np.cos)), np.ones_like(v)])
        f = without(f, base, np.column_stack([np.sign(v), v]), np.abs(v) > 0.1)
        kept = (np.abs(v) > 0.01) & (np.abs(np.arange(v.size) - 337) < 323)
        columns = {"time_s": log[kept, 0], "speed_rad_s": v[kept], "friction_torque_Nm": f[kept]}
        angle = angles[joint][kept]
        save(out, f"light_{joint + 1}", {**columns, "angle_rad": angle - angle.mean()}, dead_band=0.1)


def carriages(mirrors: Path, out: Path) -> None:
    """From ParthSareen/controls-projects, ahmadkama/MTE360Proj3 (no licence): the drive of a course at Waterloo.

    1 kHz for 4 or 8 s, voltage (stands for the force, what it induces is its viscous part) and speed (mm/s to m/s, in
    steps of 4.7 mm/s) of the mass that a motor drives and, but in the first, of one on a spring behind it; low-pass
    filtered at 8 Hz, means of 10 rows, friction = volts − what both accelerations take, by least squares beside dry and
    viscous friction and an offset, where it is faster than 8 mm/s. `carriage_square`: ±1.5 V, one mass;
    `carriages_square`, `carriages_half`, `carriages_one`: ±1.5 V and sines of 2.5 V and 0.5 and 1 Hz, two masses;
    `others_square`, `others_one`: ±2 V and 1 Hz, another team.
    """
    first, second = "ParthSareen/controls-projects", "ahmadkama/MTE360Proj3"
    for name, repo, path in (
        ("carriage_square", first, "Project1_360/2_1_velocity_response"),
        ("carriages_square", first, "Project3/Lab3 360 Data/velocity_response_1_5"),
        ("carriages_half", first, "Project3/Lab3 360 Data/velocity_response_sine_0_5"),
        ("carriages_one", first, "Project3/Lab3 360 Data/velocity_response_sine_1"),
        ("others_square", second, "velocity_response_amp_20"),
        ("others_one", second, "velocity_response_freq_10"),
    ):
        data = io.BytesIO(fetch(mirrors, repo, f"{path}.mat"))
        log = loadmat(data, squeeze_me=True)  # type: ignore[arg-type]
        masses = [np.asarray(log[key], dtype=float) / 1e3 for key in ("v", "v1", "v2") if key in log]
        moved = [smooth(1000.0, 8.0, x) for x in masses]
        drive = smooth(1000.0, 8.0, np.asarray(log["u"], dtype=float))
        time = np.arange(drive.size) / 1000
        slopes = [np.gradient(x, 1e-3) for x in moved]
        t, v, f, *gains = means(10, *(x[150:-150] for x in (time, moved[0], drive, *slopes)))
        others = np.column_stack([np.sign(v), v, np.ones_like(v)])
        f = without(f, np.column_stack(gains), others, np.abs(v) > 0.008)
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.008)


def field_damper(mirrors: Path, out: Path) -> None:
    """From Abhay3757/PSO-Optimized-Dual-Attention-LSTM-for-MR-Damper-Force-Prediction (no licence): a damper of Dyke's.

    A magnetorheological damper (NEES-2012-1158) moved at random, its field switched on and off at random; 3004.8 Hz,
    displacement and speed (cm to m) and force (N), low-pass filtered at 60 Hz, means of 12 rows; friction = force −
    k displacement (its gas), by least squares beside dry and viscous friction and an offset, which stays in it.
    `damper_on` and `damper_off`: rows more than 20 ms behind a switch (2.2 V and none), faster than 5 mm/s;
    `damper_on_other`, `damper_off_other`: displacements of a simulated building, larger.
    """
    repo = "Abhay3757/PSO-Optimized-Dual-Attention-LSTM-for-MR-Damper-Force-Prediction"
    for end, file in (("", "ranran_50_converted"), ("_other", "ransim_u_converted")):
        log = git_table(mirrors, repo, f"Dataset/{file}.csv", delimiter=",", skip_header=1, usecols=(2, 3, 5, 6))[
            :60000
        ]
        time = np.arange(len(log)) / 3004.8
        way, v, force = (smooth(3004.8, 60.0, log[:, k] * scale) for k, scale in ((0, 0.01), (2, 0.01), (3, 1.0)))
        for state, held in (("on", log[:, 1] > 2.1), ("off", log[:, 1] < 0.15)):
            settled = np.convolve(held, np.ones(61))[: held.size] > 60.5
            t, x, speed, f, share = means(12, time, way, v, force, settled.astype(float))
            rows = (share > 0.99) & (np.abs(speed) > 0.005)
            t, x, speed, f = (column[rows] for column in (t, x, speed, f))
            others = np.column_stack([np.sign(speed), speed, np.ones_like(speed)])
            f = without(f, x[:, None], others, np.ones(t.size, dtype=bool))
            columns = {"time_s": t, "speed_rad_s": speed, "friction_torque_Nm": f}
            save(out, f"damper_{state}{end}", columns, dead_band=0.005, period=12 / 3004.8)


ALL = (liquids, cones, bar_on_motor, light_robot, carriages, field_damper)

if __name__ == "__main__":
    convert(ALL)
