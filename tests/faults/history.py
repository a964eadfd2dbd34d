"""A random history: telemetry, how it is cut into messages, and what goes wrong when. Made of (seed, number) alone."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from rwa_monitor.messages import SamplesMessage, samples_json
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import Wheel
from tests.monitor.support import spoiled
from tests.monitor.support import wheel as wheel_of

WINDOW: Final = 2_000
PERIOD_NS: Final = 125_000_000
HISTORY_MESSAGES: Final = 8_192
SHORT_HISTORY: Final = 4  # messages that a publisher keeps where an outage is to outlast its history

# Faults while messages are sent, with descriptions; after these everything can be recovered.
RECOVERABLE: Final = {
    "kill_monitor": "the monitor is killed (SIGKILL) at any moment and started again",
    "restart_monitor": "the monitor is stopped in order (SIGTERM) and started again",
    "pause_monitor": "the monitor stands still (SIGSTOP) for up to 1.6 s, longer than the lease of its connection",
    "kill_router": "the router is killed and started again",
    "cut_link": "the connection between monitor and router is cut, messages flow on, it heals",
    "freeze_link": "nothing passes on that connection for a while, and it stays open",
    "restart_publisher": "the publisher, all of whose samples are on the disk, is killed, and another takes its place",
    "rotation": "recordings end as soon as they may, one after the other",
    "duplicate": "messages are sent twice",
    "reorder": "messages overtake each other",
    "corrupt": "damaged messages that cannot be read",
    "second_publisher": "a second publisher publishes on the same wheel while the first one lives",
    "disk_full": "the disk of the recordings is full to the last byte, then free again",
    "disk_fails": "writing to the recording fails (RLIMIT_FSIZE), then works again",
    "clock_step": "the wheel's clock steps by more than a window, forwards or back",
    "wild_times": "single samples with a wild time",
    "bad_data": "a sensor that hangs, spikes, a wrong unit, dropouts, values not measured, flipped bits of values",
    "second_wheel": "a second wheel appears and vanishes",
}
# After these something is lost.
LOSING: Final = {
    "outage_beyond_history": "an outage that lasts longer than the publisher's history (loses samples)",
    "publisher_dies_in_outage": "the publisher and its history die during an outage (loses samples)",
    "flipped_recording": "the monitor is killed; a bit of its recording flips before it starts again (loses samples)",
}
LOSING_SHARE: Final = 0.16  # of all histories
# Faults that interrupt a process or link for a while, one after the other; the others are in messages or settings.
TAKING: Final = frozenset(
    {
        "kill_monitor",
        "restart_monitor",
        "pause_monitor",
        "kill_router",
        "cut_link",
        "freeze_link",
        "restart_publisher",
        "disk_full",
        "disk_fails",
        *LOSING,
    }
)
NEEDS_ROOT: Final = frozenset({"disk_full"})
# A second publisher sends before the first outage: in one, it could not be told from a restart.
QUIET_BEGINNING: Final = 14
INTRUDING_MESSAGES: Final = 6
MAX_DELAY_S: Final = 1.6
LEAST_AFTER: Final = 12  # messages that follow the last fault: enough for a restarted publisher to be accepted


@dataclass(frozen=True, slots=True)
class Put:
    """One message on the bus; `publisher` is who sends it (the name on the bus is in the payload)."""

    key: str
    publisher: str
    payload: bytes
    samples: int = 0
    pause_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong before message `at`; `until` is where it ends, `delay_s` how long it takes."""

    name: str
    at: int
    until: int
    delay_s: float


@dataclass(frozen=True, slots=True)
class History:
    """Everything about one history.

    Attributes
    ----------
    puts
        Messages in the order in which they are sent.
    faults
        In order; they do not overlap.
    kinds
        Names of all faults, those of the data included.
    sent
        Samples by key, in order, that must be diagnosed.
    garbage
        Payloads that cannot be read.
    kept
        Number of messages that a publisher keeps for subscribers that missed them.
    """

    puts: tuple[Put, ...]
    faults: tuple[Fault, ...]
    kinds: tuple[str, ...]
    sent: dict[str, Samples]
    garbage: tuple[bytes, ...]
    kept: int

    @property
    def recoverable(self) -> bool:
        """Whether everything that was sent can reach the monitor in the end."""
        return LOSING.keys().isdisjoint(self.kinds)

    @property
    def loses_recording(self) -> bool:
        """Whether the disk fails, so that the recording may lack something."""
        return not {"disk_full", "disk_fails", "flipped_recording"}.isdisjoint(self.kinds)


