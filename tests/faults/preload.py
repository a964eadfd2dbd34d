"""Imported once by the server that the processes of a history are forked from: everything that takes time to load."""

from __future__ import annotations

from rwa_monitor.live.rebuild import Setup
from rwa_monitor.live.warm_up import warm_up
from rwa_monitor.live.wheel_set import WheelSet
from tests.faults.history import wheel
from tests.live.support import model

warm_up(Setup(WheelSet(wheel()), model(), "joint"))
