"""Records for the search: measured telemetry on the slot grid, with regressors that share no noise with the friction.

The search uses every good sample in motion. Samples inside the dead band are kept, because effects near zero speed
appear only there. Samples at rest, where the sign of ω chatters, are excluded.

Raw dω/dt and current contain the same noise as a friction derived from them. Acceleration and motor torque are
therefore given to the effects as local least-squares estimates whose taps exclude the samples that may enter the
friction of that slot.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import comb
from typing import Any, Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import stats
from scipy.ndimage import binary_dilation, correlate1d, maximum_filter1d
from scipy.signal import savgol_filter

from rwa_monitor.discrepancy import alignment
from rwa_monitor.discrepancy.bench import WINDOW_SHARE, most_steps_per_sample, with_turns
from rwa_monitor.discrepancy.derived_friction import Motion, Steps, derived_friction, spread_of_differences, steps_of
from rwa_monitor.discrepancy.plausible import (
    MeasuredConstant,
    check_inertia,
    check_plausible,
    least_reported,
    measured_constants,
    without_end_stops,
)
from rwa_monitor.errors import InputError
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, TINY, BoolArray, FloatArray, IntArray, Samples, SlotGrid
from rwa_monitor.simulation.motion import wheel_angle
from rwa_monitor.wheel.effects.base import Channels
from rwa_monitor.wheel.effects.catalogue import effect_torque, mean_effects
from rwa_monitor.wheel.effects.tachometer import ReadZone, quantisation_step, read_zone
from rwa_monitor.wheel.file_content import rounded
from rwa_monitor.wheel.torque_balance import Source, half_width, motor_torque, source_of
from rwa_monitor.wheel.wheel import Limits, TemperatureRange, Wheel

MIN_REST_SLOTS: Final = 8  # a shorter stay near zero counts as a zero crossing
# Of the median speed: in a coarsely sampled record, neighbours differ by the motion and not by noise.
LARGEST_SPEED_NOISE: Final = 0.02
REST_BAND_IN_SPEED_NOISE: Final = 5.0  # below this many standard deviations of its noise the sign of ω is unknown
TEMPERATURE_MARGIN: Final = 0.1  # of a record's temperature range, by which its law may be extrapolated on either side
ROUNDING: Final = 1e-5  # of the RMS of a channel: anything smaller is rounding of the table, not sensor noise
SMOOTHER: Final = 0.5  # ratio of second differences, below which those of the speed are mostly noise
SMOOTHING_WIDTHS: Final = (5, 7, 11, 15, 21, 31, 41)  # slots that a parabola is fitted to, increasing
NEARLY_ALL: Final = 0.9  # of the square of dω/dt, for which slots are then used that miss no more than the rest
CORNER_CHANCE: Final = 1e-3  # probability that two straight lines of the speed are not recognised
FEWEST_FOR_JUMPS: Final = 200  # samples; with fewer, neither jumps nor a noise law are identifiable: none are tried
LOST_DIGITS: Final = 1e-12  # of the mean square of the speed: noise below it is lost in sums of squares
NEAR_CORNERS: Final = 0.5  # of the slots: a record with more of them near corners is not made of lines
SMOOTHING_REACH: Final = 6  # slots beyond the excluded ones, on each side, from which motion is estimated


@dataclass(frozen=True, slots=True)
class Record:
    """One record on the slot grid.

    Attributes
    ----------
    source
        Name of the recording, for messages.
    channels
        Motion as given to the effects, estimated from neighbours (see the module docstring); arrays (n,).
    friction_torque_Nm
        float64 (n,), measured resisting torque [N m], NaN where unknown.
    used
        bool (n,), slots that enter the search: finite friction and speed, in motion.
    friction_is_derived
        True where friction was derived from current and speed rather than given.
    speed_noise_rad_s
        Standard deviation of the speed channel's sample-to-sample noise [rad/s].
    accelerating_torque_Nm
        float64 (n,), motor torque minus friction [N m]: the part of K_T·I that is independent of the friction to be
        explained. None where there is no motor torque.
    angle_drift_rad
        float64 (n,), angle minus the integral of the measured speed [rad]; None where it is not observable.
    corrected
        bool (n,), slots where derived friction was corrected by more than its noise, so that the remaining error there
        is not noise; None where friction is given.
    derivative_slots, filter_error_Nm
        Width of the filter with which friction is derived, 0 where it is given; and the torque that this filter does
        not follow, see `DerivedFriction`.
    left_out
        Number of samples excluded from the search, by reason in words; reasons without samples are omitted.
    steps
        Quantisation steps of the channel that friction comes from; None where they have no consequence.
    friction_as_read_Nm
        Friction with its rounding, where it has been removed from `friction_torque_Nm` (see `quantisation`); else None.
    own_viscous_rad_s
        float64 (n,), the regressor of viscous friction, where the wheel's effects replace the speed by another one;
        None: the speed.
    measured_constants
        Constants of the wheel file as estimated from channels that are independent of friction.
    zone
        Dead zone of the speed readings; none of its samples is used.
    least_torque_Nm
        Smallest motor torque that is reported [N m], where one that reads zero is not known; None: all are.
    is_command
        Whether the friction channel is a command, and the speed the response to it: see `_is_command`.
    follows_noise
        Whether the friction may contain the noise of the speed: see `_noise_is_in_speed`.
    """

    source: str
    channels: Channels
    friction_torque_Nm: FloatArray
    used: BoolArray
    friction_is_derived: bool
    speed_noise_rad_s: float
    accelerating_torque_Nm: FloatArray | None = None
    angle_drift_rad: FloatArray | None = None
    corrected: BoolArray | None = None
    derivative_slots: int = 0
    filter_error_Nm: FloatArray | None = None
    left_out: Mapping[str, int] = field(default_factory=dict)
    steps: Steps | None = None
    friction_as_read_Nm: FloatArray | None = None
    own_viscous_rad_s: FloatArray | None = None
    measured_constants: tuple[MeasuredConstant, ...] = ()
    zone: ReadZone | None = None
    least_torque_Nm: float | None = None
    is_command: bool = False
    follows_noise: bool = True

    @property
    def viscous_speed_rad_s(self) -> FloatArray:
        """The regressor of viscous friction, float64 (n,) [rad/s]."""
        return self.channels.speed_rad_s if self.own_viscous_rad_s is None else self.own_viscous_rad_s

    @property
    def torque_step_Nm(self) -> float:
        """Return the quantisation step of the torque that friction comes from [N m], 0 where there is none."""
        return 0.0 if self.steps is None else self.steps.torque_Nm

    @property
    def undrifted(self) -> Channels:
        """Return the channels with the angle, corrected for its drift, as a measured one."""
        angle = self.channels.angle_rad
        if self.angle_drift_rad is not None:
            # The initial drift is subtracted: a constant of the angle, which begins at zero.
            angle = angle + self.angle_drift_rad - self.angle_drift_rad[0]
        return replace(self.channels, measured_angle_rad=angle)


def make_record(samples: Samples, wheel: Wheel, source: str, delay: alignment.Delay | None = None) -> Record:
    """Assign samples to the slot grid and derive what the search needs.

    Parameters
    ----------
    samples
        A sample table, time increasing.
    wheel
        Constants; friction is derived from current where it is not given.
    source
        Name for messages.
    delay
        Delay of the current, which is removed; None: there is none.

    Raises
    ------
    InputError
        If friction is neither given nor derivable, the record is far sparser than the wheel's sample period,
        values lie beyond the wheel's limits (wrong units), speed and torque imply an inertia in another unit, a
        measured angle does not follow the speed, or a channel is at its end stop most of the time.
    """
    measured = samples
    samples, slot, read, motion = _read(samples, wheel, source)
    samples = with_turns(samples, source)
    if motion.torque_Nm is not None:
        of_torque = "motor_current_A" if samples.motor_torque_Nm is None else "motor_torque_Nm"
        check_inertia(motion.speed_rad_s, motion.torque_Nm, wheel, source, of_torque)
    if delay is not None:
        motion = alignment.aligned(motion, wheel, delay.slots, delay.part)
    speed, torque, friction = motion.speed_rad_s, motion.torque_Nm, motion.friction_Nm
    derived, seen, follows_noise = friction is None, speed, True
    corrected = error = None
    if friction is None:
        assert torque is not None, "there is a source"
        known = derived_friction(speed, torque, wheel, motion.torque_step_Nm)
        friction, corrected, corners, error = known.friction_Nm, known.corrected, known.corners, known.filter_error_Nm
        hole, reach = half_width(wheel.friction.derivative, wheel.sample_period_s), SMOOTHING_REACH
    else:
        follows_noise = not _noise_is_in_speed(friction, speed)
        if not follows_noise:
            speed = _smoothed_speed(speed, friction)
            motion = replace(motion, speed_rad_s=speed)
        (hole, reach), corners = _fitting_reach(speed), 0

    at_corner = _corners(speed, hole + reach)
    noise = _speed_noise(speed)
    channels = _channels(samples, motion, slot, wheel, _slope(speed, hole, reach, at_corner))
    good, direction = channels.good & np.isfinite(friction), channels.direction
    moving = good & ~_at_rest(speed, noise, wheel.window.dead_band_rad_s) & (direction != 0)
    averaged = averages_over_reversals(speed, np.where(moving, direction * friction, np.nan), noise)
    # A dead zone of the readings hides the reversals from which averaging is recognised: it is then assumed.
    channels = replace(channels, averaged=bool(averaged.any()) or motion.zone is not None)
    used = moving & ~averaged
    if _count(used) >= FEWEST_FOR_JUMPS:  # with fewer no jumps are tried, which would explain the pulse of a corner
        if derived:  # the filter of dω/dt reaches the corner from all these
            at_corner = binary_dilation(at_corner, iterations=hole)
        corners += _count(used & at_corner)
        used &= ~at_corner
    why_not_used = {
        "in the dead zone of the speed reading": 0 if motion.zone is None else _count(motion.zone.inside),
        "at corners of the speed, where dω/dt is not known": corners,
        "at rest": _count(good & ~moving),
        "averaged over a reversal of the speed": _count(moving & averaged),
    }
    return Record(
        source=source,
        channels=channels,
        friction_torque_Nm=friction,
        used=used,
        friction_is_derived=derived,
        speed_noise_rad_s=noise,
        accelerating_torque_Nm=None if torque is None else _accelerating_torque(torque, friction, channels, wheel),
        corrected=corrected,
        derivative_slots=2 * hole + 1 if derived else 0,
        filter_error_Nm=error,
        left_out=_left_out(measured, samples, read, why_not_used, used),
        steps=motion.steps,
        measured_constants=measured_constants(samples, wheel),
        zone=motion.zone,
        least_torque_Nm=motion.least_torque_Nm,
        is_command=not derived and _is_command(friction, seen),
        follows_noise=follows_noise,
    )


def _is_command(friction_Nm: FloatArray, speed_rad_s: FloatArray) -> bool:
    """Return whether friction is mostly an exact ramp over time, to the last digit, while the speed is not.

    Such a channel is a duty cycle or a voltage in units of torque. A function of time would explain it without any
    error. Both arrays are float64 (n,).
    """
    bend, of_speed = (
        np.abs(np.diff(one, 2)) > ROUNDING * np.sqrt(np.nansum(one**2) / one.size) for one in (friction_Nm, speed_rad_s)
    )
    known = np.isfinite(np.diff(friction_Nm, 2) + np.diff(speed_rad_s, 2))
    ramp = known & ~bend & of_speed & (friction_Nm[2:] != friction_Nm[:-2])
    return 2 * _count(ramp) > _count(known)


def _noise_is_in_speed(friction_Nm: FloatArray, speed_rad_s: FloatArray) -> bool:
    """Return whether friction is far smoother than its viscous part, by the medians of |second differences|.

    The noise is then in the speed, as under a commanded voltage. Friction does not follow the speed from slot to slot,
    and a level that drifts as a random walk would be likelier than any law of the speed.
    """
    known = np.isfinite(friction_Nm) & np.isfinite(speed_rad_s)
    law = np.stack([np.sign(speed_rad_s[known]), speed_rad_s[known]], axis=1)
    slope = np.linalg.lstsq(law, friction_Nm[known])[0][1]
    bends, of_speed = (np.abs(np.diff(values, 2)) for values in (friction_Nm, slope * speed_rad_s))
    both = np.isfinite(bends) & np.isfinite(of_speed)
    return bool(both.any()) and float(np.median(bends[both])) < SMOOTHER * float(np.median(of_speed[both]))


def _smoothed_speed(speed_rad_s: FloatArray, friction_Nm: FloatArray) -> FloatArray:
    """Return the speed, float64 (n,), smoothed until friction is no longer far smoother (`_noise_is_in_speed`).

    Noise of a regressor biases every slope towards zero (errors in variables) and favours effects that smooth it, such
    as a lag. Second differences of noise alternate in sign; where those of the speed do not, it is returned unchanged.
    Parabolas are fitted over increasing widths. Slots near a change of direction keep their values.
    """
    bend = np.diff(speed_rad_s, 2)
    if np.nansum(bend[1:] * bend[:-1]) >= 0.0:
        return speed_rad_s
    sign, smoothed = np.sign(speed_rad_s), speed_rad_s
    turns = np.diff(np.nan_to_num(sign), append=0.0) != 0.0
    for width in SMOOTHING_WIDTHS:
        if width > WINDOW_SHARE * speed_rad_s.size or not _noise_is_in_speed(friction_Nm, smoothed):
            break
        smooth = savgol_filter(_without_gaps(speed_rad_s), width, 2)
        near_reversal = binary_dilation(turns, iterations=width // 2 + 1) | (np.sign(smooth) != sign)
        smoothed = np.where(near_reversal, speed_rad_s, smooth)
    return smoothed


def without_known_effects(record: Record, wheel: Wheel) -> Record:
    """Subtract the torque of the wheel's own effects; those that scale viscous friction change its regressor."""
    effects = mean_effects(wheel)
    if not effects:
        return record
    viscous = wheel.nominal.viscous_Nm_s_rad if wheel.nominal else 0.0
    torque, viscous_speed, _ = effect_torque(
        effects, record.channels, record.friction_torque_Nm, viscous, [None] * len(effects)
    )
    own = np.where(np.isfinite(viscous_speed), viscous_speed, record.channels.speed_rad_s)
    friction = record.friction_torque_Nm - np.nan_to_num(torque)
    return replace(record, friction_torque_Nm=friction, own_viscous_rad_s=own)