def wheel() -> Wheel:
    """Return the reference wheel with a window of 2,000 slots."""
    return wheel_of(WINDOW)


def make_history(seed: int, number: int, *, root: bool) -> History:
    """Make a history; the same arguments always give the same one.

    Parameters
    ----------
    seed, number
        Of the campaign, and within it.
    root
        Whether faults are allowed that need the rights of root (a disk of its own); without, others take their place.
    """
    rng = np.random.default_rng((seed, number))
    names = [name for name in RECOVERABLE if root or name not in NEEDS_ROOT]
    # The first fault goes round, so that each kind comes often enough; up to three more come at random.
    chosen = [names[number % len(names)], *rng.choice(names, size=int(rng.integers(0, 4))).tolist()]
    if rng.random() < LOSING_SHARE:
        # A publisher that restarts is waited for until all of it has arrived: with these it never has.
        chosen = [str(rng.choice(list(LOSING))), *(name for name in chosen[:1] if name != "restart_publisher")]
    return _Maker(rng, tuple(dict.fromkeys(chosen))).make()


@dataclass(slots=True)
class _Maker:
    rng: np.random.Generator
    kinds: tuple[str, ...]
    garbage: list[bytes] = field(default_factory=list)

    def make(self) -> History:
        keys = ["rwa/sat/wheel_1/samples"]
        if "second_wheel" in self.kinds:
            keys.append("rwa/sat/wheel_2/samples")
        sent = {key: self._telemetry() for key in keys}
        first = list(self._messages(keys[0], sent[keys[0]]))
        faults = self._faults(len(first))
        first = self._named(first, faults)
        groups = [[put] for put in first]  # what is sent at each position, so that positions stay what they are
        self._trouble(groups)
        if len(keys) > 1:  # the second wheel appears and vanishes while the first one is there
            begin = int(self.rng.integers(0, len(first) // 2))
            others = list(self._messages(keys[1], sent[keys[1]]))
            for number, put in enumerate(others):
                name = replace(put, publisher="other wheel", payload=_of_publisher(put.payload, "b0", number))
                groups[min(begin + number // 2, len(groups) - 1)].append(name)
        if "second_publisher" in self.kinds:
            self._second_publisher(groups, keys[0])
        puts, faults = _flat(groups, faults)
        kept = SHORT_HISTORY if "outage_beyond_history" in self.kinds else HISTORY_MESSAGES
        return History(puts, faults, self.kinds, sent, tuple(self.garbage), kept)

    # ---- telemetry ---------------------------------------------------------------------------------------------------

    def _telemetry(self) -> Samples:
        slots = int(self.rng.integers(2, 4)) * WINDOW + int(self.rng.integers(40, 400))
        scenario = Scenario(duration_s=slots * 0.125, friction_given=True)
        samples = simulate(scenario, wheel(), self.rng).samples
        if "bad_data" in self.kinds:
            samples = spoiled(samples, int(self.rng.integers(2**31)))
            speed, friction = samples.speed_rad_s.copy(), samples.friction_torque_Nm.copy()
            start = int(self.rng.integers(0, len(samples) - 200))
            friction[start : start + 100] = friction[start]  # a stuck sensor
            friction[self.rng.integers(0, len(samples), 5)] *= 40.0  # spikes
            flipped = self.rng.integers(0, len(samples), 5)  # any bit but the two that make it no number
            friction.view(np.int64)[flipped] ^= np.int64(1) << self.rng.integers(0, 62, 5)
            speed[self.rng.integers(0, len(samples), 5)] = 3.0e4  # a wrong unit: beyond the wheel's limits
            samples = replace(samples, speed_rad_s=speed, friction_torque_Nm=friction)
        time_ns = samples.time_ns + 1_700_000_000_000_000_000
        if "clock_step" in self.kinds:
            at = int(self.rng.integers(200, len(samples) - 200))
            # A restart with the clock set back takes longer to be accepted than a history lasts.
            back = "restart_publisher" not in self.kinds and self.rng.random() < 0.5
            time_ns[at:] += (-1 if back else 1) * int(self.rng.integers(WINDOW + 300, 9 * WINDOW)) * PERIOD_NS
        if "wild_times" in self.kinds:
            at = self.rng.choice(np.arange(5, len(samples) - 5), 4, replace=False)
            time_ns[at] += (self.rng.integers(2**45, 2**59, 4) // PERIOD_NS) * PERIOD_NS
        return replace(samples, time_ns=time_ns)

    def _messages(self, key: str, samples: Samples) -> Iterator[Put]:
        start = 0
        while start < len(samples):
            part = samples[start : start + int(self.rng.integers(50, 130))]
            start += len(part)
            pause_s = float(self.rng.uniform(0.001, 0.012))
            yield Put(key, "one", samples_json(part, "", 0), len(part), pause_s)

    # ---- faults ------------------------------------------------------------------------------------------------------

    def _faults(self, messages: int) -> tuple[Fault, ...]:
        """Place the faults of machines and links one after the other."""
        active = [name for name in self.kinds if name in TAKING]
        if "kill_monitor" in active and self.rng.random() < 0.3:
            active.append("kill_monitor")
        self.rng.shuffle(active)
        first = QUIET_BEGINNING if "second_publisher" in self.kinds else 3
        borders = np.linspace(first, messages - LEAST_AFTER, len(active) + 1).astype(int)
        faults = []
        for name, low, high in zip(active, borders[:-1], borders[1:], strict=True):
            at = int(self.rng.integers(low, max(low + 1, high - 2)))
            until = int(self.rng.integers(at + 1, max(at + 2, high)))
            if name == "outage_beyond_history":
                until = max(until, at + 2 * SHORT_HISTORY)
            faults.append(Fault(name, at, until, float(self.rng.uniform(0.0, MAX_DELAY_S))))
        return tuple(faults)

    def _named(self, puts: list[Put], faults: tuple[Fault, ...]) -> list[Put]:
        """Give messages their publisher's name and number; a publisher that restarts gets new ones."""
        starts = {fault.at for fault in faults if fault.name == "restart_publisher"}
        starts |= {fault.until for fault in faults if fault.name == "publisher_dies_in_outage"}
        named = []
        life, number = 0, 0
        for place, put in enumerate(puts):
            if place in starts:
                life, number = life + 1, 0
            named.append(replace(put, payload=_of_publisher(put.payload, f"a{life}", number)))
            number += 1
        return named

    def _trouble(self, groups: list[list[Put]]) -> None:
        """Send some messages twice, some out of order, and some invalid payloads."""
        places = np.arange(2, len(groups) - LEAST_AFTER)
        if "reorder" in self.kinds:
            for at in self.rng.choice(places[places % 4 == 0], 3, replace=False):
                if groups[at][0].payload[:16] == groups[at + 1][0].payload[:16]:  # of one publisher
                    groups[at], groups[at + 1] = groups[at + 1], groups[at]
        if "duplicate" in self.kinds:
            for at in self.rng.choice(places, 4, replace=False):
                groups[at].append(replace(groups[at][0], samples=0))
        if "corrupt" in self.kinds:
            for at in self.rng.choice(places, 4, replace=False):
                self.garbage.append(self._damaged(groups[at][0].payload))
                groups[at].append(replace(groups[at][0], payload=self.garbage[-1], samples=0))

    def _damaged(self, payload: bytes) -> bytes:
        """Damage a message so that it cannot be read; a flipped digit would still be a message."""
        while True:
            broken = bytearray(payload)
            for at in self.rng.integers(0, len(broken), 3):
                broken[at] ^= 1 << int(self.rng.integers(8))
            broken = broken[: int(self.rng.integers(1, len(broken) + 1))]
            try:
                SamplesMessage.model_validate_json(bytes(broken))
            except ValueError:
                return bytes(broken)

    def _second_publisher(self, groups: list[list[Put]], key: str) -> None:
        """Let another publisher send between two messages of the first one, for a while."""
        foreign = list(self._messages(key, self._telemetry()))
        at = int(self.rng.integers(2, QUIET_BEGINNING - INTRUDING_MESSAGES))
        for number in range(INTRUDING_MESSAGES):
            put = replace(foreign[at % len(foreign)], publisher="intruder", samples=0)
            groups[at + number].append(replace(put, payload=_of_publisher(put.payload, "x0", 500 + number)))


def _of_publisher(payload: bytes, name: str, number: int) -> bytes:
    return payload.replace(b'"publisher":"","batch":0', f'"publisher":"{name}","batch":{number}'.encode(), 1)


def _flat(groups: list[list[Put]], faults: tuple[Fault, ...]) -> tuple[tuple[Put, ...], tuple[Fault, ...]]:
    """Return all messages as one sequence, and the faults with their positions in it."""
    places = np.concatenate(([0], np.cumsum([len(group) for group in groups])))
    moved = tuple(replace(fault, at=int(places[fault.at]), until=int(places[fault.until])) for fault in faults)
    return tuple(put for group in groups for put in group), moved
