"""Public recordings to friction tables, for validation.

    python -m benchmarks.recordings.validation NAME GITDIR OUT

NAME is one of the functions below, GITDIR the git directory of its repository (bare or .git), OUT a folder.
Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes positive
speed. numpy and scipy only.
"""

from __future__ import annotations

import csv
import io
import subprocess
import sys
from collections.abc import Callable, Iterable
from datetime import datetime
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, filtfilt, find_peaks


def git_show(source: str, path: str, revision: str = "HEAD") -> bytes:
    """Return the bytes of a file of a repository, at its head where no revision is given."""
    return subprocess.run(["git", "-C", source, "show", f"{revision}:{path}"], check=True, capture_output=True).stdout


def git_list(source: str, under: str) -> list[str]:
    """Return the paths below a folder at the head of a repository."""
    out = subprocess.run(
        ["git", "-C", source, "ls-tree", "-r", "--name-only", "-z", "HEAD", under], check=True, capture_output=True
    )
    return [name for name in out.stdout.decode().split("\0") if name]


def save(
    out: Path,
    name: str,
    columns: dict[str, np.ndarray],
    wheel: dict[str, float] | None = None,
    motor_off: bool = False,
    dead_band: float | None = None,
    period: float | None = None,
) -> None:
    """Write a table and its wheel file; the sample period [s] is the median step of the time where none is given."""
    out.mkdir(parents=True, exist_ok=True)
    columns = {**columns, "time_s": columns["time_s"] - columns["time_s"][0]}
    table = np.column_stack(list(columns.values()))
    np.savetxt(out / f"{name}.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    period = period or float(np.median(np.diff(columns["time_s"])))
    text = f'[wheel]\nname = "{name}"\nsample_period_s = {period:.6g}\n'
    text += "".join(f"{key} = {value!r}\n" for key, value in (wheel or {}).items())
    if motor_off:
        text += "\n[friction]\nmotor_off = true\n"
    if dead_band is not None:
        text += f"\n[window]\nsamples = {len(table)}\nhop = {len(table)}\ndead_band_rad_s = {dead_band}\n"
    (out / f"{name}.toml").write_text(text)
    print(f"{name}: {len(table)} rows")


def convert(recordings: Iterable[Callable[[Path, Path], None]]) -> None:
    """Run conversions as the command line asks for: MIRRORS OUT, and names of functions, all where none is given."""
    mirrors, out, *names = sys.argv[1:]
    for one in recordings:
        if not names or one.__name__ in names:
            one(Path(mirrors), Path(out))


def slope(time: np.ndarray, value: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray]:
    """Slope of a parabola through 2·half + 1 rows, and the rows that have one."""
    rows = np.arange(half, value.size - half)
    return rows, np.array(
        [np.polyfit(time[k - half : k + half + 1] - time[k], value[k - half : k + half + 1], 2)[1] for k in rows]
    )


def means(count: int, *columns: np.ndarray) -> list[np.ndarray]:
    """Return the means of each `count` rows; what is left at the end is dropped."""
    rows = columns[0].size // count
    return [c[: rows * count].reshape(rows, count).mean(1) for c in columns]


def wheel_aero(source: str, out: Path) -> None:
    """From pgrady3/dev.

    Vehicle wheel running down, 8 ticks a turn, times in ms; one row a turn, so that spacing of the ticks cancels. J
    = 0.021 kg m².
    """
    inertia = 0.021
    for file in ("data04cover", "data05cover", "data13cover", "data07noCover", "data08noCover"):
        tick = np.genfromtxt(io.BytesIO(git_show(source, f"Telemetry Data/WheelAeroSpindown/{file}.txt"))) / 1e3
        speed = 2 * np.pi / (tick[8:] - tick[:-8])
        first = int(speed.argmax()) + 24  # three turns after the fastest
        turn = tick[first::8]
        time, speed = (turn[1:] + turn[:-1]) / 2, 2 * np.pi / np.diff(turn)
        keep = speed > 3.0
        time, speed = time[keep], speed[keep]
        rows, rate = slope(time, speed, 4)
        save(
            out,
            f"wheel_{file}",
            {"time_s": time[rows], "speed_rad_s": speed[rows], "friction_torque_Nm": -inertia * rate},
            {"inertia_kg_m2": inertia},
        )
        save(
            out,
            f"wheel_{file}_motor_off",
            {"time_s": time, "speed_rad_s": speed},
            {"inertia_kg_m2": inertia},
            motor_off=True,
        )


def freewheel(source: str, out: Path) -> None:
    """From pgrady3/dev.

    Driven wheel with its hub motor engaged or disengaged; m/s at 10 Hz (column 4, × 7/8) over a radius of 0.2375 m;
    means of ten rows. J = 0.0533.
    """
    inertia = 0.0533
    for file in ("engaged", "disengaged"):
        table = np.genfromtxt(
            io.BytesIO(git_show(source, f"Telemetry Data/WheelAeroSpindown/FreewheelSpindown/{file}.txt"))
        )
        speed, time = table[:, 3] * 7 / 8 / 0.2375, table[:, 9] / 1e3
        first = int(np.convolve(speed, np.ones(10) / 10, "same").argmax()) + 30
        last = first + int(np.flatnonzero(speed[first:] < 2.5)[0])
        time, speed = means(10, time[first:last], speed[first:last])
        save(
            out,
            f"freewheel_{file}",
            {
                "time_s": time[1:-1],
                "speed_rad_s": speed[1:-1],
                "friction_torque_Nm": -inertia * np.gradient(speed, time)[1:-1],
            },
            {"inertia_kg_m2": inertia},
        )
        save(
            out,
            f"freewheel_{file}_motor_off",
            {"time_s": time, "speed_rad_s": speed},
            {"inertia_kg_m2": inertia},
            motor_off=True,
        )


def centrifuge(source: str, out: Path) -> None:
    """From jesusgilru-prog/learning-the-lab-not-the-law.

    Arm of a geotechnical centrifuge running down at 3 and 10 kPa, about 1 Hz, read from a published figure. J =
    845.69.
    """
    table = np.genfromtxt(io.BytesIO(git_show(source, "data/liu_fig6_spindown.csv")), delimiter=",", skip_header=1)
    for pressure in (3, 10):
        part = table[table[:, 0] == pressure]
        part = part[np.argsort(part[:, 1])]
        part = part[(part[:, 2] > 0.03) & np.concatenate([[True], np.diff(part[:, 1]) > 0.3])]
        save(
            out,
            f"centrifuge_{pressure}kPa_motor_off",
            {"time_s": part[:, 1], "speed_rad_s": part[:, 2]},
            {"inertia_kg_m2": 845.69},
            motor_off=True,
        )


def propeller(source: str, out: Path) -> None:
    """From bhabas/sar_simulation.

    Small brushless motors with propellers on a thrust stand (RCbenchmark): torque of the load cell, optical speed.
    """
    base = "sar_projects/System_Identification/"
    for name, file, cut, tare in (
        ("propeller_ladder_a", "Motor_SO_V5/Logs/StepsTestV2_2024-02-06_103903.csv", None, True),
        ("propeller_ladder_b", "Motor_SO_V5/Logs/StepsTestV2_2024-02-06_104540.csv", None, True),
        ("propeller_micro_ladder", "Motor_Impulse_Micro/Logs/StepsTest_Collated.csv", None, True),
        ("propeller_micro_ladder_untared", "Motor_Impulse_Micro/Logs/StepsTest_Collated.csv", None, False),
        ("propeller_steps", "Motor_SO_V5/Logs/TimeConstant_Test_2023-12-16_130840.csv", 60.0, False),
    ):
        lines = [
            row
            for row in csv.reader(io.StringIO(git_show(source, base + file).decode("utf-8-sig")))
            if row and not row[0].startswith("#")
        ]
        head = lines[0]

        def column(start: str, head: list[str] = head, lines: list[list[str]] = lines) -> np.ndarray:
            at = next(k for k, text in enumerate(head) if text.startswith(start))
            return np.array([float(row[at]) if len(row) > at and row[at].strip() else np.nan for row in lines[1:]])

        time, speed, torque = column("Time"), column("Motor Optical Speed"), column("Torque")
        if np.nanmedian(torque) < 0:
            torque = -torque  # the cell is mounted the other way
        if tare:  # what the cell reads with the propeller at rest, before each sweep
            rest = np.flatnonzero((speed == 0) & np.isfinite(torque))
            torque = torque - np.interp(np.arange(time.size), rest, torque[rest])
        good = np.isfinite(time) & np.isfinite(speed) & np.isfinite(torque) & (speed > 60)
        if cut is None:
            good &= np.concatenate([[True], np.diff(time) > 0.5]) | (np.arange(time.size) == 1)
        else:
            good &= (time < time[0] + cut) & np.concatenate([[True], np.diff(time) > 1e-6])
        time, speed, torque = time[good], speed[good], torque[good]
        increasing = np.concatenate([[True], np.diff(time) > 0])
        save(
            out,
            name,
            {"time_s": time[increasing], "speed_rad_s": speed[increasing], "friction_torque_Nm": torque[increasing]},
        )


def epos(text: str) -> tuple[datetime, np.ndarray]:
    """Return the date and the rows of a recording of the EPOS controller."""
    lines = text.splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("ms;")) + 1
    rows = []
    for line in lines[start:]:
        try:
            rows.append([float(x) for x in line.rstrip(", ").split(";")[:3]])
        except ValueError:
            continue  # a row with a remark of its authors
    date = next(line for line in lines if "Date" in line)
    return datetime.fromisoformat(date.replace('"', "").rstrip(", ").split(":;")[1].strip().rstrip(";, ")), np.array(
        [r for r in rows if len(r) == 3]
    )