def temperature_range(records: Sequence[Record]) -> TemperatureRange | None:
    """Return the range of bearing temperatures of the used samples, extended by a tenth on either side [°C].

    Within it a fitted law may be extrapolated with little error. None where a record has no temperature.
    """
    seen = [record.channels.bearing_temperature_degC for record in records]
    known = [values[record.used] for values, record in zip(seen, records, strict=True) if values is not None]
    if len(known) < len(seen):
        return None
    low, high = (float(of(np.concatenate(known))) for of in (np.nanmin, np.nanmax))
    beyond = TEMPERATURE_MARGIN * (high - low)
    return TemperatureRange(low_degC=round(low - beyond, 2), high_degC=round(high + beyond, 2))


def limits_of(wheel: Wheel, records: Sequence[Record]) -> Limits:
    """Return the limits of the wheel, with the smallest current that its drive reports, where the records show it."""
    least = [record.least_torque_Nm for record in records if record.least_torque_Nm is not None]
    if not least or wheel.torque_per_ampere_Nm_A is None:
        return wheel.limits
    return wheel.limits.model_copy(update={"min_current_A": rounded(min(least) / wheel.torque_per_ampere_Nm_A, 3)})


def _channels(samples: Samples, motion: Motion, slot: IntArray, wheel: Wheel, slope: FloatArray) -> Channels:
    """Return the motion as given to the effects; `slope` of the speed per slot, float64 (n,)."""
    speed, torque = motion.speed_rad_s, motion.torque_Nm
    good = np.isfinite(speed)  # as in diagnosis: an effect with a memory follows the wheel where friction is not known
    turned = wheel_angle(_without_gaps(speed), wheel.sample_period_s)
    turned = turned - turned[np.argmax(good)]  # an effect counts it from there
    measured = _measured_angle(_on_grid(samples.angle_rad, slot), turned)
    return Channels(
        time_s=np.arange(speed.size, dtype=np.float64) * wheel.sample_period_s,
        speed_rad_s=speed,
        direction=np.sign(speed),
        acceleration_rad_s2=slope / wheel.sample_period_s,
        angle_rad=turned if measured is None else measured,
        motor_torque_Nm=None if torque is None else _from_neighbours(torque, 0),
        bearing_temperature_degC=_smoothed_slow_channel(_on_grid(samples.bearing_temperature_degC, slot)),
        sample_period_s=wheel.sample_period_s,
        good=good,
        motor_torque_rate_Nm_s=(None if torque is None else _from_neighbours(torque, 1) / wheel.sample_period_s),
        acceleration_rate_rad_s3=_bend(speed, slope) / wheel.sample_period_s**2 if torque is None else None,
        measured_angle_rad=measured,
        bus_voltage_V=_smoothed_slow_channel(_on_grid(samples.bus_voltage_V, slot)),
    )


