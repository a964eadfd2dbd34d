"""Training: labelled windows in, a model out. Deterministic: the same windows give the same model.

The bands of nominal and anomalous values are fitted in closed form, with strays left out.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.model import AnomalyModel, Band, Levels, Model, Provenance
from rwa_monitor.errors import InputError
from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.wheel import RESERVED_ANOMALIES, Wheel

MIN_WINDOWS: Final = 2  # of each class, below which an anomaly is not learned
# No band is less soft than this share of the distance between nominal and anomalous: nominal values scatter far less in
# a data set than on a wheel in orbit.
MIN_SOFT: Final = 0.05
MIN_SOFT_SYSTEM: Final = 0.02  # the same for a system's friction, whose band has a width of its own
STRAYS: Final = (0.002, 0.2)  # share of strays: least assumed, largest accepted
SHARP_STD: Final = 0.1  # of the distance between nominal and anomalous: measured well enough to fit a band
STRAY_FENCE: Final = 2.5  # quartile distances beyond the quartiles: four standard deviations of a Gaussian
# Where no anomaly was seen in training, the scale of other values, as a share of the nominal middle.
REACH_UNSEEN: Final = 0.3
UNDECIDED: Final = (0.4, 0.6)  # probabilities of an anomaly between which a window is inconclusive
# Windows added to each class, and to each number of simultaneous anomalies: what was not seen is not impossible. A
# wheel can have two anomalies at once even where no training window has.
PSEUDO_WINDOWS: Final = 1.0
PSEUDO_SHARE: Final = 0.01  # of the training windows, on top, for each number of simultaneous anomalies


class LabelledFeatures(NamedTuple):
    """One window's features, and for each anomaly whether it is there."""

    features: Features
    labels: Mapping[str, bool]


def train(windows: Sequence[LabelledFeatures], wheel: Wheel, source: str, command: str) -> Model:
    """Learn a model.

    Parameters
    ----------
    windows
        Features and labels of the training windows.
    wheel
        Whose windows they are; names the anomalies.
    source
        Where the windows come from: a recipe with its seed, a label file's name.
    command
        The command that trains this model again.

    Raises
    ------
    InputError
        If a label is missing, or no window is without anomalies of a kind (then nothing nominal can be learned).
    """
    names = wheel.anomalies
    labels = {}
    for name in names:
        if any(name not in window.labels for window in windows):
            raise InputError(source, "has no label for this anomaly of the wheel", name)
        labels[name] = np.array([window.labels[name] for window in windows], dtype=bool)
        if not (~labels[name]).any():
            raise InputError(source, "has no window without this anomaly: nothing nominal can be learned", name)
    at_once = np.bincount(sum(labels.values()), minlength=len(names) + 1)  # windows with 0, 1, 2, … anomalies
    smoothed = at_once + PSEUDO_WINDOWS + PSEUDO_SHARE * len(windows)
    anomalies = tuple(_train_anomaly(windows, wheel, name, a, labels[name]) for a, name in enumerate(names))
    return Model(
        trained=Provenance(
            wheel=wheel.name, wheel_sha256=wheel.sha256(), windows=len(windows), source=source, command=command
        ),
        anomalies=anomalies,
        simultaneous=tuple(float(share) for share in smoothed / smoothed.sum()),
        undecided=UNDECIDED,
    )


def _train_anomaly(
    windows: Sequence[LabelledFeatures], wheel: Wheel, name: str, a: int, label: BoolArray
) -> AnomalyModel:
    rate = (label.sum() + PSEUDO_WINDOWS) / (label.size + 2.0 * PSEUDO_WINDOWS)
    if name in RESERVED_ANOMALIES:
        known = [window.features.base_known or a == 1 for window in windows]
        _, value, std = np.array([window.features.measured(a) for window in windows]).T
        levels = fit_levels(value[known], std[known], label[known], MIN_SOFT)
        if levels is None:
            raise InputError("training windows", "show no nominal value", name)
        return AnomalyModel(name=name, levels=(levels,), svm=None, rate=rate)

    per_configuration: list[Levels | None] = [None]
    for q in range(1, wheel.fss[a - 2].configurations):
        value, std, labels = _sojourns(windows, a - 2, q, label)
        per_configuration.append(fit_levels(value, std, labels, MIN_SOFT_SYSTEM))
    return AnomalyModel(name=name, levels=tuple(per_configuration), svm=None, rate=rate)


