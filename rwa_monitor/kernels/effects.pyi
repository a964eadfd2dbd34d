"""Effects with memory: recursions slot by slot, so that a record evaluated in pieces gives the same bits.

`state` is carried from piece to piece and changed in place. At a slot that is not usable, the state is held, as if no
time had passed, and the next usable slot continues from it. `values` and `speed_rad_s` are float64 (n,), `usable` is
bool (n,), results are float64 (n,).
"""

from rwa_monitor.samples import BoolArray, FloatArray

def dahl_bristle(
    speed_rad_s: FloatArray, usable: BoolArray, period_s: float, scale_rad: float, state: FloatArray
) -> FloatArray:
    """Integrate Dahl's bristle dz/dt = ω - |ω| z / z_c by its exact step in angle; ω is linear between slots.

    Explicit Euler steps would be unstable where the wheel turns by more than 2 z_c in a slot, as it does except near
    zero speed. In angle the solution is an exponential, and a slot in which ω changes sign has two. `scale_rad` is z_c;
    `state` is z/z_c and the last ω, NaN at the start, when the bristle is taken as fully deflected. Returns z/z_c in
    [-1, 1], NaN before the first usable slot.
    """

def first_order_lag(
    values: FloatArray, usable: BoolArray, period_s: float, time_constant_s: float, state: FloatArray
) -> FloatArray:
    """Filter `values` u by a first-order lag, dx/dt = (u - x)/τ, exact for values that are linear between slots.

    At the start of a record x equals u (steady state). `state` is x and the last u, NaN at the start. Returns x, NaN
    before the first usable slot.
    """

def time_since(
    values: FloatArray, usable: BoolArray, period_s: float, threshold: float, state: FloatArray
) -> FloatArray:
    """Return the time since |value| was above a threshold [s]; `state` is that time, infinite at the start."""

def forward(
    squares: FloatArray,
    inside: BoolArray,
    contrasts: int,
    quiet: float,
    shaking: float,
    freedom: float,
    on: float,
    off: float,
    probability: FloatArray,
) -> float:
    """Return the log-likelihood of bursts up to a constant; write each block's probability of a burst given the past.

    `squares`, one for each block, are sums over so many `contrasts`, NaN where a block is not used; `quiet` and
    `shaking` are logarithms of scales. Outside the band both states have the same density, and the chain continues
    without observations.
    """

def smooth(probability: FloatArray, on: float, off: float) -> None:
    """Turn probabilities given the past, in place, into those given the whole record (backward recursion)."""