def _measured_angle(angle: FloatArray | None, turned: FloatArray) -> FloatArray | None:
    """Return the measured angle on every slot [rad], interpolated along the integral of the speed.

    Parameters
    ----------
    angle, turned
        float64 (n,), the measured angle, NaN where unknown, and the integral of the speed [rad].
    """
    if angle is None or not np.isfinite(angle).any():
        return None
    return turned + _without_gaps(angle - turned)


def left_out_in_words(records: Sequence[Record]) -> str:
    """Return a text of how many samples are excluded from the search, and why; "" where none is."""
    total = sum((Counter(record.left_out) for record in records), Counter[str]())
    return "left out: " + ", ".join(f"{count} {why}" for why, count in total.items()) if total else ""


def _left_out(
    measured: Samples, without_stops: Samples, read: Source, known_why: dict[str, int], used: BoolArray
) -> dict[str, int]:
    """Count the samples that are not used, by reason; those without another reason lack a derivative.

    `read` is the channel that friction comes from.
    """
    before, after = (
        np.isfinite(samples.speed_rad_s) & np.isfinite(getattr(samples, read)) for samples in (measured, without_stops)
    )
    underivable = _count(after) - _count(used) - sum(known_why.values())
    reasons = {
        "without a value of speed or torque": _count(~before),
        "at the end stop or in the dead zone of a channel": _count(before & ~after),
        **known_why,
        "beside gaps and ends, where friction cannot be derived": underivable,
    }
    return {why: count for why, count in reasons.items() if count}


