from rwa_monitor.samples import FloatArray

def bridge(speed: FloatArray, result: FloatArray, half: int, period_s: float, max_variance_ratio: float) -> None:
    """Fill in the derivative `result` over gaps: see `wheel.torque_balance.differentiate_over_gaps`."""

def rounding_error(
    speed: FloatArray,
    torque: FloatArray,
    weights: FloatArray,
    per_torque: float,
    noise_gain: float,
    least_Nm: float,
    least_share: float,
    reach: int,
    noise_slots: int,
    masks: bool,
    error: FloatArray,
) -> None:
    """Set `error`, zeros, as `wheel.torque_balance.rounding_error` returns it.

    Parameters
    ----------
    speed, torque
        float64 (n,) [rad/s, N m], NaN where missing.
    weights
        float64 (half,), of the mean acceleration between a slot and the next, from the middle of the stencil on.
    per_torque
        Change of speed in a slot per torque [rad/s/(N m)].
    noise_gain
        Standard deviation of the derived friction per that of the speed.
    least_Nm, least_share
        Smaller errors are ignored: least_Nm or, where that is NaN, least_share of the friction there.
    reach, noise_slots
        Slots to either side in which the speed must bend, and before, from which the torque's noise is estimated.
    masks
        Whether each error is NaN, and the gaps between errors within a bend.
    """