def screws(source: str, out: Path) -> None:
    """From RViMLab/TRO2021-Dynamic-Modelling.

    Lead screw (1), antibacklash lead screw (2), worm drive (3), each lifting and lowering 96 g: dwells of 500 rows
    by the drive's controller (EPOS). Torque in per cent of 9.84 mN m at the motor, speed in rpm, both with the sign
    turned as in getEposData.m.
    """
    for drive, name in ((1, "screw"), (2, "antibacklash"), (3, "worm")):
        records = []
        for path in git_list(source, f"experiments/driveNo{drive}/steady_state"):
            date, rows = epos(git_show(source, path).decode("latin1"))
            records.append((date.timestamp(), rows[:, 0] / 1e3, -rows[:, 1] * np.pi / 30, -rows[:, 2] / 100 * 9.84e-3))
        records.sort(key=lambda r: r[0])
        begin = records[0][0]
        for part, count, keep in (("ladder", 4, None), ("forward", 5, 1), ("backward", 5, -1), ("dwells", 50, None)):
            parts: list[np.ndarray] = []
            end = -np.inf
            for at, time, speed, torque in records:
                if keep is not None and np.sign(speed.mean()) != keep:
                    continue
                t, v, f = means(speed.size // count, time, speed, torque)
                t = t + min(
                    max(at - begin, end + 1.0), end + 60.0 if parts else 0.0
                )  # dates have whole seconds; breaks (of an hour, too) become 60 s at most
                end = t[-1]
                parts.append(np.column_stack([t, v, f]))
            table = np.vstack(parts)
            save(
                out,
                f"{name}_{part}",
                {"time_s": table[:, 0], "speed_rad_s": table[:, 1], "friction_torque_Nm": table[:, 2]},
                dead_band=0.03,
            )
        path = next(p for p in git_list(source, f"experiments/driveNo{drive}/start_stop") if p.endswith("/200.csv"))
        _, rows = epos(git_show(source, path).decode("latin1"))
        save(
            out,
            f"{name}_start_stop",
            {
                "time_s": rows[:, 0] / 1e3,
                "speed_rad_s": -rows[:, 1] * np.pi / 30,
                "motor_torque_Nm": -rows[:, 2] / 100 * 9.84e-3,
            },
            {"inertia_kg_m2": {1: 2.186e-6, 2: 2.186e-6, 3: 6.5e-7}[drive]},
            dead_band=0.3,
        )


def reaction_wheel(source: str, out: Path) -> None:
    """From ethanfrick1962/ASEN3801Lab3.

    Reaction wheel of a teaching spin module: a current for five seconds, then none. K_T = 33.5 mN m/A; every second
    row, for the drive logs each value twice; J = 1.05e-4 kg m² fitted over five levels of current (not known
    otherwise).
    """
    for level in (8, 10, 15, 20):
        rows = np.genfromtxt(io.BytesIO(git_show(source, f"data/case_RW{level}")), skip_header=1, invalid_raise=False)
        time, speed, current = rows[:, 0] / 1e3, rows[:, 2] * np.pi / 30, rows[:, 3]
        limit = np.flatnonzero(speed > 410.0)  # the drive holds its greatest speed from here
        good = (time > 1.2) & (time < (time[limit[0]] - 0.1 if limit.size else 6.95))
        save(
            out,
            f"reaction_wheel_{level}mNm",
            {"time_s": time[good][::2], "speed_rad_s": speed[good][::2], "motor_current_A": current[good][::2]},
            {"inertia_kg_m2": 1.05e-4, "torque_constant_Nm_A": 0.0335},
            dead_band=3.0,
        )


def franka(source: str, out: Path) -> None:
    """From longshike/NNFM….

    Franka joints 2 and 7, friction torque as published (gravity and dynamics taken off by the authors); means of
    rows.
    """
    for name, file, count in (("franka_joint2_slow", "case3_slow", 10), ("franka_joint7_middle", "case4_middle", 10)):
        rows = np.genfromtxt(
            io.BytesIO(git_show(source, f"Comparative data/Franka Robot/{file}.csv")),
            delimiter=",",
            skip_header=1,
            usecols=(0, 2, 4),
            invalid_raise=False,
        )
        rows = rows[np.isfinite(rows).all(1)]
        time, speed, torque = means(count, *rows.T)
        save(out, name, {"time_s": time, "speed_rad_s": speed, "friction_torque_Nm": torque}, dead_band=0.005)


def arm7(source: str, out: Path) -> None:
    """From YIZHIXIAOCANGSHU/Friction-Identification-for-Manipulators.

    Seven-joint arm over a serial line, friction as published (measured torque less rigid body), uneven clock.
    """
    for joint in (3,):
        data = np.load(io.BytesIO(git_show(source, f"results/real_friction_identification_joint_{joint}.npz")))
        time, speed, torque = data["time"], data["qd"][:, joint - 1], data["tau_friction"][:, joint - 1]
        save(
            out,
            f"arm7_joint{joint}",
            {"time_s": time, "speed_rad_s": speed, "friction_torque_Nm": torque},
            dead_band=0.02,
        )


def rack(source: str, out: Path) -> None:
    """From KonradMnich/friction-identification.

    Rack and pinion pushed over one stroke (0.54 s), force cell and servo speed, F − 24.7 kg · a as in extraction.m.
    """
    data = loadmat(io.BytesIO(git_show(source, "input/sample_workspace_3.mat")))  # type: ignore[arg-type]
    time, speed, force = (data[k].ravel() for k in ("t", "v", "F"))
    friction = force - 24.7 * np.gradient(speed, time)
    good = np.abs(speed) > 0.01
    save(
        out,
        "rack",
        {"time_s": time[good], "speed_rad_s": speed[good], "friction_torque_Nm": friction[good]},
        {"inertia_kg_m2": 24.7},
    )


def cart(source: str, out: Path) -> None:
    """From nielsSkov/masterThesisMatlab.

    Cart on a toothed belt under a square wave of current, 150 Hz, in terms of its motor: τ = k_τ i − M r² dω/dt,
    k_τ = 93.4 mN m/A, r = 28 mm, M = 6.28 kg. `_current` has current and speed as they were logged.
    """
    constant, radius, mass = 93.4e-3, 0.028, 6.28
    for name, path in (
        ("cart_a", "cartTest1/testOffPointFour"),
        ("cart_b", "cartTest3/0m30"),
        ("cart_c", "cartTest1/testOffPointTwo"),
    ):
        rows = np.genfromtxt(io.BytesIO(git_show(source, f"parameterEstimation/data/{path}.csv")), delimiter=",")[2:]
        dt = (rows[-1, 0] - rows[0, 0]) / (len(rows) - 1)
        b, a = butter(2, 20.0 * 2 * dt)
        angle = filtfilt(b, a, rows[:, 2]) / radius
        speed = np.gradient(angle, dt)
        friction = filtfilt(b, a, constant * rows[:, 1]) - mass * radius**2 * np.gradient(speed, dt)
        cut = slice(int(1.5 / dt), -int(0.3 / dt))
        wheel = {"inertia_kg_m2": mass * radius**2}
        save(
            out,
            name,
            {"time_s": rows[cut, 0], "speed_rad_s": speed[cut], "friction_torque_Nm": friction[cut]},
            wheel,
            dead_band=0.7,
        )
        if name == "cart_a":
            save(
                out,
                name + "_current",
                {"time_s": rows[cut, 0], "speed_rad_s": rows[cut, 3] / radius, "motor_current_A": rows[cut, 1]},
                {**wheel, "torque_constant_Nm_A": constant},
                dead_band=0.7,
            )


def pendulum(source: str, out: Path) -> None:
    """From nielsSkov/masterThesisMatlab.

    Pendulum swinging freely, 150 Hz: one row for each half swing. The loss of m g l (1 − cos θ) between two turning
    points over the angle between them is the mean friction; its speed is the mean one. m = 0.2235 kg, l = 0.317 m
    (pendulum 1).
    """
    rows = np.genfromtxt(
        io.BytesIO(git_show(source, "parameterEstimation/data/pend1test/test1pend1.csv")), delimiter=","
    )
    swings(out, "pendulum", rows[:, 0], rows[:, 1] - np.pi, 0.2235 * 9.82 * 0.317)


def swings(out: Path, name: str, time: np.ndarray, angle: np.ndarray, weight: float) -> None:
    """Write friction and speed of a pendulum's half swings, and of swings to and fro.

    From the energy that is lost between two turning points, over the way: weight is m g l [N m], the angle [rad] is
    from the middle. Joined to and fro, an error of the middle cancels.
    """
    tops = np.sort(
        np.concatenate(
            [find_peaks(angle, distance=40, height=0.03)[0], find_peaks(-angle, distance=40, height=0.03)[0]]
        )
    )
    vertices = []
    for k in tops:  # vertex of a parabola over 11 rows
        w = slice(max(k - 5, 0), k + 6)
        c = np.polyfit(time[w] - time[k], angle[w], 2)
        vertices.append((time[k] - c[1] / (2 * c[0]), c[2] - c[1] ** 2 / (4 * c[0])))
    top_time, top = np.array(vertices).T
    alternate = np.concatenate([[True], np.sign(top[1:]) != np.sign(top[:-1])])
    top_time, top = top_time[alternate], top[alternate]
    top -= np.median((top[:-2] + 2 * top[1:-1] + top[2:]) / 4)  # the middle of the swings
    path = np.diff(top)
    speed, friction = path / np.diff(top_time), weight * (np.cos(top[1:]) - np.cos(top[:-1])) / path
    save(
        out,
        f"{name}_half_swings",
        {
            "time_s": (top_time[1:] + top_time[:-1]) / 2,
            "speed_rad_s": speed,
            "friction_torque_Nm": friction,
        },
        dead_band=0.03,
    )
    save(
        out,
        f"{name}_swings",
        {
            "time_s": top_time[1:-1],
            "speed_rad_s": (np.abs(speed[1:]) + np.abs(speed[:-1])) / 2,
            "friction_torque_Nm": (np.abs(friction[1:]) + np.abs(friction[:-1])) / 2,
        },
    )


def dyno(source: str, out: Path) -> None:
    """From Capo01/odrive_based_electric_motor_dynamometer.

    Brushless motor (270 rpm/V) against an absorber, ladder of speeds and loads, steady state: friction = K_T·i_q −
    torque at the load cell, K_T = 8.27/270 N m/A (nominal); the motor torque is the load channel. The rows have no
    time: 1 s each.
    """
    lines = (
        git_show(source, "Odrive motor testing procedure/Motor Data/Odrive D5065 270kv/odrive_data.csv")
        .decode()
        .splitlines()
    )
    numbers = []
    for line in lines:
        try:
            numbers.append([float(x) for x in line.split(",")])
        except ValueError:
            continue
    rows = np.array([r for r in numbers if len(r) == 19])
    temperature, current, torque, speed = rows[:, 3], rows[:, 5], rows[:, 9] / 1e3, rows[:, 10]
    good = (np.abs(speed) > 5) & (np.abs(speed - np.sign(speed) * rows[:, 11]) < 2.5)  # at its set-point
    motor = 8.27 / 270 * current
    save(
        out,
        "dyno",
        {
            "time_s": np.arange(good.sum(), dtype=float),
            "speed_rad_s": speed[good],
            "friction_torque_Nm": (motor - torque)[good],
            "motor_torque_Nm": motor[good],
            "bearing_temperature_degC": temperature[good],
        },
    )


if __name__ == "__main__":
    globals()[sys.argv[1]](sys.argv[2], Path(sys.argv[3]))