def _count(samples: BoolArray) -> int:
    return int(np.count_nonzero(samples))


def motions_of(recordings: Sequence[tuple[str, Samples]], wheel: Wheel) -> list[Motion]:
    """Return the measured motion of each recording of a wheel, on its slots.

    Raises
    ------
    InputError
        As `make_record` does.
    """
    return [_read(samples, wheel, source)[-1] for source, samples in recordings]


def _read(samples: Samples, wheel: Wheel, source: str) -> tuple[Samples, IntArray, Source, Motion]:
    """Return the samples less end stops and dead zones, their slots, the channel that friction comes from, the motion.

    The speed is NaN in a dead zone of its readings.
    """
    check_plausible(samples, wheel, source)
    samples = without_end_stops(samples, source)
    slot, read = _slots_of(samples, wheel, source), source_of(samples, wheel, source)
    speed = _on_grid(samples.speed_rad_s, slot)
    assert speed is not None
    zone = read_zone(speed, quantisation_step(speed[np.isfinite(speed)]) or 0.0)
    if zone is not None:
        speed = np.where(zone.inside, np.nan, speed)
    torque = _on_grid(motor_torque(samples, wheel), slot)
    least, steps = None, steps_of(samples, wheel, read)
    if torque is not None and read != "friction_torque_Nm" and (least := least_reported(torque, speed, wheel)):
        unknown: dict[str, Any] = {read: np.where(getattr(samples, read) == 0.0, np.nan, getattr(samples, read))}
        samples = replace(samples, **unknown)
        torque[torque == 0.0] = np.nan
    motion = Motion(speed, torque, _on_grid(samples.friction_torque_Nm, slot), steps, zone, least)
    return samples, slot, read, motion


