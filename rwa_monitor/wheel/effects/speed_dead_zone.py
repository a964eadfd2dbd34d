"""Speed dead zone: below a small speed the wheel's electronics see no motion."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape

FEWEST_RESTS: Final = 25.0  # readings that rest where the wheel moves: 3e-8 by chance
FEWEST_HELD: Final = 4  # readings that are the same; on a grid as fine as their noise neighbours often are
PARTS: Final = 4  # of the speeds between the edge and twice of it: a wheel that passes them is seen in each
EVENLY: Final = 0.25  # of an even share of the readings, in each part: less is a dwell beside it


def _shown_width(channels: Channels) -> tuple[float, float]:
    return 2.0 * channels.speed_step_rad_s, 0.1 * float(channels.used_speed_rad_s.max())


class SpeedDeadZone(MeanEffect):
    """Friction that is missing in a narrow band of speeds around zero.

    Below a smallest speed the tachometer reads nothing. What that does depends on how the record came to be. Where
    friction is computed from the speed by a friction model, or estimated with the speed read, its part that follows the
    sign is lost inside the zone: this is the plateau of the formula. A torque balance K_T I − J dω/dt does not lose it:
    the current still carries the friction, and as the dω/dt of the reading is zero inside, J dω/dt of the true motion
    is added to it, with a pulse of the opposite sign where the reading jumps at the ends. There the zone shows in the
    speed readings, not as this plateau. `read_speed` gives what such a tachometer reads.

    What shows it
    -------------
    A plateau around zero speed with sharp ends, in friction that was computed with the speed read; a speed that reads
    exactly zero while the wheel reverses, in any record.

    See Also
    --------
    stribeck, presliding, sublinear_viscous

    References
    ----------
    Elementary: a tachometer that counts pulses has a smallest speed at which a pulse falls into its gate time. The
    width is a working assumption.
    """

    name = "speed_dead_zone"
    threshold = "dead_zone_rad_s"
    title = "Dead zone of the speed reading"
    formula = r"\tau = -\tau_0\, \operatorname{sign}(\omega) \text{ where } |\omega| < \omega_{dz}, \text{ else } 0"
    separate_by = "A slow zero crossing: a plateau has sharp ends, a Stribeck peak fades out and has the other sign."
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 1.6e-3, linear=True),
        Parameter("dead_zone_rad_s", "rad/s", 1e-4, 100.0, 1.0, shown=_shown_width),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        inside = np.abs(channels.speed_rad_s) < shape["dead_zone_rad_s"]
        # Where the speed is not known, neither is the column: direction is NaN there and so is the product.
        return np.where(inside | np.isnan(channels.speed_rad_s), -channels.direction, 0.0)

    def read_speed(self, speed_rad_s: FloatArray) -> FloatArray:
        """Return what a tachometer with this dead zone reads [rad/s]: zero inside."""
        return np.where(np.abs(speed_rad_s) < self.values["dead_zone_rad_s"], 0.0, speed_rad_s)


# ---- a zone that shows in the readings: they rest on zero, or on the last one outside, while the wheel passes --------


class ReadZone(NamedTuple):
    """A dead zone as readings of the speed show it.

    Attributes
    ----------
    width_rad_s, std_rad_s
        The slowest reading of a wheel that moves, and what that may be above the edge [rad/s].
    inside
        bool (n,), readings that rest.
    deviance
        Twice the log-likelihood of readings that leave out the zone, beside ones as dense within it as next to it.
    """

    width_rad_s: float
    std_rad_s: float
    inside: BoolArray
    deviance: float


def read_zone(speed_rad_s: FloatArray, step_rad_s: float) -> ReadZone | None:
    """Return the dead zone that readings of the speed show; None where none does.

    A wheel that passes zero evenly is as long below a speed as between that and twice of it. A zone shows where
    readings fill the latter, rest in between, and none lies below. A wheel that stops is seen below as well, one that
    hurries through zero does not rest, and one that dwells beside zero does not fill what is around.

    Parameters
    ----------
    speed_rad_s
        float64 (n,), readings in order, NaN where unknown [rad/s].
    step_rad_s
        Of the grid that they lie on, 0 for none: between zero and one step there are no readings anyway.
    """
    known = np.flatnonzero(np.isfinite(speed_rad_s))
    reading = speed_rad_s[known]
    begins = np.diff(reading, prepend=np.nan) != 0.0
    run = np.cumsum(begins) - 1
    held = ~begins & (np.bincount(run)[run] >= FEWEST_HELD)
    rests = held | (reading == 0.0)
    moving = np.flatnonzero(~rests)
    size, side = np.abs(reading[moving]), np.sign(reading[moving])
    if moving.size < 2 or not rests.any():
        return None
    width, between = float(size.min()), np.diff(moving) - 1
    crossed = (side[1:] != side[:-1]) & (between > 0)
    # How many readings next to the edge are of a passage: without a gap in it, up to twice the speed.
    near = size < 2.0 * width
    passage = np.cumsum(np.append(True, ~(near[1:] & near[:-1])))
    passed = near & np.isin(passage, passage[1:][crossed & near[1:]])
    filled = np.bincount(((size[passed] / width - 1.0) * PARTS).astype(np.int64), minlength=PARTS)[:PARTS]
    count = 1.0 * min(int(filled.sum()), int(between[crossed].sum()))
    count *= max(width - step_rad_s, 0.0) / width
    if count < FEWEST_RESTS or filled.min() < EVENLY * filled.mean():
        return None
    # A wheel that hurries through a zone which there is leaves a reading that is held for a sample or two.
    side_of_run = np.sign(reading[begins])
    turns = np.append(side_of_run[1:] != side_of_run[:-1], False)[run]
    inside = np.zeros(speed_rad_s.size, dtype=np.bool_)
    inside[known[(rests & (np.abs(reading) < 2.0 * width)) | (~begins & turns)]] = True
    return ReadZone(width, max(width / (int(passed.sum()) + 1), step_rad_s), inside, float(2.0 * np.log(2.0) * count))
