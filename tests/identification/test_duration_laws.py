"""Duration laws from few sojourns: calibrated for the next one, unbiased by cuts, shared where configurations agree."""

from itertools import pairwise

import numpy as np
import pytest

from rwa_monitor.identification.duration_laws import learn_laws
from rwa_monitor.kernels.laws import SOFT_SHARE
from rwa_monitor.switching.duration_likelihoods import broad_pmf
from rwa_monitor.switching.jump_attribution import Sojourn
from rwa_monitor.wheel.durations import DurationLaw, Geometric, Lognormal, Uniform, Weibull
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.wheel import FrictionRange, SwitchingSystem

LAWS: list[DurationLaw] = [
    Uniform(low=6575, high=19726),
    Uniform(low=1, high=132),
    Geometric(mean_slots=400.0),
    Lognormal(mu=7.0, sigma=0.5),
    Weibull(shape=2.0, scale=900.0),
]


def whole(*slots: int) -> list[Sojourn]:
    """Return sojourns that no record cuts."""
    return [Sojourn(one, began=True, ended=True) for one in slots]


def complete(law: DurationLaw, rng: np.random.Generator, count: int) -> list[Sojourn]:
    """Draw sojourns that no record cuts."""
    return whole(*law.sample(rng, count).tolist())


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_the_next_sojourn_is_as_likely_as_the_law_states(law: DurationLaw) -> None:
    # Over many sets of six sojourns, a seventh falls below the 10 % and above the 90 % point of what was learned from
    # six one time in ten each. A law fitted to six does so for two in ten.
    rng = np.random.default_rng(71)
    below = above = 0
    sets, drawn = 50, 20
    for _ in range(sets):
        (learned,) = learn_laws([complete(law, rng, 6)])
        reached = learned.law.survival(law.sample(rng, drawn))
        below += int((reached > 0.9).sum())
        above += int((reached < 0.1).sum())
    # Draws of one set share its law: the rate of a set has a standard deviation of about 0.1, the mean of 50 of 0.014.
    assert below / (sets * drawn) < 0.1 + 4 * 0.014
    assert above / (sets * drawn) < 0.1 + 4 * 0.014


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_no_sojourn_to_come_is_called_impossible(law: DurationLaw) -> None:
    # The mean log-probability of sojourns to come, of nine learned from, loses less than half a nat against the truth.
    # The ends of a uniform law fitted to nine leave out one in five, which costs 7 nats each even when softened.
    rng = np.random.default_rng(72)
    lost = []
    for _ in range(20):
        (learned,) = learn_laws([complete(law, rng, 9)])
        to_come = law.sample(rng, 200)
        soft = (1.0 - SOFT_SHARE) * learned.law.pmf(to_come) + SOFT_SHARE * broad_pmf(to_come, learned.law.mean())
        lost.append(float(np.mean(np.log(law.pmf(to_come)) - np.log(soft))))
    assert 0.0 < np.mean(lost) < 0.5


def test_many_sojourns_give_back_their_law() -> None:
    law = Uniform(low=1000, high=3000)
    (learned,) = learn_laws([complete(law, np.random.default_rng(73), 200)])
    assert learned.family == "uniform"
    assert learned.share > 0.99
    assert learned.mean == pytest.approx(2000.0, rel=0.02)
    at = np.linspace(1100, 2900, 10)
    assert learned.law.survival(at) == pytest.approx(law.survival(at), abs=0.03)


def cut_into(law: DurationLaw, slots: int, records: int, rng: np.random.Generator) -> list[Sojourn]:
    """Draw what records of so many slots see of one system that begins a sojourn after the other."""
    system, seen = SwitchingSystem(name="s", durations=(law, law), friction=(FrictionRange(low=0, high=0),) * 2), []
    for _ in range(records):
        lengths = np.diff([0, *simulate_system(system, slots, rng).jump_index, slots]).tolist()
        ends = range(1, len(lengths) + 1)
        seen += [Sojourn(one, began=k > 1, ended=k < len(lengths)) for k, one in zip(ends, lengths, strict=True)]
    return seen


def test_cut_sojourns_count_as_what_they_are() -> None:
    # Records three mean durations long see the short sojourns whole and cut the long ones.
    law = Weibull(shape=1.5, scale=1000.0)
    rng = np.random.default_rng(74)
    with_cuts, without = [], []
    for _ in range(20):
        seen = cut_into(law, 3000, 20, rng)
        with_cuts.append(learn_laws([seen])[0].mean)
        without.append(learn_laws([[one for one in seen if one.whole]])[0].mean)
    # About 40 whole sojourns and 40 cut ones a time: each mean is known to some 10 %, that of twenty to 2.5 %.
    assert np.mean(with_cuts) == pytest.approx(law.mean(), rel=0.1)
    assert np.mean(without) < 0.85 * law.mean()


def test_configurations_that_agree_share_a_law_and_others_do_not() -> None:
    rng = np.random.default_rng(75)
    slow, fast = Uniform(low=6000, high=18000), Uniform(low=60, high=180)
    alike = learn_laws([complete(slow, rng, 3), complete(slow, rng, 30), complete(slow, rng, 10)])
    alone = learn_laws([complete(slow, rng, 3), complete(fast, rng, 30)])
    assert alike[0].mean == pytest.approx(slow.mean(), rel=0.1)
    assert alike[0].error < 0.5 * alone[0].error
    assert alone[1].mean == pytest.approx(fast.mean(), rel=0.1)
    assert float(alone[0].law.survival(1000)) > 0.9


def test_a_rest_that_swallowed_a_visit_does_not_make_a_law_of_its_own() -> None:
    rng = np.random.default_rng(76)
    law = Uniform(low=6500, high=13000)
    seen = complete(law, rng, 80)
    (clean,) = learn_laws([seen])
    seen += whole(24_000)
    (stray,) = learn_laws([seen])
    assert stray.mean == pytest.approx(clean.mean, rel=0.06)
    assert float(stray.law.survival(20_000)) < 0.02


def test_the_law_loads_and_ends_where_the_next_sojourn_hardly_gets() -> None:
    (learned,) = learn_laws([complete(Geometric(mean_slots=50.0), np.random.default_rng(77), 12)])
    assert all(first < second for first, second in pairwise(learned.law.edges))
    assert sum(learned.law.weights) == pytest.approx(1.0, abs=2e-3)
    assert type(learned.law).model_validate(learned.law.model_dump()) == learned.law


def test_sojourns_of_a_single_slot_have_a_law() -> None:
    (learned,) = learn_laws([whole(1, 1, 1, 1, 1)])
    assert float(learned.law.pmf(1)) > 0.2


def test_a_configuration_never_seen_has_none() -> None:
    with pytest.raises(ValueError, match="without a sojourn"):
        learn_laws([whole(5, 6), []])