def _sojourns(
    windows: Sequence[LabelledFeatures], s: int, q: int, label: BoolArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return friction, std and label of all sojourns in a configuration, of windows in which the system rests."""
    values, stds, labels = [np.zeros(0)], [np.zeros(0)], [np.zeros(0, dtype=bool)]
    for window, anomalous in zip(windows, label, strict=True):
        system = window.features.systems[s]
        if not system.rests:
            continue
        there = system.configuration == q
        values.append(system.friction[there])
        stds.append(system.friction_std[there])
        labels.append(np.full(int(there.sum()), anomalous))
    return np.concatenate(values), np.concatenate(stds), np.concatenate(labels)


# ---- bands -----------------------------------------------------------------------------------------------------------


def fit_levels(value: FloatArray, std: FloatArray, anomalous: BoolArray, min_soft: float) -> Levels | None:
    """Fit the bands of nominal and anomalous values; None without nominal values.

    Parameters
    ----------
    value, std, anomalous
        (n,): measured values, their standard deviations, and the class of each.
    min_soft
        The least softness of a band, as a share of the distance between the classes.
    """
    finite = np.isfinite(value) & np.isfinite(std)
    value, std, anomalous = value[finite], std[finite], anomalous[finite]
    healthy, ill = value[~anomalous], value[anomalous]
    if healthy.size < MIN_WINDOWS:
        return None
    middle = float(np.median(healthy))
    median = float(np.median(ill)) if ill.size >= MIN_WINDOWS else None
    reach = REACH_UNSEEN * abs(middle) if median is None else abs(median - middle)
    reach = max(reach, 1e-3)
    nominal, stray = _fit_band(healthy, std[~anomalous], min_soft * reach, reach)
    band = None if median is None else _fit_band(ill, std[anomalous], min_soft * reach, reach)[0]
    return Levels(nominal=nominal, anomalous=band, stray=stray, reach=reach, median=median)


def _fit_band(value: FloatArray, std: FloatArray, min_soft: float, reach: float) -> tuple[Band, float]:
    """Fit a band and the share of strays.

    Two bands are tried, a range and a mean with scatter, each in a mixture with strays; the likelier one is taken.
    Values that are uncertain because they are ambiguous (errata 10), not by noise, carry no information on a band's
    shape: of the less certain half, only those with a std within SHARP_STD are used.
    """
    sharp = std <= max(SHARP_STD * reach, float(np.median(std)))
    value, std = value[sharp], std[sharp]
    stray = 0.5 / reach / (1.0 + np.abs(value - np.median(value)) / reach) ** 2

    def log_likelihood(band: Band, share: float) -> float:
        return float(np.log((1.0 - share) * band.density(value, std) + share * stray).sum())

    fits = (_range_among_strays(value, stray, min_soft), _scatter_among_strays(value, std, min_soft))
    return max(fits, key=lambda fit: log_likelihood(*fit))


def _range_among_strays(value: FloatArray, stray: FloatArray, min_soft: float) -> tuple[Band, float]:
    """Fit a range: how many of the lowest and of the highest values are strays is decided by the likelihood.

    With `i` and `j` values left out, n - i - j lie in the range, with density (1 - share)/width, and the others are
    strays, with density share·stray.
    """
    order = np.argsort(value)
    sorted_value, log_stray = value[order], np.log(stray[order])
    most = int(STRAYS[1] * value.size)
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(most + 1), np.arange(most + 1), indexing="ij"))
    allowed = i + j <= most
    i, j = i[allowed], j[allowed]
    low, high = sorted_value[i], sorted_value[value.size - 1 - j]
    inside = value.size - i - j
    share = np.clip((i + j) / value.size, *STRAYS)
    # The true ends of a range lie beyond the outermost of n values, by about width/n.
    beyond = (high - low) / (inside + 1)
    width = np.maximum(high - low + 2.0 * beyond, min_soft)
    out = np.concatenate([[0.0], np.cumsum(log_stray)])[i] + np.concatenate([[0.0], np.cumsum(log_stray[::-1])])[j]
    best = int(np.argmax(inside * np.log((1.0 - share) / width) + (i + j) * np.log(share) + out))
    band = Band(low=float(low[best] - beyond[best]), high=float(high[best] + beyond[best]), soft=min_soft)
    return band, float(share[best])


def _scatter_among_strays(value: FloatArray, std: FloatArray, min_soft: float) -> tuple[Band, float]:
    """Fit mean and scatter of the values that do not lie far outside the quartiles; the others are strays."""
    lower, upper = np.quantile(value, [0.25, 0.75])
    fence = max(STRAY_FENCE * float(upper - lower), 4.0 * min_soft)
    kept = (value >= lower - fence) & (value <= upper + fence)
    mean = float(value[kept].mean())
    scatter = np.sqrt(max(float(value[kept].var()) - float(np.mean(std[kept] ** 2)), min_soft**2))
    return Band(low=mean, high=mean, soft=float(scatter)), float(np.clip((~kept).mean(), *STRAYS))
