"""The public Python interface of `import rwa_monitor`, in the order of the data flow.

```python
import rwa_monitor as rwa

wheel = rwa.read_wheel("wheel.toml")
samples = rwa.read("today.csv")
for diagnosis in rwa.diagnose(samples, wheel):
    print(diagnosis.verdict, diagnosis.reason)
```

Everything here is thin: it reads files and calls the pure packages, as the commands do. It returns the plain values of
those packages and the messages of the bus, so that a script, the command line and the bus give the same results.

Functions here restrict linear algebra to one thread (`threads.one_thread_of_algebra`): the same bytes on every machine,
and several times faster.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.discrepancy.extended import extended_wheel
from rwa_monitor.discrepancy.find import find_discrepancy as search_recordings
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.errors import InputError, RwaMonitorError, needs_extra
from rwa_monitor.identification.identify import Learned, bare_wheel
from rwa_monitor.identification.identify import identify as learn_wheel
from rwa_monitor.messages import Diagnosis, Method
from rwa_monitor.monitor.core import Event, WheelCore, WindowDiagnosed
from rwa_monitor.monitor.ingest import Trouble
from rwa_monitor.monitor.replay import Report
from rwa_monitor.monitor.replay import replay as replay_recordings
from rwa_monitor.monitor.setup import read_model, read_scenario, read_wheel
from rwa_monitor.monitor.telemetry_files import read_telemetry
from rwa_monitor.reporting.diagnoses import CoefficientTrend, wheel_trends
from rwa_monitor.samples import Samples, Timeliness
from rwa_monitor.simulation.record import Telemetry
from rwa_monitor.simulation.record import simulate as simulate_telemetry
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.telemetry.files import PathLike, display_name
from rwa_monitor.telemetry.reader import joined, only_wheel, read_decoding
from rwa_monitor.threads import on_threads, one_thread_of_algebra
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = [
    "CarriedState",
    "CoefficientTrend",
    "Diagnosis",
    "InputError",
    "Learned",
    "Model",
    "Monitor",
    "Report",
    "RwaMonitorError",
    "Samples",
    "Scenario",
    "Search",
    "Telemetry",
    "Wheel",
    "diagnose",
    "extended_wheel",
    "find_discrepancy",
    "frame",
    "identify",
    "read",
    "read_model",
    "read_wheel",
    "replay",
    "simulate",
    "wheel_trends",
]

ANOMALY_FIELDS: Final = {"active", "probability", "severity", "estimate", "unit"}  # in a row of a table

Recordings = Samples | Sequence[Samples] | Mapping[str, Samples]


# ---- telemetry, measured and simulated -------------------------------------------------------------------------------


def read(
    path: PathLike,
    *,
    telemetry_map: PathLike | None = None,
    xtce: PathLike | None = None,
    wheel: Wheel | None = None,
) -> Samples:
    """Read the telemetry of one wheel: CSV, Parquet, MCAP, space packets or a ROS 2 bag.

    Parameters
    ----------
    path
        A sample table, or a recording that holds one wheel.
    telemetry_map
        For space packets and ROS 2 bags: the file that gives which parameter or topic is which channel.
    xtce
        For space packets: the XTCE definition of their content.
    wheel
        For a run-down with the motor off, and for a table of pulses: states the former, and the pulses per turn.

    Returns
    -------
    Samples
        Struct of arrays of shape (n,): int64 time [ns], float64 channels in SI units, NaN where nothing was measured.

    Raises
    ------
    InputError
        If a file cannot be used (reports where and why), or holds several wheels.

    Warns
    -----
    UserWarning
        About columns that are ignored, and parts of a recording that could not be read.
    """
    file = Path(path)
    content = read_telemetry(file, read_decoding(telemetry_map, xtce).of_wheel(wheel))
    for note in (*content.problems, *content.notes):
        warnings.warn(note, stacklevel=2)
    return joined(only_wheel(content, display_name(file)))


@one_thread_of_algebra()
def simulate(
    scenario: Scenario | PathLike | None = None, wheel: Wheel | None = None, *, seed: int | np.random.Generator = 0
) -> Telemetry:
    """Simulate a wheel's telemetry together with its complete ground truth.

    Parameters
    ----------
    scenario
        The scenario or its file; None: 10,000 s of a healthy wheel in orbit.
    wheel
        The wheel; None: the built-in one.
    seed
        Seed or generator; the same seed gives the same bytes.

    Returns
    -------
    Telemetry
        `samples` as `read` returns them, and `truth`: jumps, configurations, components, noise.

    Raises
    ------
    InputError
        If the scenario does not fit the wheel.
    """
    scene = scenario if isinstance(scenario, Scenario) else read_scenario(scenario)
    return simulate_telemetry(scene, wheel or built_in_wheel(), np.random.default_rng(seed))


# ---- diagnosis -------------------------------------------------------------------------------------------------------


class Monitor:
    """The live monitor of one wheel without a bus: samples in, diagnoses out, however the samples are batched.

    Parameters
    ----------
    wheel
        Its constants; None: the built-in wheel.
    model
        The learned model of nominal and anomalous friction; None: the built-in model.
    method
        "joint", or "paper" for the method of the paper.
    spacecraft, name
        Names of spacecraft and wheel in the diagnoses; `name` None: that in the wheel file.
    source
        The field `source` of the diagnoses, which for the command `diagnose` is the file; None: no source.
    carried
        State after earlier windows of this wheel, from another monitor's `carried`; None: no earlier windows.

    Raises
    ------
    InputError
        If the wheel cannot be monitored: its windows overlap too often, or one of its effects cannot be built.
    """

    def __init__(
        self,
        wheel: Wheel | None = None,
        model: Model | None = None,
        *,
        method: Method = "joint",
        spacecraft: str = "",
        name: str | None = None,
        source: str | None = None,
        carried: CarriedState | None = None,
    ) -> None:
        self.wheel = wheel or built_in_wheel()
        self.spacecraft = spacecraft
        self.name = name or self.wheel.name
        self.source = source
        self._troubles: dict[str, str] = {}
        self._core = WheelCore(self.wheel, model or built_in_model(), method=method, carried=carried)

    @one_thread_of_algebra()
    def feed(
        self, samples: Samples, publisher: str = "", batch: int | None = None, data: Timeliness | None = None
    ) -> list[Diagnosis]:
        """Take samples, and return the diagnoses of the windows that they closed.

        Parameters
        ----------
        samples
            Any number, in order of time; late and duplicate ones are counted and left out.
        publisher, batch
            Sender and message number, where known: gaps are then detected.
        data
            "stored" for a dump, which may be late and out of order; "live" (or "replay") for the other samples then;
            None where all come in order.

        Raises
        ------
        InputError
            If friction is neither given nor can be derived from current and the wheel's constants.
        """
        return self._messages(self._core.feed(samples, publisher, batch, data))

    @one_thread_of_algebra()
    def finish(self) -> list[Diagnosis]:
        """Return the diagnosis of the open window, marked partial: nothing more will come."""
        return self._messages(self._core.finish())

    @property
    def carried(self) -> CarriedState:
        """State after the windows so far; the next monitor of this wheel may begin with it."""
        return self._core.carried

    @property
    def counts(self) -> Mapping[str, int]:
        """Counts of samples by outcome: received = used + masked + late + duplicate + rejected + queued."""
        return asdict(self._core.counts)

    @property
    def why_masked(self) -> Mapping[str, int]:
        """Number of samples masked in spite of good values, by the reason in words; only reasons that occurred."""
        return {words: count for words, count in self._core.why_masked.items() if count}

    @property
    def troubles(self) -> list[str]:
        """Problems in the samples so far that concern an operator, in words: the first of each kind."""
        return list(self._troubles.values())

    def _messages(self, events: Sequence[Event]) -> list[Diagnosis]:
        for event in events:
            if isinstance(event, Trouble):
                self._troubles.setdefault(event.kind, event.text)
        return [
            event.message(self.spacecraft, self.name, self.source)
            for event in events
            if isinstance(event, WindowDiagnosed)
        ]


def diagnose(
    samples: Samples,
    wheel: Wheel | None = None,
    model: Model | None = None,
    *,
    method: Method = "joint",
    carried: CarriedState | None = None,
) -> list[Diagnosis]:
    """Diagnose a whole table, window by window; the same bytes as the live monitor's and the command's.

    Parameters
    ----------
    samples
        The table, n samples.
    wheel, model, method, carried
        As for `Monitor`.

    Returns
    -------
    list of Diagnosis
        One for each window, the last one perhaps partial. The fields are those of the bus; `to_json()` gives the line
        of `diagnose --json`.

    Raises
    ------
    InputError
        If friction is neither given nor can be derived.
    """
    monitor = Monitor(wheel, model, method=method, carried=carried)
    return [*monitor.feed(samples), *monitor.finish()]


def frame(diagnoses: Iterable[Diagnosis]) -> DataFrame:
    """Return diagnoses as a pandas frame, a row for each; `to_parquet` writes it.

    Parameters
    ----------
    diagnoses
        Of one wheel or of many.

    Returns
    -------
    pandas.DataFrame
        Column names contain the units; those of an anomaly begin with its name (`dry_probability`,
        `fss_1_active`), and `message` is the whole diagnosis as JSON. The same columns as `diagnose --results` keeps.

    Raises
    ------
    RwaMonitorError
        If pandas is not installed (`pip install 'rwa-monitor[pandas]'`).
    """
    with needs_extra("pandas"):
        import pandas as pd
    return pd.DataFrame([diagnosis_row(diagnosis) for diagnosis in diagnoses])


def diagnosis_row(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return one diagnosis as a row; `message` is the whole of it, as `diagnose --json` prints it.

    Columns of an anomaly begin with its name: `dry_probability`, `fss_1_active`, …
    """
    friction, fit = diagnosis.friction, diagnosis.fit
    row: dict[str, Any] = {
        name: value for name, value in diagnosis if value is None or isinstance(value, bool | float | int | str)
    }
    row |= {
        "base_dry_Nm": friction.base_dry.value,
        "base_dry_std_Nm": friction.base_dry.std,
        "viscous_Nm_s_rad": friction.viscous.value,
        "viscous_std_Nm_s_rad": friction.viscous.std,
        "changepoints": len(diagnosis.changepoints),
        "rmse_Nm": fit.rmse_Nm,
        "noise_std_Nm": fit.noise_std_Nm,
    }
    for name, anomaly in diagnosis.anomalies.items():
        row |= {f"{name}_{field}": value for field, value in anomaly.model_dump(include=ANOMALY_FIELDS).items()}
    return row | {"message": diagnosis.to_json().decode("utf-8")}


