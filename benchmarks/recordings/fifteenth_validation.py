"""The fifteenth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.fifteenth_validation MIRRORS OUT [NAME …]

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
from scipy.signal import butter, filtfilt, find_peaks, medfilt

from benchmarks.recordings.fifth_validation import amplitudes, loss
from benchmarks.recordings.ninth_validation import RPM
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.third_validation import half_swings
from benchmarks.recordings.validation import convert, means, save


def even(rate: float, time: np.ndarray, *columns: np.ndarray) -> list[np.ndarray]:
    """Return an even time and columns on it, `rate` in Hz; rows whose time does not grow are dropped."""
    good = np.append(True, np.diff(np.maximum.accumulate(time)) > 0.0)
    grid = np.arange(time[good][0], time[good][-1], 1.0 / rate)
    return [grid, *(np.interp(grid, time[good], x[good]) for x in columns)]


def smooth(rate: float, cut: float, x: np.ndarray) -> np.ndarray:
    """Return a column, low-pass filtered at `cut` (Hz) without a lag."""
    return np.asarray(filtfilt(*butter(2, 2.0 * cut / rate), x))


def band_brakes(mirrors: Path, out: Path) -> None:
    """From ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash (CC BY-SA 4.0): a band brake on a drum, with play.

    A hydraulic actuator moves it to and fro in sines; 1024 Hz, displacement (inches to m) and force (kip to N, both
    stand for angle and torque), speed from the displacement, both low-pass filtered at 20 Hz, means of 12 rows (20 for
    the wide one), 0.1 s at both ends left out. In the names: tension of the band in pounds.
    """
    repo = "ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash"
    for name, file, count in (
        ("band_20", "data/dataset-1/characterization datasets/1Hz20lbtension", 12),
        ("band_80", "data/dataset-1/characterization datasets/1Hz80lbtension", 12),
        ("band_30_wide", "data/dataset-3/characterization tests/0.5Hz30lbtension1.5amplitude", 20),
        ("band_0", "data/dataset-2/characterization datasets/1Hz0lbtension1.5amplitude", 12),
    ):
        log = np.array(json.loads(fetch(mirrors, repo, f"{file}.json"))["data"], dtype=float)
        place, force = (smooth(1024.0, 20.0, log[:, k]) for k in (1, 2))
        speed = np.gradient(0.0254 * place, log[:, 0])
        force = 4448.2 * force * np.sign(force @ speed)
        t, v, f = means(count, *(x[102:-102] for x in (log[:, 0], speed, force)))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, name, columns, dead_band=0.02 * float(np.abs(v).max()))


def tow_tank(mirrors: Path, out: Path) -> None:
    """From UNH-CORE/RM2-tow-tank and UNH-CORE/RVAT-Re-dep (both MIT): a test bed for turbines in water, blades off.

    `struts`: the arms of a rotor in water that rests; `struts_towed`: while it is towed at 1 m/s (torque from the power
    coefficient, area 1.075 m × 0.8067 m, density 1000 kg/m³); `round_struts`: the same in round covers. `shaft_2015`,
    `shaft_2014`: the shaft in its seals alone. One mean for each speed, which grows; a minute each. Sign of the torque
    as it opposes the speed (in the first file it is the other one).
    """
    area, radius = 1.075 * 0.8067, 0.5375
    repo = "UNH-CORE/RM2-tow-tank"
    for name, end in (("struts", ""), ("round_struts", "-covers")):
        log = git_table(mirrors, repo, f"Data/Processed/Strut-torque{end}.csv", delimiter=",", skip_header=1)
        rest = (RPM * log[:, 4], -log[:, 3])
        log = git_table(mirrors, repo, f"Data/Processed/Perf-1.0-no-blades{end}.csv", delimiter=",", names=True)
        ratio, power, tow = (np.asarray(log[key], dtype=float) for key in ("mean_tsr", "mean_cp", "mean_tow_speed"))
        towed = (ratio * tow / radius, -power * 500.0 * area * tow**2 * radius / ratio)
        for label, (speed, torque) in ((name, rest), (f"{name}_towed", towed)):
            minutes = 60.0 * np.arange(speed.size)
            save(out, label, {"time_s": minutes, "speed_rad_s": speed, "friction_torque_Nm": torque})
    for name, source, file, sign in (
        ("shaft_2015", repo, "Tare-torque", -1.0),
        ("shaft_2014", "UNH-CORE/RVAT-Re-dep", "Tare torque", 1.0),
    ):
        log = git_table(mirrors, source, f"Data/Processed/{file}.csv", delimiter=",", skip_header=1)
        t = 60.0 * np.arange(len(log))
        save(out, name, {"time_s": t, "speed_rad_s": RPM * log[:, 1], "friction_torque_Nm": sign * log[:, 2]})


def servo_turns(mirrors: Path, out: Path) -> None:
    """From adamb314/ServoProject (CC BY 3.0 US): the motor of a servo turned ten times each way to learn its cogging.

    What the controller gives stands for the torque, 55.6 Hz (as the rows come, the clock of the computer wanders),
    angle (2048 to a turn) low-pass filtered at 2 Hz, means of two rows; the pause between the two directions is left
    out.
    """
    log = git_table(mirrors, "adamb314/ServoProject", "Python/tests/dataFiles/motorCoggingTorque.txt")
    pause = int(np.diff(log[:, 0]).argmax()) + 1
    parts = []
    for part in (slice(0, pause), slice(pause, None)):
        angle = smooth(55.6, 2.0, np.unwrap(log[part, 3] * 2 * np.pi / 2048))
        parts.append(means(2, np.gradient(angle, 1 / 55.6), log[part, 2]))
    v, f = np.concatenate(parts, axis=1)
    t = 2 / 55.6 * np.arange(v.size)
    save(out, "servo_turns", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.1)


def swings(mirrors: Path, out: Path) -> None:
    """From three groups of students (no licence): pendulums swinging freely; friction in terms of m g l or the inertia.

    `steep_thread`, `short_thread` (luyu-wu/Pendulum-Project: a metal bob on a thread, from 87 degrees 0.75 m long, from
    8 degrees 0.46 m; filmed at 60 Hz, angle from both coordinates): half swings as in `third_validation`, each the mean
    of two, and means of two of these; windows of two swings as in `fifth_validation`. `filmed_bob`
    (jagriti-natraj/phy180-lab1, 30 Hz): windows of three swings. `phone_swings`
    (Ganesh999-tech/SINDy-Pendulum-Discovery): a phone on threads, its gyroscope at 100 Hz along the axis that it turns
    about, low-pass filtered at 5 Hz, from 20 s; amplitudes from the speed at each passage of the middle and the period
    of small swings, loss of ω²/2 over the way, means of four half swings.
    """
    log = git_table(mirrors, "luyu-wu/Pendulum-Project", "Code/data2.csv", delimiter=",")
    rows = half_swings(log[:, 0], np.arctan2(log[:, 1], -log[:, 2]), 1.0, 4, 0.03)
    mean = {key: means(2, (np.abs(x[1:]) + np.abs(x[:-1])) / 2)[0] for key, x in rows.items()}
    save(out, "steep_thread", mean)
    log = git_table(mirrors, "luyu-wu/Pendulum-Project", "Code/l4.csv", delimiter=",")
    log = log[np.isfinite(log).all(1)]
    table = amplitudes(log[:, 0], np.arctan2(log[:, 1], -log[:, 2]), 2, 1.37, 0.02)
    save(out, "short_thread", loss(table, 1 - np.cos(table[:, 1])))
    log = git_table(mirrors, "jagriti-natraj/phy180-lab1", "processed_data.txt")
    table = amplitudes(log[:, 0], log[:, 1], 3, 1.644, 0.02)
    save(out, "filmed_bob", loss(table, 1 - np.cos(table[:, 1])))

    text = fetch(mirrors, "Ganesh999-tech/SINDy-Pendulum-Discovery", "Gyroscope.csv").decode().replace('"', "")
    log = np.genfromtxt(io.StringIO(text), delimiter="\t", skip_header=1)
    log = log[(log[:, 0] > 20.0) & (log[:, 0] < 179.0)]
    turning = log[:, 1:] - log[:, 1:].mean(0)
    axis = np.linalg.svd(turning, full_matrices=False)[2][0]
    rate = np.abs(smooth(100.0, 5.0, turning @ axis))
    middles = find_peaks(rate, height=0.15, distance=40)[0]
    middles = middles[(middles > 8) & (middles < rate.size - 8)]
    at, top = np.empty(middles.size), np.empty(middles.size)
    for row, k in enumerate(middles):
        part = slice(k - 8, k + 9)
        c = np.polyfit(log[part, 0] - log[k, 0], rate[part], 2)
        at[row], top[row] = log[k, 0] - c[1] / (2 * c[0]), c[2] - c[1] ** 2 / (4 * c[0])
    own = np.pi / float(np.median(np.diff(at)[-40:]))
    angle = np.arccos(1 - top**2 / (2 * own**2))
    way = angle[1:] + angle[:-1]
    t, v, f = means(4, (at[1:] + at[:-1]) / 2, way / np.diff(at), (top[:-1] ** 2 - top[1:] ** 2) / (2 * way))
    save(out, "phone_swings", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def oil(mirrors: Path, out: Path) -> None:
    """From desdelgado/rheology-data-toolkit (MIT): an oil in a rheometer at 30 to 80 °C.

    Stress (Pa) over the rate of shear from 1 to 100 1/s upwards, ten seconds a row (as measured), with the temperature;
    the curves that are called LO…C (`oil_lo`) and …C (`oil_plain`), colder ones first, 300 s between them. Left out:
    lower rates, where the torque is below 0.4 µN m, and the curve without a temperature.
    """
    file = "tests/test_data/Anton_Paar/gwens_data/Steady State Viscosity Curve-LO30C.csv"
    text = fetch(mirrors, "desdelgado/rheology-data-toolkit", file).decode("utf-16")
    curves: dict[tuple[str, float], np.ndarray] = {}
    for part in text.split("Test:\t")[1:]:
        found = re.match(r"Steady State Viscosity Curve-(LO|)(\d+)C", part)
        lines = [line.split("\t")[2:5] for line in part.splitlines() if re.match(r"\t\d+\t", line)]
        if found:
            curves[found[1], float(found[2])] = np.array(lines, dtype=float)
    for name, kind in (("oil_lo", "LO"), ("oil_plain", "")):
        table, clock = [], 0.0
        for heat in sorted(heat for key, heat in curves if key == kind):
            time, rate, stress = curves[kind, heat].T
            rows = np.column_stack([clock + time, rate, stress, np.full_like(rate, heat)])
            table.append(rows[rate >= 1.0])
            clock += float(time[-1]) + 300.0
        t, rate, stress, heats = np.concatenate(table).T
        columns = {"time_s": t, "speed_rad_s": rate, "friction_torque_Nm": stress, "bearing_temperature_degC": heats}
        save(out, name, columns)


def chopped_motor(mirrors: Path, out: Path) -> None:
    """From SheshadriSB/Robo (no licence): a small motor, its speed over the duty of a slowly chopped voltage (of 255).

    Duty stands for the torque (what the turning motor induces is its viscous part), steps of 2, where it turns.
    `chopped_1kHz`: one sweep and, downwards, another one; `chopped_5kHz`: one sweep, every other row up and the rest
    down again, as it has no times; a row a second.
    """
    files = ("pwm_vs_rpm.csv", "pwm_vs_rpm1.csv")
    slow, quick = (git_table(mirrors, "SheshadriSB/Robo", file, delimiter=",", skip_header=1) for file in files)
    sweeps = [x[(x[:, 0] == rate) & (x[:, 3] > 0.0)] for x, rate in ((slow, 1e3), (quick, 1e3), (quick, 5e3))]
    for name, rows in (
        ("chopped_1kHz", np.concatenate([sweeps[0], sweeps[1][::-1]])),
        ("chopped_5kHz", np.concatenate([sweeps[2][::2], sweeps[2][1::2][::-1]])),
    ):
        t = np.arange(len(rows), dtype=float)
        save(out, name, {"time_s": t, "speed_rad_s": RPM * rows[:, 3], "friction_torque_Nm": rows[:, 1]})


def ramps(
    logs: list[list[list[float]]], at: tuple[int, int], unit: float, cut: float, count: int, lowest: float
) -> dict[str, np.ndarray]:
    """Return the columns of a table of ramps of the voltage, one after the other: friction is volts less J dω/dt.

    Times, and volts and speed at two places of each row, in units of `unit`, made even at 200 Hz, low-pass filtered at
    `cut` Hz, means of `count` rows, three left out at each end; J by least squares beside dry and viscous friction and
    an offset, where the speed is above the lowest.
    """
    clock, parts = 0.0, []
    for rows in logs:
        log = np.array(rows, dtype=float)
        log = log[np.append(True, np.diff(log[:, 0]) > 0.0)]
        time, volts, speed = even(200.0, log[:, 0], log[:, at[0]], unit * log[:, at[1]])
        volts, speed = (smooth(200.0, cut, x) for x in (volts, speed))
        part = means(count, clock + time - time[0], speed, np.gradient(speed, 1 / 200), volts)
        parts.append([x[3:-3] for x in part])
        clock += float(time[-1] - time[0]) + 5.0
    t, v, slope, volts = np.concatenate(parts, axis=1)
    on = np.abs(v) > lowest
    base = np.column_stack([slope, np.sign(v), v, np.ones_like(v)])
    inertia = float(np.linalg.lstsq(base[on], volts[on], rcond=None)[0][0])
    return {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": volts - inertia * slope}


def driven_robots(mirrors: Path, out: Path) -> None:
    """From three teams of robots (no licence): voltage in slow ramps, one way, then the other, by one logger, 200 Hz.

    Volts stand for the torque (what the turning motor induces is its viscous part). `robot_a`
    (MiamiBeachBots/base-bot, left side), `robot_b` (YCSRobotics/frc-66-2022-rapidreact, left): on the ground, wheels of
    0.4878 and 0.47 m; `bare_ramps` (calcmogul/SysIdOpt, in radians); `shooter_ramps` (YCSRobotics, the wheel of a ball
    shooter up to 11 V, thousands of its units a second). Low-pass filtered at 5 Hz, the shooter at 4 Hz; friction =
    volts − J dω/dt, J in V s²/rad by least squares beside dry and viscous friction and an offset; means of 10 rows (20
    of the shooter), the first and last three of each ramp left out.
    """
    turn, miami = 2 * np.pi, "MiamiBeachBots/base-bot"
    wildcats, slow = "YCSRobotics/frc-66-2022-rapidreact", ("slow-forward", "slow-backward")
    both = ("slow-backward", "fast-forward")
    for name, repo, file, runs, speed_in, cut, count, lowest in (
        ("robot_a", miami, "sysid_data", slow, (5, turn / 0.4878), 5.0, 10, 2.0),
        ("robot_b", wildcats, "sysid_data20220305-122725", slow, (5, turn / 0.47), 5.0, 10, 2.0),
        ("bare_ramps", "calcmogul/SysIdOpt", "sysid_data", slow, (3, 1.0), 5.0, 10, 1.0),
        ("shooter_ramps", wildcats, "sysid_data20220405-214854", both, (3, 1e-3), 4.0, 20, 3.0),
    ):
        logs = json.loads(fetch(mirrors, repo, f"{file}.json"))
        columns = ramps([logs[run] for run in runs], (1, speed_in[0]), speed_in[1], cut, count, lowest)
        save(out, name, columns, dead_band=lowest)


def arm_joints(mirrors: Path, out: Path) -> None:
    """From tompatobbe/ViperX-300 (no licence): first and fourth joint of a small arm on paths that excite all six.

    100 Hz, the servo's current times 2.409 N m/A, angle from its encoder, five rows out of nine that jump removed by a
    median, both low-pass filtered at 3 Hz. Friction = torque − J dω/dt, for the roll of the forearm − weight over sine
    and cosine of its angle − an offset, all by least squares beside dry and viscous friction; means of ten rows.
    """
    text = fetch(mirrors, "tompatobbe/ViperX-300", "data/sysid_run1.csv").decode()
    log = np.genfromtxt(io.StringIO(text), delimiter=",", names=True)
    for name, joint in (("arm_waist", "waist"), ("arm_roll", "forearm_roll")):
        place, effort = (medfilt(log[f"{joint}_{key}"], 9) for key in ("pos", "effort"))
        time, place, effort = even(100.0, log["time"], place, effort)
        angle, torque = smooth(100.0, 3.0, place), smooth(100.0, 3.0, 2.409e-3 * effort)
        speed = np.gradient(angle, 0.01)
        t, v, slope, angle, torque = means(10, time, speed, np.gradient(speed, 0.01), angle, torque)
        terms = [slope] if name == "arm_waist" else [slope, np.sin(angle), np.cos(angle), np.ones_like(angle)]
        on = np.abs(v) > 0.05
        base = np.column_stack([*terms, np.sign(v), v])
        fit = np.linalg.lstsq(base[on], torque[on], rcond=None)[0]
        friction = torque - np.column_stack(terms) @ fit[: len(terms)]
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": friction, "motor_torque_Nm": torque}
        wheel = {"inertia_kg_m2": float(f"{fit[0]:.4g}")}
        save(out, name, {key: x[3:-3] for key, x in columns.items()}, wheel, dead_band=0.05)


def stick_motor(mirrors: Path, out: Path) -> None:
    """From KuriosityRobotics/center-stage (BSD): a geared motor that a stick drives forth and back.

    130 Hz, its current (A, with the sign of the command) stands for the torque, speed in steps of 0.22 rad/s, both
    low-pass filtered at 5 Hz. Friction = current − J dω/dt, J by least squares beside dry and viscous friction and an
    offset, where it is driven; means of six rows.
    """
    file = "data/motor_data_voltage_12.66.csv"
    log = git_table(mirrors, "KuriosityRobotics/center-stage", file, delimiter=",", skip_header=1, skip_footer=1)
    time, speed, current, command = even(125.0, log[:, 0], *log[:, [1, 3, 4]].T)
    speed, current = smooth(125.0, 5.0, speed), smooth(125.0, 5.0, current * np.sign(command))
    slope = np.gradient(speed, 1 / 125)
    base = np.column_stack([slope, np.sign(speed), speed, np.ones_like(speed)])
    on = (np.abs(speed) > 1.0) & (np.abs(command) > 0.02)
    inertia = float(np.linalg.lstsq(base[on], current[on], rcond=None)[0][0])
    t, v, f, motor = means(6, time, speed, current - inertia * slope, current)
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "motor_torque_Nm": motor}
    save(out, "stick_motor", columns, {"inertia_kg_m2": float(f"{inertia:.4g}")}, dead_band=1.0)


def scratches(mirrors: Path, out: Path) -> None:
    """From okilitive/CETR-tribometer (MIT): a pin on an alloy under 2 N, strokes to and fro at 4 mm/s, dry.

    Load cell in grams (to N), 50 Hz; the first 20 pairs of strokes (`scratch_early`) and the 41st to 60th, the speed is
    what was set (m/s); means of three rows, the first and what comes after 1.5 s, where it rests, left out.
    """
    for name, first in (("scratch_early", 1), ("scratch_late", 41)):
        clock, parts = 0.0, []
        for number in range(first, first + 20):
            file = f"data/HT-2n-6-4 2_{number:03d}.csv"
            text = fetch(mirrors, "okilitive/CETR-tribometer", file).decode("latin1")
            for sign, half in zip((-1.0, 1.0), text.split("Step No.")[1:], strict=True):
                rows = [line.split(",") for line in half.splitlines() if re.match(r"-?\d+\.\d+,", line)]
                f, t = means(3, *np.array(rows, dtype=float)[:, [0, 8]].T)
                on = (t > 0.03) & (t < 1.5)
                parts.append(np.array([clock + t, np.full(t.size, sign * 4e-3), 9.81e-3 * f])[:, on])
                clock += 2.4
        t, v, f = np.concatenate(parts, axis=1)
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=1e-3)


ALL = (
    *(band_brakes, tow_tank, servo_turns, swings, oil, chopped_motor, driven_robots, arm_joints, stick_motor),
    scratches,
)

if __name__ == "__main__":
    convert(ALL)