def _on_grid(values: FloatArray | None, slot: IntArray) -> FloatArray | None:
    if values is None:
        return None
    placed = np.full(int(slot[-1]) + 1, np.nan)
    placed[slot] = values
    return placed


def _slots_of(samples: Samples, wheel: Wheel, source: str) -> IntArray:
    """Return the slot of each sample, int64 (n,), from 0; InputError if the record is far too sparse."""
    slot = SlotGrid(int(samples.time_ns[0]), wheel.period_ns).slot_of(samples.time_ns)
    count = int(slot[-1]) + 1
    step_ns = float(np.median(np.diff(samples.time_ns, prepend=samples.time_ns[0])))
    slots_per_step = max(step_ns / wheel.period_ns, 1.0)  # another recording may have shorter steps
    if count > most_steps_per_sample(samples) * len(samples) * slots_per_step:
        raise InputError(
            source,
            f"{len(samples)} samples span {count} slots of {wheel.sample_period_s} s: most of the recording is missing;"
            f" the median step of the table is {step_ns / NANOSECONDS_PER_SECOND:.4g} s",
            "time",
        )
    return slot


def _accelerating_torque(torque: FloatArray, friction: FloatArray, channels: Channels, wheel: Wheel) -> FloatArray:
    """Return the accelerating torque [N m]: J·dω/dt, or motor torque minus friction where the inertia is unknown."""
    if wheel.inertia_kg_m2 is None:
        return _from_neighbours(torque - friction, 0)
    return wheel.inertia_kg_m2 * channels.acceleration_rad_s2


