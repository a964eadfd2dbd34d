"""Imported once by the server that the processes of a history are forked from: all modules that are slow to load."""

from rwa_monitor.monitor.core import diagnose_samples
from tests.monitor.support import WINDOW, model, telemetry, wheel

list(diagnose_samples(telemetry(WINDOW), wheel(), model()))
