"""Samples thinned for a picture: bounded memory for each wheel, however long it runs."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.messages import SamplesMessage, dump_json
from rwa_monitor.samples import FloatArray, IntArray, Samples

MAX_POINTS: Final = 6_000  # a screen is some 1,500 pixels wide, and a picture spans up to two windows


class Trace:
    """The latest samples of one wheel, every `stride`-th of them; the stride doubles where they span too long a time.

    Samples are picked, not averaged: noise looks as it is. What lies before `keep_from` may be dropped.
    """

    def __init__(self) -> None:
        self.stride = 1
        self._phase = 0  # samples to skip before the next one that is picked
        self._time_ns: IntArray = np.zeros(0, dtype=np.int64)
        self._speed: FloatArray = np.zeros(0)
        self._friction: FloatArray = np.zeros(0)

    def add(self, samples: Samples) -> Samples:
        """Take samples in; returns those that were picked."""
        picked = samples[self._phase :: self.stride]
        self._phase = (self._phase - len(samples)) % self.stride
        friction = picked.friction_torque_Nm
        self._time_ns = np.concatenate([self._time_ns, picked.time_ns])
        self._speed = np.concatenate([self._speed, picked.speed_rad_s])
        self._friction = np.concatenate(
            [self._friction, np.full(len(picked), np.nan) if friction is None else friction]
        )
        if self._time_ns.size > MAX_POINTS:
            self._thin()
        return picked

    def keep_from(self, time_ns: int) -> None:
        """Drop what is older than a time; the stride is small again where there is room for it."""
        keep = self._time_ns >= time_ns
        self._time_ns, self._speed, self._friction = self._time_ns[keep], self._speed[keep], self._friction[keep]
        if self._time_ns.size > MAX_POINTS // 2:
            self._thin()

    def _thin(self) -> None:
        self.stride *= 2
        self._phase = 0
        self._time_ns, self._speed, self._friction = self._time_ns[::2], self._speed[::2], self._friction[::2]

    def message(self) -> bytes:
        """Return the trace as the JSON of a `SamplesMessage`, "null" where it is empty."""
        return thinned_json(Samples(self._time_ns, self._speed, self._friction)) if self._time_ns.size else b"null"


def thinned_json(samples: Samples) -> bytes:
    """Return time, speed and friction of samples as the JSON of a `SamplesMessage`."""
    friction = samples.friction_torque_Nm
    return dump_json(
        {
            "time_ns": samples.time_ns.tolist(),
            "speed_rad_s": _readings(samples.speed_rad_s),
            "friction_torque_Nm": _readings(np.full(len(samples), np.nan) if friction is None else friction),
        }
    )


def samples_of(payload: bytes, key: str) -> Samples:
    """Read a samples message; raises InputError where it is none."""
    return SamplesMessage.parse(payload, key).samples()


def _readings(values: FloatArray) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in np.round(values, 9).tolist()]