def replay(recordings: PathLike | Sequence[PathLike]) -> Report:
    """Compute every decision of a recording of `run` again, and compare; the same as `rwa-monitor replay --verify`.

    Parameters
    ----------
    recordings
        A file, a folder whose recordings form a chain, or several files in order.

    Returns
    -------
    Report
        `.short()` is a summary in one line; `.equal`, `.bytes_equal`, `.differences` and `.unreadable` for a script.

    Raises
    ------
    InputError
        If a path is no recording, or its attachments cannot be used.
    """
    paths = Path(recordings) if isinstance(recordings, str | os.PathLike) else [Path(path) for path in recordings]
    with one_thread_of_algebra():
        return replay_recordings(paths)


# ---- a wheel, and what its simulation gets wrong ---------------------------------------------------------------------


def identify(recordings: Recordings, start: Wheel | None = None, *, systems: bool = True) -> Learned:
    """Learn a wheel's nominal friction, noise and switching laws from recordings of it while healthy.

    Parameters
    ----------
    recordings
        One recording, or several of one wheel; a mapping gives their names in messages.
    start
        Values known already: name, sample period, motor constants, limits. None: the sample period of the recordings.
    systems
        False: nominal friction and noise only, for short recordings.

    Returns
    -------
    Learned
        `.wheel`, whose `to_toml()` is the wheel file, and `.notes`: the basis of its values, with uncertainties.

    Raises
    ------
    InputError
        If a recording cannot be used, or there is too little to learn from; reports how much more is needed.
    """
    named = _named(recordings)
    with one_thread_of_algebra():
        return learn_wheel(named, start or bare_wheel("wheel", named[0][1]), systems=systems)


