"""The classifiers: what they must find, what must widen them, what must not change them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from rwa_monitor.changepoints.estimation import SlopePrior
from rwa_monitor.diagnosis.classification import Coefficient, Judgement, classify, coefficient
from rwa_monitor.diagnosis.features import Features, SystemFeatures, without_prior
from rwa_monitor.diagnosis.model import built_in_model, models_for
from rwa_monitor.switching.carried_state import CHANGE_PER_WINDOW, CarriedState, Tracked, probability_before
from rwa_monitor.wheel.wheel import built_in_wheel

WHEEL, MODEL = built_in_wheel(), built_in_model()
MODELS, NAMES = models_for(WHEEL, MODEL), WHEEL.anomalies
EMPTY = CarriedState.empty()


def features(
    dry: float = 1.0,
    viscous: float = 1.0,
    factor_1: float = 1.0,
    factor_2: float = 1.0,
    *,
    rests: bool = True,
    std: float = 1e-3,
) -> Features:
    """A window of the built-in wheel with typical friction times factors."""
    q_2 = np.array([0, 1, 2, 1, 0, 1] if rests else [1, 2, 1, 2])
    friction_2 = factor_2 * np.array([0.0, 0.47, 1.05, 0.55, 0.0, 0.5] if rests else [0.47, 1.05, 0.55, 0.95])
    return Features(
        dry,
        std,
        viscous,
        std,
        (
            SystemFeatures(
                "fss_1", np.array([0, 1, 0, 1]), factor_1 * np.array([0, 0.4, 0, 0.5]), np.full(4, std), rests=True
            ),
            SystemFeatures("fss_2", q_2, friction_2, np.full(q_2.size, std), rests),
        ),
    )


def judged(seen: Features, carried: CarriedState = EMPTY) -> dict[str, float]:
    judgement = classify(seen, MODELS, NAMES, MODEL, carried)
    return {entry.name: entry.probability for entry in judgement.anomalies}


def active(judgement: Judgement) -> set[str]:
    return {entry.name for entry in judgement.anomalies if entry.active}


@pytest.mark.parametrize("dry", [1.15, 1.22, 1.5, 2.0, 5.0])
def test_another_size_than_the_learned_one_is_anomalous_too(dry: float) -> None:
    assert judged(features(dry=dry))["dry"] > 0.5


@given(st.floats(1.0, 8.0), st.floats(0.0, 0.3))
def test_more_dry_friction_is_never_less_suspect_by_much(dry: float, more: float) -> None:
    """The densities are a mixture, so the probability may dip a little between its parts, but never across a half."""
    if judged(features(dry=dry))["dry"] > 0.9:
        assert judged(features(dry=dry + more))["dry"] > 0.5


def test_a_certain_anomaly_beside_uncertain_ones_has_no_more_than_probability_one() -> None:
    rng = np.random.default_rng(50110)
    pulses = SystemFeatures("fss_1", np.tile([0, 1], 12), np.tile([0.0, 0.75], 12), np.full(24, 1e-3), rests=True)
    sure = []
    for _ in range(100):
        seen = features(rng.uniform(1.0, 1.3), rng.uniform(1.0, 1.2), factor_2=rng.uniform(1.0, 1.6), std=0.03)
        sure.append(judged(seen._replace(systems=(pulses, seen.systems[1])))["fss_1"])
    assert min(sure) > 1.0 - 1e-12
    assert max(sure) <= 1.0


def test_uncertainty_leaves_the_prior() -> None:
    """A value known to nothing shows nothing: what remains is the share of the training windows."""
    seen = features(dry=1.3, std=1e4)
    for name, probability in judged(seen).items():
        anomaly = MODEL.anomaly(name)
        assert probability == pytest.approx(anomaly.rate, abs=0.02)
    assert not any(entry.informative for entry in classify(seen, MODELS, NAMES, MODEL, EMPTY).anomalies)


@given(st.floats(-0.9, 3.0))
def test_where_a_system_never_rests_the_split_that_is_handed_over_does_not_matter(moved: float) -> None:
    """Only base plus friction is seen there: any split of it gives the same judgement."""
    seen = features(dry=1.3, rests=False)
    rested, unrested = seen.systems
    other = seen._replace(
        base_dry=seen.base_dry - moved, systems=(rested, unrested._replace(friction=unrested.friction + moved))
    )
    assert judged(other) == pytest.approx(judged(seen), abs=1e-9)


def test_the_most_plausible_split_is_handed_back() -> None:
    seen = features(dry=1.0, rests=False)
    rested, unrested = seen.systems
    wrong = seen._replace(base_dry=0.7, systems=(rested, unrested._replace(friction=unrested.friction + 0.3)))
    found = classify(wrong, MODELS, NAMES, MODEL, EMPTY).features
    assert found.base_dry == pytest.approx(1.0, abs=3 * found.base_dry_std)
    assert found.base_dry_std < 0.1
    assert found.base_dry + found.systems[1].friction[0] == pytest.approx(1.0 + unrested.friction[0])


def test_earlier_windows_decide_what_this_one_leaves_open() -> None:
    """Base 1.3 with nominal jumps, or base 1.0 with larger ones: two sojourns alone do not decide."""
    q = np.array([1, 1])
    system = SystemFeatures("fss_2", q, np.array([0.47 + 0.16, 0.49 + 0.16]), np.full(2, 1e-3), rests=False)
    first = features().systems[0]
    seen = Features(1.0, 0.2, 1.0, 1e-3, (first, system))
    alone = judged(seen)
    healthy = judged(seen, CarriedState(base_dry=Tracked(mean=1.0, std=0.005, windows=9)))
    worn = judged(seen, CarriedState(base_dry=Tracked(mean=1.16, std=0.005, windows=9)))
    assert healthy["dry"] < alone["dry"] < worn["dry"]
    assert worn["fss_2"] < alone["fss_2"] < healthy["fss_2"]


def test_carried_probability_moves_the_prior_but_cannot_hold_against_evidence() -> None:
    certain = CarriedState(windows=10, probability=dict.fromkeys(NAMES, 1.0))
    harmless = CarriedState(windows=10, probability=dict.fromkeys(NAMES, 0.0))
    assert active(classify(features(), MODELS, NAMES, MODEL, certain)) == set()
    assert active(classify(features(dry=1.3), MODELS, NAMES, MODEL, harmless)) == {"dry"}
    vague = features(std=1e4)
    assert judged(vague, certain)["dry"] > 0.9
    assert judged(vague, harmless)["dry"] < 0.02


def test_ruling_out_one_anomaly_window_after_window_is_no_evidence_for_another() -> None:
    """A state of 0.1 for each stays at that, but for the hazard, where the windows show nothing of one."""
    carried = CarriedState(probability=dict.fromkeys(NAMES, 0.1))
    silent = features(std=50.0)
    expected = 0.1
    for _ in range(5):
        after = classify(silent._replace(viscous=1.0, viscous_std=1e-3), MODELS, NAMES, MODEL, carried).next_prior
        expected = probability_before(expected, 0.2)
        assert after["dry"] == pytest.approx(expected, abs=0.03)
        carried = carried.model_copy(update={"probability": after})


@pytest.mark.parametrize(("name", "change"), [("dry", {"base_dry": 1.3}), ("viscous", {"viscous": 1.1})])
def test_a_coefficient_that_no_window_measures_well_does_not_add_up(name: str, change: dict[str, float]) -> None:
    """Its estimate is drawn to the same side each time: by friction without a name, by a speed that hardly moves."""
    seen = features()._replace(**change, **{f"{'base_' if name == 'dry' else ''}{name}_std": 1.0})
    carried, found = EMPTY, []
    for _ in range(50):
        judgement = classify(seen, MODELS, NAMES, MODEL, carried)
        found.append(next(entry.probability for entry in judgement.anomalies if entry.name == name))
        carried = carried.model_copy(update={"probability": judgement.next_prior})
    assert max(found) == found[0] < 0.5  # the first has nothing yet of the others, which are healthy
    assert found[-1] <= found[1] + 0.02


def test_overlapping_windows_do_not_count_their_evidence_twice() -> None:
    seen = features(viscous=1.08, std=0.02)
    carried = {
        share: classify(seen, MODELS, NAMES, MODEL, EMPTY, share).next_prior["viscous"] for share in (0.0, 0.5, 1.0)
    }
    model = MODEL.anomaly("viscous")
    assert carried[0.0] == pytest.approx(model.rate, abs=0.02)
    low, high = sorted((carried[0.0], carried[1.0]))
    assert low < carried[0.5] < high


@pytest.mark.parametrize("against", [0.0, -2.0, 2.0])
def test_paths_count_by_what_was_learned_of_friction(against: float) -> None:
    """One path has healthy friction throughout, the other a base that no anomaly has: the samples cannot decide."""
    healthy = features()
    shifted = features(dry=1.48, factor_2=0.8)
    told = shifted._replace(
        by_path=(
            shifted,
            healthy._replace(log_weight=against),
        ),
    )
    assert judged(shifted)["dry"] > 0.9
    assert judged(told)["dry"] < 0.1
    judgement = classify(told, MODELS, NAMES, MODEL, EMPTY)
    assert [q.tolist() for q in judgement.configurations] == [s.configuration.tolist() for s in healthy.systems]


@pytest.mark.parametrize("weight", [-3.0, 0.0, 3.0])
def test_paths_that_agree_change_nothing(weight: float) -> None:
    for seen in (features(), features(rests=False), features(factor_2=1.4)):
        one = seen._replace(log_weight=weight)
        assert judged(seen._replace(by_path=(one, one))) == pytest.approx(judged(seen), abs=1e-9)


# ---- a coefficient over windows --------------------------------------------------------------------------------------


VISCOUS = built_in_model().anomaly("viscous")
LEVELS, RATE = VISCOUS.levels[0], VISCOUS.rate


def probability(seen: Coefficient, value: float, std: float) -> float:
    rows = seen.log_evidence(np.array([value]), np.array([std]))[:, 0] + np.log([1.0 - seen.prior, seen.prior])
    return float(np.exp(rows[1] - np.logaddexp(*rows)))


def over_windows(values: list[tuple[float, float]]) -> list[float]:
    tracked, found = None, []
    for value, std in values:
        seen = coefficient(VISCOUS, tracked)
        found.append(probability(seen, value, std))
        tracked = seen.after(value, std)
    return found


@pytest.mark.parametrize(("mean", "std", "held"), [(1.0, 0.01, 0.98), (1.15, 0.02, 0.5), (1.05, 0.03, 0.9)])
def test_what_a_window_can_measure_has_total_probability_one(mean: float, std: float, held: float) -> None:
    """Oracle: the density of a measurement, over both classes and all values, integrates to 1, by quadrature."""
    grid = np.linspace(-60.0, 60.0, 600_001)
    # Strays reach far beyond any grid; with next to none of them the bands hold everything.
    tracked = Tracked(mean=mean, std=std, windows=5, held=held)
    seen = Coefficient(LEVELS.model_copy(update={"stray": 1e-12}), RATE, tracked)
    held_part, changed = (np.exp(part).sum(axis=0) for part in seen.log_parts(grid, np.full(grid.size, 0.02)))
    # The tail of anomalies of other sizes (a Lomax law of shape 1) beyond the grid: OTHER_SIZE · reach/60 or so.
    assert integrate.trapezoid(changed, grid) == pytest.approx(1.0 - held, abs=1e-3)
    assert integrate.trapezoid(held_part, grid) == pytest.approx(held, abs=1e-3)


@pytest.mark.parametrize("viscous", [1.0, 1.04, 1.06, 1.08, 1.15])
def test_the_same_value_again_is_no_new_evidence(viscous: float) -> None:
    """A healthy wheel keeps its place in its band: twenty windows must not make certain what is uncertain."""
    found = over_windows([(viscous, 0.003)] * 20)
    assert found[-1] == pytest.approx(found[0], abs=0.1)


@given(st.floats(0.9, 1.4), st.integers(1, 30))
def test_a_window_that_shows_the_value_wins_whatever_went_before(value: float, windows: int) -> None:
    """The verdict of a sharp measurement is that of the window alone, at most the hazard away from it."""
    alone = over_windows([(value, 0.002)])[0]
    after_healthy = over_windows([(1.0, 0.002)] * windows + [(value, 0.002)])[-1]
    if alone > 0.9:
        assert after_healthy > 0.6
    if alone < 0.1:
        assert after_healthy < 0.4


@given(st.integers(1, 60))
def test_windows_that_do_not_show_the_value_leave_it_with_the_hazard(windows: int) -> None:
    vague = 10.0 * LEVELS.reach
    found = over_windows([(1.0, 0.002)] + [(1.0, vague)] * windows)
    hazard = RATE * (1.0 - (1.0 - CHANGE_PER_WINDOW) ** windows)
    assert found[-1] >= 0.8 * hazard
    assert found[-1] <= RATE + 0.02


def test_what_a_window_alone_measures_is_what_the_prior_was_multiplied_by() -> None:
    """Oracle: the product of two Gaussians, of a prior and of a measurement, undone."""
    prior, value, std = SlopePrior(1.04, 0.05), 1.2, 0.08
    weights = np.array([prior.std**-2, std**-2])
    mean, spread = float(weights @ [prior.mean, value] / weights.sum()), float(weights.sum() ** -0.5)
    seen = Features(1.0, 0.01, mean, spread, ())
    alone = without_prior(seen, prior)
    assert alone.viscous == pytest.approx(value)
    assert alone.viscous_std == pytest.approx(std)
    assert without_prior(seen._replace(viscous=1.04, viscous_std=0.05), prior).viscous_std == np.inf
