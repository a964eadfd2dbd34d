"""Numbers as engineers write them."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.reporting.discrepancy_report import PREFIXES, in_words, measure, probability
from rwa_monitor.wheel.effects.catalogue import CATALOGUE


@pytest.mark.parametrize(
    ("value", "std", "unit", "written"),
    [
        (5.003e-4, 7.9e-7, "N m", "500.30 ± 0.79 µN m"),
        (9.164, 1.02, "N m", "9.2 ± 1.0 N m"),
        (3.992e-9, 2.5e-11, "N m s²/rad²", "3.992 ± 0.025 nN m s²/rad²"),
        (8.014, None, "rad/s", "8.014 rad/s"),
        (2.0, None, "-", "2"),
        (2.775e-5, None, "s/rad", "2.775·10⁻⁵ s/rad"),
        (3.341e-3, None, "s", "3.341 ms"),
        (1.372e-6, 3e-8, "kg m²", "(1.372 ± 0.030)·10⁻⁶ kg m²"),
        (-0.04, 0.001, "1/K", "-0.0400 ± 0.0010 1/K"),
        (0.0, None, "N m", "0 N m"),
        (float("nan"), None, "N m", "–"),
    ],
)
def test_values(value: float, std: float | None, unit: str, written: str) -> None:
    assert measure(value, std, unit) == written


@given(value=st.floats(1e-11, 1e7), relative=st.floats(1e-4, 0.5))
def test_what_is_written_is_the_value_to_within_its_error(value: float, relative: float) -> None:
    written = re.fullmatch(r"([\d.]+) ± ([\d.]+) (\D?)N m", measure(value, relative * value, "N m"))
    power = next(power for power, prefix in PREFIXES.items() if prefix == written[3])
    assert float(written[1]) * 10.0**power == pytest.approx(value, abs=0.1 * relative * value)
    assert float(written[2]) * 10.0**power == pytest.approx(relative * value, rel=0.06)


def test_probabilities() -> None:
    assert [probability(p) for p in (0.0, 2.8e-4, 0.51)] == ["< 10⁻¹⁶", "2.8·10⁻⁴", "0.51"]


def test_no_parameter_of_the_catalogue_keeps_its_unit_in_its_words() -> None:
    for effect in CATALOGUE.values():
        for parameter in effect.parameters:
            words = in_words(parameter.name, parameter.unit)
            assert not re.search(r"_|Nm|rad s|\bs2\b", words), (parameter.name, words)
    assert in_words("stribeck_speed_rad_s", "rad/s") == "Stribeck speed"