def _fitting_reach(speed: FloatArray) -> tuple[int, int]:
    """Return over which slots dω/dt is estimated where friction is given: how many it skips, and how many follow.

    In strokes of a few slots nothing is left of it over the usual ones; then it is estimated from the nearest, whose
    noise friction may share.
    """
    usual, known = (min(2, speed.size // 8), SMOOTHING_REACH), np.isfinite(speed)
    if not usual[0] or not known.any():
        return usual
    noise = _noise_of_differences(speed)
    nearest = _from_neighbours(speed, 1, reach=1)
    power = float(np.mean(nearest[known] ** 2)) - noise / 2

    def missed(hole: int, reach: int) -> float:
        """Return the share of the square of dω/dt that its estimate from these slots misses."""
        off = _from_neighbours(speed, 1, hole, reach) - nearest
        own = noise / (2 * sum(j * j for j in range(hole + 1, hole + reach + 1)))
        return (float(np.mean(off[known] ** 2)) - noise / 2 + (-own if hole else own)) / power

    if power <= noise / 2 or missed(*usual) < NEARLY_ALL:
        return usual
    return 0, next(reach for reach in (3, 2, 1) if missed(0, reach) < 1 - NEARLY_ALL)


def _noise_of_differences(values: FloatArray) -> float:
    """Return the variance of the noise of values, float64 (n,), from their differences: motion only adds to these."""
    whole = _without_gaps(values)
    return min(float(np.mean(np.diff(whole, k) ** 2)) / comb(2 * k, k) for k in range(2, 7))


def _from_neighbours(values: FloatArray, order: int, hole: int = 0, reach: int = SMOOTHING_REACH) -> FloatArray:
    """Estimate value (order 0) or slope per slot (order 1) at each slot from slots hole+1 … hole+reach on both sides.

    Symmetric least squares: the mean, or Σ j v_j / Σ j². Gaps are interpolated linearly; beyond the ends the nearest
    value is held.
    """
    j = np.arange(-(hole + reach), hole + reach + 1)
    outside = np.abs(j) > hole
    basis = np.where(outside, j**order, 0).astype(np.float64)
    estimate: FloatArray = correlate1d(_without_gaps(values), basis / np.sum(basis**2), mode="nearest")
    return estimate


def _slope(speed: FloatArray, hole: int, reach: int, corners: BoolArray) -> FloatArray:
    """Return the slope of the speed per slot from `reach` slots beyond `hole` ones on each side, float64 (n,).

    From one side alone where a corner, bool (n,), or an end lies on the other.
    """
    slope, far = _from_neighbours(speed, 1, hole, reach), hole + reach
    if not corners.any():
        return slope
    rise = np.zeros(2 * far + 1)  # weights of the slope of the slots after one
    rise[far + hole + 1 :] = np.arange(reach) - (reach - 1) / 2
    rise /= np.sum(rise**2)
    after, before = (correlate1d(_without_gaps(speed), of, mode="nearest") for of in (rise, -rise[::-1]))
    ahead, behind = (
        sliding_window_view(np.pad(corners, ends, constant_values=True), far + 1).any(axis=1)
        for ends in ((0, far), (far, 0))
    )
    slope = np.where(ahead & ~behind, before, slope)
    return np.where(behind & ~ahead, after, slope)


def _bend(speed: FloatArray, slope: FloatArray) -> FloatArray:
    """Return the second derivative of the speed per slot², float64 (n,).

    From the slope per slot, in which there is little noise; where that misses more of the motion than twice what noise
    would differ by, from the two slots on each side, NaN where one of them is unknown. The slot itself is left out:
    a controller answers its noise with a torque.
    """
    weights = np.array([1.0, -1.0, 0.0, -1.0, 1.0]) / 3.0
    nearest: FloatArray = correlate1d(speed, weights, mode="constant", cval=np.nan)
    usual, known = np.gradient(slope), np.isfinite(nearest)
    noise = weights @ weights * _noise_of_differences(speed)
    missed = float(np.sum((nearest - usual) ** 2, where=known))
    return nearest if missed > 2.0 * noise * _count(known) else usual


def _corners(speed: FloatArray, reach: int) -> BoolArray:
    """Return the slots where the speed changes from one line to another within `reach` slots each way, bool (n,).

    Two lines fit these slots within the noise, and one parabola, as for a smooth motion, does not. None where corners
    are so dense that few slots have a line beside them.
    """
    width = 2 * reach + 1
    if speed.size < width or reach < SMOOTHING_REACH or not np.isfinite(speed).any():
        return np.zeros(speed.size, dtype=np.bool_)
    speed = speed - np.nanmean(speed)  # sums of squares then lose fewer digits

    def missed(first: int, last: int, degree: int) -> FloatArray:
        """Return by how much a polynomial misses the slots from `first` to `last` beside each, a sum of squares."""
        at, weights = np.arange(first, last + 1), np.zeros((degree + 2, width))
        weights[0, at + reach] = 1.0
        weights[1:, at + reach] = np.linalg.qr(np.vander(at, degree + 1))[0].T
        squares, *parts = (
            correlate1d(speed if i else speed**2, weights[i], mode="constant", cval=np.nan) for i in range(degree + 2)
        )
        return np.asarray(squares - np.sum(np.square(parts), axis=0))

    by_lines = missed(-reach, -1, 1) + missed(1, reach, 1)
    noise = max(_noise_of_differences(speed), LOST_DIGITS * float(np.nanmean(speed**2)))
    most = stats.chi2.isf(CORNER_CHANCE, 2 * (reach - 2)) * noise
    is_corner = (by_lines <= most) & (missed(-reach, reach, 2) > by_lines + most)
    gain = np.where(is_corner, missed(-reach, reach, 1) - by_lines, 0.0)
    is_corner &= gain == maximum_filter1d(gain, width)
    return is_corner & (_count(is_corner) * width < NEAR_CORNERS * speed.size)


def _without_gaps(values: FloatArray) -> FloatArray:
    """Interpolate unknown values linearly, holding the ends, for filters that need a value in every slot."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    at = np.arange(values.size)
    return np.interp(at, at[known], values[known])


def _smoothed_slow_channel(values: FloatArray | None) -> FloatArray | None:
    """Average a slow channel over neighbouring slots; None where it is missing or has no values."""
    if values is None or not np.isfinite(values).any():
        return None
    return _from_neighbours(values, 0)


def _speed_noise(speed: FloatArray) -> float:
    """Return the standard deviation of the speed channel's noise [rad/s]."""
    # Of neighbours only: across a gap they contain the motion. var(v₀ - 2v₁ + v₂) = 6σ².
    noise = spread_of_differences(np.diff(speed), 1, 0.0) / np.sqrt(6.0)
    return min(noise, LARGEST_SPEED_NOISE * float(np.nanmedian(np.abs(speed)))) if np.isfinite(noise) else 0.0


def _at_rest(speed: FloatArray, noise: float, dead_band: float | None) -> BoolArray:
    """Return the slots at rest: ω within its noise, or a long stay near zero with sign changes and without a trend."""
    meaningless = REST_BAND_IN_SPEED_NOISE * noise
    band = max(meaningless, quantisation_step(speed[np.isfinite(speed)]) or 0.0, dead_band or 0.0)
    rest: BoolArray = np.abs(speed) <= meaningless
    edges = np.flatnonzero(np.diff(np.abs(speed) <= band, prepend=False, append=False))
    for begin, end in edges.reshape(-1, 2):
        stay = speed[begin:end]
        half = MIN_REST_SLOTS // 2
        changes = np.count_nonzero(np.diff(np.sign(stay)))
        if stay.size >= MIN_REST_SLOTS and changes >= 3 and abs(np.mean(stay[-half:]) - np.mean(stay[:half])) < band:
            rest[begin:end] = True
    return rest


# ---- samples that are means over their interval, where the speed reverses within it ----------------------------------
# Telemetry may be averaged on board. Dry friction changes sign with the speed, so its mean over an interval with a
# reversal lies anywhere between both signs. A handful of such samples, tens of standard deviations off, is mistaken for
# a dead zone, for bristles or for an unknown law of speed. Averaging is recognised at the reversals of the record: the
# speed determines the mean of its sign over each interval, which predicts the sample.


LEVEL_REACH: Final = 8  # samples on each side of a reversal from which its dry friction is estimated
SIGN_STDS: Final = 3.0  # standard deviations of the speed's noise within which its sign is unknown
REVERSAL_MEAN_SIGN: Final = 0.98  # mean sign over an interval, below which the interval contains a reversal
# Largest misfit of samples as means, relative to that of samples as points, over intervals with a reversal: for centred
# intervals, then for those that end or begin at their sample, which a delay of half a slot or bristles mimic.
MISFIT_RATIOS: Final = (0.7, 0.4, 0.4)


def averages_over_reversals(speed_rad_s: FloatArray, drag_Nm: FloatArray, noise_rad_s: float = 0.0) -> BoolArray:
    """Return the samples that are means over an interval in which the speed reverses; none where samples are points.

    Intervals centred on, ending at, and beginning at their sample are tried. The one that predicts the samples best is
    taken, if it does so clearly better than samples at points in time.

    Parameters
    ----------
    speed_rad_s
        float64 (n,), on slots, NaN where unknown.
    drag_Nm
        float64 (n,), friction along the rotation; NaN where unknown.
    noise_rad_s
        Standard deviation of the speed's noise [rad/s], by which the detection of reversals is widened.
    """
    averaged = np.zeros(speed_rad_s.size, dtype=np.bool_)
    sign = np.sign(speed_rad_s)
    turning = np.flatnonzero(sign[1:] * sign[:-1] < 0)
    around = np.unique(np.clip(turning[:, None] + np.arange(-1, 3), 1, max(sign.size - 2, 1)))
    around = around[np.isfinite(drag_Nm[around])]
    if around.size == 0:
        return averaged
    # The dry friction around each reversal; most samples there contain none, so the median is not affected.
    near = sliding_window_view(np.pad(drag_Nm, LEVEL_REACH, constant_values=np.nan), 2 * LEVEL_REACH + 1)
    level = np.nanmedian(near[around], axis=1)
    along, *shifted = (
        _mean_signs(speed_rad_s + shift)[:, around] * sign[around]
        for shift in np.array([0.0, -SIGN_STDS, SIGN_STDS]) * noise_rad_s
    )
    straddles = along < REVERSAL_MEAN_SIGN  # False where the interval reaches beyond the record (NaN)
    point_misfit = np.broadcast_to(np.abs(drag_Nm[around] - level), along.shape)
    means, points = (
        np.sum(missed, axis=1, where=straddles) for missed in (np.abs(drag_Nm[around] - level * along), point_misfit)
    )
    left = np.where(points > 0.0, means / np.maximum(points, TINY), np.inf) / MISFIT_RATIOS
    best = int(np.argmin(left))
    if left[best] < 1.0:
        averaged[around[np.min(shifted, axis=0)[best] < REVERSAL_MEAN_SIGN]] = True
    return averaged


def _mean_signs(speed_rad_s: FloatArray) -> FloatArray:
    """Return the mean sign of the linearly interpolated speed over intervals of one slot, float64 (3, n).

    The intervals are centred on, end at, or begin at their samples; NaN where they reach beyond the record.
    """
    halfway = np.linspace(speed_rad_s[:-1], speed_rad_s[1:], 3)
    change = np.diff(halfway, axis=0)
    rise = np.diff(np.abs(halfway), axis=0)
    first, last = np.where(change == 0.0, np.sign(halfway[:-1]), rise / np.where(change == 0.0, 1.0, change))
    before, after = np.append(np.nan, last), np.append(first, np.nan)
    whole = 0.5 * (first + last)
    return np.stack([0.5 * (before + after), np.append(np.nan, whole), np.append(whole, np.nan)])
