"""Samples: one struct of arrays."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.samples import TABLE_CHANNELS, Samples, concatenate


def samples(n=10, **channels):
    return Samples(time_ns=np.arange(n), speed_rad_s=np.arange(n) / 2, **channels)


def test_every_channel_gets_its_one_type():
    found = Samples(time_ns=[1, 2], speed_rad_s=[1, 2], motor_current_A=np.array([1, 2], dtype=np.float32)[::1])
    assert found.time_ns.dtype == np.int64
    assert found.speed_rad_s.dtype == found.motor_current_A.dtype == np.float64
    assert found.time_ns.flags.c_contiguous
    assert len(found) == 2


@pytest.mark.parametrize("name", TABLE_CHANNELS)
def test_arrays_of_unequal_length_are_refused(name):
    with pytest.raises(InputError, match=f"samples: {name}: has shape"):
        Samples(**{"time_ns": np.arange(3), "speed_rad_s": np.zeros(3), name: np.zeros(4)})
    with pytest.raises(InputError, match=f"samples: {name}: has shape"):
        Samples(**{"time_ns": np.arange(4), "speed_rad_s": np.zeros(4), name: np.zeros((2, 2))})


def test_selecting_takes_all_channels_alike():
    found = samples(motor_voltage_V=np.arange(10) * 3.0)
    for selection in (slice(2, 5), np.array([7, 1]), np.arange(10) % 2 == 0):
        part = found[selection]
        assert np.array_equal(part.time_ns, found.time_ns[selection])
        assert np.array_equal(part.motor_voltage_V, found.motor_voltage_V[selection])
        assert part.motor_current_A is None


def test_channels_present_in_order():
    found = samples(bearing_temperature_degC=np.zeros(10), friction_torque_Nm=np.zeros(10))
    assert [name for name, _ in found.channels()] == [
        "time_ns",
        "speed_rad_s",
        "friction_torque_Nm",
        "bearing_temperature_degC",
    ]
    assert [field.name for field in dataclasses.fields(Samples)] == ["time_ns", *TABLE_CHANNELS]


def test_cut_and_joined_is_the_same():
    found = samples(friction_torque_Nm=np.linspace(0, 1, 10))
    joined = concatenate([found[:4], found[4:4], found[4:]])
    for (name, a), (_, b) in zip(found.channels(), joined.channels(), strict=True):
        assert np.array_equal(a, b), name


def test_joining_what_does_not_fit_is_refused():
    with pytest.raises(InputError, match="nothing to join"):
        concatenate([])
    with pytest.raises(InputError, match=r"motor_current_A: is present in some parts"):
        concatenate([samples(), samples(motor_current_A=np.zeros(10))])
