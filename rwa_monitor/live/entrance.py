"""The short way in for what nearly every message is: the next slots of a wheel, every value there, nothing strange.

    order guard → ring buffer → screen

in one call of compiled code: calls one by one cost as much as the work on a message of 256 samples. Each step decides
as it does for samples that go the long way, which is for all the others.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from rwa_monitor.live.order_guard import PIECE_SLOTS, OrderGuard, all_follow, all_within, can_be_telemetry
from rwa_monitor.live.ring_buffer import RingBuffer, fill, put
from rwa_monitor.live.screen import Screen, pass_next
from rwa_monitor.samples import FloatArray, IntArray, Samples

# What became of the samples:
NOT_TAKEN: Final = 0
TAKEN: Final = 1  # but not screened: something was found
SCREENED: Final = 2


def enter(samples: Samples, guard: OrderGuard, ring: RingBuffer, screen: Screen) -> bool:
    """Take a message into the ring buffer if it can go the short way.

    Parameters
    ----------
    samples
        Of a wheel whose ring buffer holds speed and friction as they were measured, and nothing else.
    guard, ring, screen
        Of the wheel.

    Returns
    -------
    bool
        False: nothing was changed or counted, the samples have to go the long way. True: the guard has counted them,
        the ring buffer holds them, and the screen has judged them, all but the last; where it finds something, it has
        not moved, and masks when it is run.
    """
    torque, count, end = samples.friction_torque_Nm, samples.time_ns.size, ring.end
    if guard.grid is None or torque is None or not 0 < count <= PIECE_SLOTS:
        return False
    if guard.frontier != end or screen.done != end - 1 or not guard.others_can_be(samples):
        return False
    found: int = _enter(
        (samples.time_ns, samples.speed_rad_s, torque),
        (guard.speed_limit_rad_s, guard.friction_limit_Nm, guard.grid.origin_ns, guard.grid.period_ns),
        (end, ring.filled, ring.speed_rad_s, ring.torque_Nm),
        (screen.speed_limit_rad_s, screen.speed.state),
        (screen.torque_limit_Nm, screen.torque.state),
    )
    if found == NOT_TAKEN:
        return False
    guard.count_next(samples.time_ns)
    ring.end = end + count
    if found == SCREENED:
        screen.done += count
    return True


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _enter(
    batch: tuple[IntArray, FloatArray, FloatArray],
    order: tuple[float, float, int, int],
    ring: tuple[int, NDArray[np.uint8], FloatArray, FloatArray],
    speed_screen: tuple[float, FloatArray],
    torque_screen: tuple[float, FloatArray],
) -> int:
    """Do the work of `enter`, and return what became of the samples.

    Parameters
    ----------
    batch
        Time, speed and friction.
    order
        Limits of speed and friction, origin and period of the grid.
    ring
        End and arrays of the ring buffer.
    speed_screen, torque_screen
        Limit and state of the two channels, as for `Channel.judge`.
    """
    time_ns, speed, torque = batch
    highest_speed, highest_torque, origin_ns, period_ns = order
    end, filled, held_speed, held_torque = ring
    (speed_limit, speed_state), (torque_limit, torque_state) = speed_screen, torque_screen
    if not (can_be_telemetry(time_ns, speed, highest_speed) and all_within(torque, highest_torque)):
        return NOT_TAKEN
    if not all_follow(time_ns, end, origin_ns, period_ns):
        return NOT_TAKEN
    newest = (end - 1) % held_speed.size
    last_speed, last_torque = held_speed[newest], held_torque[newest]
    fill(filled, end, time_ns.size)
    put(held_speed, end, speed)
    put(held_torque, end, torque)
    judged = np.empty((2, speed_state.size))
    if not pass_next(last_speed, speed, speed_limit, speed_state, judged[0]):
        return TAKEN
    if not pass_next(last_torque, torque, torque_limit, torque_state, judged[1]):
        return TAKEN
    speed_state[:], torque_state[:] = judged[0], judged[1]
    return SCREENED
