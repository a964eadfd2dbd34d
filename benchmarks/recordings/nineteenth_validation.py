"""The nineteenth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.nineteenth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import ramps, smooth
from benchmarks.recordings.ninth_validation import RPM
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.validation import convert, means, save


def magnetic_damper(mirrors: Path, out: Path) -> None:
    """From labcontrol-data/mr-damper (MIT): a damper whose fluid thickens in a magnet's field, on a shaking table.

    100 Hz, to and fro about once a second, strokes of 12 to 22 mm: place (mm, to m), force of the cell (N), both
    low-pass filtered at 15 Hz; speed from the place, means of two rows, one second left out at both ends. How strong
    the field is the repository does not say; by the force it grows from one series to the next: `damper_faint` (file
    4.1), `damper_low` (4.2), `damper_middle`, `damper_middle_short` (B.3, B.7), `damper_high` (A.2).
    """
    names = {"faint": "4.1", "low": "4.2", "middle": ".B.3", "middle_short": ".B.7", "high": ".A.2"}
    for name, number in names.items():
        data = io.BytesIO(fetch(mirrors, "labcontrol-data/mr-damper", f"data/ensaio{number}.mat"))
        log = loadmat(data, simplify_cells=True)  # type: ignore[arg-type]
        place, force = smooth(100.0, 15.0, 1e-3 * log["dist"]), smooth(100.0, 15.0, log["forc"].astype(float))
        t, v, f = (x[50:-50] for x in means(2, log["Tout"], np.gradient(place, 0.01), force))
        save(out, f"damper_{name}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=1e-3)


def propellers(mirrors: Path, out: Path) -> None:
    """From jmajew/thrust_tool (GPL-3): a motor with a propeller on a stand, a command after the other, five times.

    Rows without times, here 0.1 s apart: torque (g cm, its median at rest taken off), speed (rpm) from 1000 on; medians
    of ten rows from 20 after a new command. `prop_broad`: 10 x 4.5 at 16 V; `prop_carbon_12`, `prop_carbon_16`: a
    carbon one, 10 x 3.3, at 12 and 16 V.
    """
    for name, file in (
        ("broad", "4s/grp01__mt2212_10x4-5_4s"),
        ("carbon_12", "3s/grp01__mt2212_falcon10x3-3_3s"),
        ("carbon_16", "4s/grp01__mt2212_falcon10x3-3_4s"),
    ):
        text = fetch(mirrors, "jmajew/thrust_tool", f"ThrustApp/data/tmotor-mt2212/{file}.txt").decode()
        lines = (line.split() for line in text.splitlines() if re.match(r"\s*-?\d", line))
        log = np.array([line for line in lines if len(line) == 6], dtype=float)
        rest = float(np.median(log[log[:, 3] == 0.0, 2]))
        ends = np.append(np.flatnonzero(np.diff(log[:, 0]) != 0.0) + 1, len(log))
        starts = zip(np.append(0, ends[:-1]), ends, strict=True)
        at = np.concatenate([np.arange(first + 20, last - 9, 10) for first, last in starts])
        v, f = (np.array([np.median(log[k : k + 10, column]) for k in at]) for column in (3, 2))
        t, v, f = (x[v > 1000.0] for x in (0.1 * (at + 4.5), v, f))
        columns = {"time_s": t, "speed_rad_s": RPM * v, "friction_torque_Nm": 9.81e-5 * (f - rest)}
        save(out, f"prop_{name}", columns)


def traction(mirrors: Path, out: Path) -> None:
    """From moritzploss/tribology (MIT): a ball that rolls and slides on a disc in oil at 120 °C under 50 N, two hours.

    PCS MTM, a row a second, rolling and sliding at 0.2 m/s, pauses of 15 s every five minutes to look at the ball:
    traction coefficient as the friction, means of ten rows. `traction_early`: the first seven stretches after the oil
    has become warm, `traction_late`: the last ten.
    """
    text = fetch(mirrors, "moritzploss/tribology", "examples/process_slim_mapper/demo-mtm-output.txt").decode("latin1")
    stretches = []
    for number, part in enumerate(re.split(r"\nStep \d+ started", text)[1:]):
        cells = (line.split("\t") for line in part.splitlines())
        rows = [[float(row[k]) for k in (0, 25, 1)] for row in cells if len(row) > 25 and row[0].isdigit()]
        if rows:
            t, v, f = means(10, *np.array(rows).T)
            stretches.append(np.array([166.0 * number + t, 1e-3 * v, f]))
    for name, some in (("early", stretches[1:8]), ("late", stretches[-10:])):
        t, v, f = np.concatenate(some, axis=1)
        save(out, f"traction_{name}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def running_down(mirrors: Path, out: Path) -> None:
    """From two teams of students with haptic knobs (no licence): small motors run down.

    J is not given: 1e-6 kg m² (scales everything alike). `knob_stop_1` to `knob_stop_5` (redfern314/elecanisms): times
    of half turns in steps of 0.2 ms (as its plot has them), each from five before they have become a tenth longer to
    the last; glitches below 4 ms left out. `motor_down_a`, `motor_down_b` (ppfenninger/elecanisms2018, document and
    document2): angle of 14 bits and a clock of 16 µs, about 1.4 ms apart; speed over 30 rows without a pause of more
    than 3 ms, from the third after the fastest to 15 rad/s.
    """
    wheel = {"inertia_kg_m2": 1e-6}
    log = git_table(mirrors, "redfern314/elecanisms", "dataprocess/spindownraw.csv", delimiter=",")
    for number, part in enumerate(np.split(log, np.flatnonzero(log > 1000.0))[1:], 1):
        half = 2e-4 * part[(part > 20.0) & (part < 1000.0)]
        wide = np.convolve(half, np.ones(5) / 5, "same")[20:-2]
        first = int(np.flatnonzero(wide > 1.1 * np.median(half[30:60]))[0]) + 15
        columns = {"time_s": (np.cumsum(half) - half / 2)[first:], "speed_rad_s": (np.pi / half)[first:]}
        save(out, f"knob_stop_{number}", columns, wheel, True, 5.0)
    for name, file, last in (("a", "document", None), ("b", "document2", 9905)):
        log = git_table(mirrors, "ppfenninger/elecanisms2018", f"callibration/{file}.csv", delimiter=",")
        log = log[log[:, 1] > 0.0][:last]
        time = 16e-6 * log[:, 1]
        first = int(np.flatnonzero(np.diff(time) > 1.0)[-1]) + 1
        time, turned = time[first:], np.unwrap(log[first:, 0], period=16384.0) * 2 * np.pi / 16384.0
        longest = np.maximum.reduceat(np.diff(time), np.arange(0, time.size - 1, 30))
        time, turned = time[::30], turned[::30]
        at, speed = (time[1:] + time[:-1]) / 2, np.abs(np.diff(turned) / np.diff(time))
        good = np.flatnonzero(longest[: at.size] < 3e-3)
        at, speed = at[good], speed[good]
        first = int(speed.argmax()) + 3
        stop = first + int(np.flatnonzero(np.append(speed[first:], 0.0) < 15.0)[0])
        columns = {"time_s": at[first:stop], "speed_rad_s": speed[first:stop]}
        save(out, f"motor_down_{name}", columns, wheel, True, 15.0)


def driven_robots(mirrors: Path, out: Path) -> None:
    """From three teams of robots (no licence): voltage in slow ramps, one way, then the other, by one logger, 200 Hz.

    As in `fifteenth_validation`: volts stand for the torque (what the turning motor induces is its viscous part), units
    as the logs have them, low-pass filtered at 5 Hz; friction = volts − J dω/dt, J by least squares beside dry and
    viscous friction and an offset; means of 20 rows, the first and last three of each ramp left out. `ball_shooter`
    (Denham-Venom/Sigma-Bot-2022): the wheel of a ball shooter; `spinning_a`, `spinning_b` (teamelite48/2022-robot,
    right): on the spot; `robot_h_left`, `robot_h_right` (Frc2481/frc-2023): straight on.
    """
    elite, crows = "teamelite48/2022-robot", ("Frc2481/frc-2023", "Test 1/sysid_data20230207-215953.json")
    shooter = "sysid/Shooter_sysid_data20220309-185248.json"
    for name, repo, file, volt, speed_at, lowest in (
        ("ball_shooter", "Denham-Venom/Sigma-Bot-2022", shooter, 1, 3, 3.0),
        ("spinning_a", elite, "sysid/drivetrain/angular1.json", 2, 6, 0.4),
        ("spinning_b", elite, "sysid/drivetrain/angular2.json", 2, 6, 0.4),
        ("robot_h_left", *crows, 1, 5, 0.5),
        ("robot_h_right", *crows, 2, 6, 0.5),
    ):
        logs = json.loads(fetch(mirrors, repo, file))
        columns = ramps(
            [logs[run] for run in ("slow-forward", "slow-backward")], (volt, speed_at), 1.0, 5.0, 20, lowest
        )
        save(out, name, columns, dead_band=lowest)


def wrist(mirrors: Path, out: Path) -> None:
    """From lbr-stack/dynamic_parameter_identification (MIT): the last joint of a KUKA LBR Med along a sum of sines.

    All joints move; angle and torque of the joint's sensor at 100 Hz (its script), 16 s, low-pass filtered at 3 Hz; the
    sign is turned so that friction opposes the motion. Inertia and weight, of which the last joint carries little, are
    left in; means of ten rows from 3.5 s on, when it has begun to move, to half a second before the end.
    """
    path = "src/test/measurements.csv"
    log = git_table(mirrors, "lbr-stack/dynamic_parameter_identification", path, delimiter=",", skip_header=1)
    angle, torque = smooth(100.0, 3.0, log[:, 6]), smooth(100.0, 3.0, -log[:, 13])
    t, v, f, turned = (x[35:-5] for x in means(10, 0.01 * np.arange(len(log)), np.gradient(angle, 0.01), torque, angle))
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned}
    save(out, "iiwa_wrist", columns, dead_band=0.02)


ALL = (magnetic_damper, propellers, traction, running_down, driven_robots, wrist)

if __name__ == "__main__":
    convert(ALL)