def find_discrepancy(
    recordings: Recordings,
    wheel: Wheel | None = None,
    *,
    progress: Callable[[str], None] = lambda _: None,
    threads: int = 1,
    held_out: Recordings = (),
) -> Search:
    """Find where the simulation of a wheel is wrong, name the cause, extend the model and measure the gain.

    Parameters
    ----------
    recordings
        One recording, or several of one wheel for one joint answer; a mapping gives their names in messages.
    wheel
        The simulation: constants, nominal friction, effects known already. None: the built-in wheel.
    progress
        Called with a text on each step.
    threads
        Number of candidates tried at a time; the answer does not depend on it.
    held_out
        Further recordings of the wheel, on which nothing is searched or fitted: the gain is measured on them. If there
        are none, on blocks of the recordings, left out in turn.

    Returns
    -------
    Search
        `.result` is the answer and `.result.to_json()` the report of the command; `extended_wheel(search)` is the wheel
        with what was found, for `diagnose`, `simulate` and, as a file, for every command.

    Raises
    ------
    InputError
        If a recording cannot be used: no friction, too few samples in motion, wrong units.
    """
    named, beside = _named(recordings), _named(held_out, "held out") if held_out else []
    with one_thread_of_algebra():
        return search_recordings(named, wheel or built_in_wheel(), progress, on_threads(threads), beside)


def _named(recordings: Recordings, word: str = "recording") -> list[tuple[str, Samples]]:
    """Return recordings with names; those without a name are numbered. Raise InputError if there are no recordings."""
    if not recordings:
        raise InputError("recordings", "none given; one is needed")
    if isinstance(recordings, Mapping):
        return list(recordings.items())
    listed = [recordings] if isinstance(recordings, Samples) else recordings
    return [(f"{word} {number}", samples) for number, samples in enumerate(listed, start=1)]
