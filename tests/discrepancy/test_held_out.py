"""The gain on recordings that nothing was searched or fitted on."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm

from rwa_monitor.discrepancy.extended import extend
from rwa_monitor.discrepancy.find import find_discrepancy, with_search_again
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.likelihood import NO_JUMPS, NoiseLaw, Series
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.discrepancy.score import BLOCKS, held_out, on_other_recordings, regressors, with_law
from rwa_monitor.discrepancy.terms import make_term
from rwa_monitor.messages import SearchedAgain as SearchedAgainMessage
from rwa_monitor.reporting.discrepancy_report import html, sentence
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.effects.base import MeanEffect
from rwa_monitor.wheel.effects.drag_laws import Stribeck
from rwa_monitor.wheel.effects.torque_ripple import TorqueRipple
from tests.discrepancy.simple import NOISE_NM, WHEEL, Array, record, swing
from tests.discrepancy.smooth import problem_of

STRIBECK_NM, WIDTH_RAD_S = 6e-4, 15.0
ASYMMETRY = 0.1


def stribeck(speed: Array, level: Array) -> Array:
    del level
    return np.asarray(np.sign(speed) * STRIBECK_NM * np.exp(-((speed / WIDTH_RAD_S) ** 2)))


def asymmetry(speed: Array, level: Array) -> Array:
    return np.asarray(ASYMMETRY * level * (speed < 0) * np.sign(speed))


def other_motion() -> Array:
    return swing(6000, top=150.0, period_s=400.0)


def aside(seed: int, *, hidden: bool = True) -> Samples:
    return record(other_motion(), (2000, 4500), stribeck if hidden else None, seed=seed)[0]


@pytest.fixture(scope="module")
def searched() -> Samples:
    return record(swing(), effect=stribeck)[0]


@pytest.fixture(scope="module")
def found(searched: Samples) -> Search:
    return find_discrepancy([("searched", searched)], WHEEL, held_out_recordings=[("aside", aside(1))])


def test_what_is_true_of_one_recording_gains_on_another(found: Search) -> None:
    gain = found.result.gain
    assert gain.held_out == ["aside"]
    # Levels cost a few of 6000 degrees of freedom; the strength is known to a few per cent.
    assert gain.rmse_extended_Nm == pytest.approx(NOISE_NM, rel=5 / np.sqrt(2 * 6000))
    assert gain.log_score_extended - gain.log_score_base > 0.01


def predicted(samples: Samples, effect: type[MeanEffect], *shapes: dict[str, float]) -> list[bool]:
    """Return whether an effect of each shape predicts beside the base model, without jumps."""
    problem = problem_of(samples)
    fitting = Fitting(problem, jumps=False)
    base = fitting.base()
    terms = [make_term(problem, effect, shape, None) for shape in shapes]
    return [fitting.predicts(fitting.refitted((term,), base), base) for term in terms]


def test_a_term_predicts_where_it_is_true_and_not_where_it_follows_the_noise() -> None:
    true, _ = record(swing(), (), stribeck)
    assert predicted(true, Stribeck, {"stribeck_speed_rad_s": WIDTH_RAD_S, "exponent": 2.0}) == [True]
    nothing, _ = record(swing(), ())
    # Four strengths gain more by chance than they cost elsewhere where chi-square of four is above eight: in 9 %.
    assert sum(predicted(nothing, TorqueRipple, *({"harmonic": float(order)} for order in range(1, 21)))) <= 4


def test_the_search_does_not_look_at_them(searched: Samples, found: Search) -> None:
    alone = find_discrepancy([("searched", searched)], WHEEL)
    assert found.result.effects == alone.result.effects
    assert alone.result.gain.held_out == []


def test_several_recordings_are_one_score(found: Search) -> None:
    first, last = aside(1), aside(2)
    one, other, both = (
        on_other_recordings(found.problem, problem_of(*those), found.extended, jumps=True).rmse_Nm ** 2
        for those in ((first,), (last,), (first, last))
    )
    assert both == pytest.approx(0.5 * (one + other), rel=0.01)  # blocks begin elsewhere, with levels of their own


def test_a_column_that_follows_the_level_follows_that_of_the_other_recording() -> None:
    found = find_discrepancy(
        [("searched", record(swing(), effect=asymmetry)[0])],
        WHEEL,
        held_out_recordings=[("aside", record(other_motion(), (1200, 3500), asymmetry, seed=3)[0])],
    )
    assert found.extended.names == ("coulomb_asymmetry",)
    gain = found.result.gain
    assert gain.rmse_extended_Nm == pytest.approx(NOISE_NM, rel=5 / np.sqrt(2 * 6000))
    assert gain.log_score_extended > gain.log_score_base


def test_an_extension_that_does_worse_elsewhere_is_no_gain(searched: Samples, found: Search) -> None:
    # The other recording is of a wheel without the effect: the extension adds what is not there.
    worse = find_discrepancy([("searched", searched)], WHEEL, held_out_recordings=[("plain", aside(1, hidden=False))])
    gain = worse.result.gain
    assert gain.log_score_extended < gain.log_score_base - 0.01  # nothing is fitted there: that would set it to zero
    assert gain.is_a_loss
    assert worse.result.verdict == "inadequate"  # of the searched recording that stays true
    assert sentence(worse.result).startswith("On plain what was found does not hold")
    assert "carry over" not in sentence(worse.result)
    drift = replace(worse.result.effects[0], name="run_in_drift")
    assert "run_in_drift could not carry over" in sentence(replace(worse.result, effects=(drift,)))
    page = html(worse, ["searched"])
    assert "What the extension loses" in page
    assert "the log score of a sample changes" not in page
    assert "does worse" in extend(worse).to_toml()
    assert not found.result.gain.is_a_loss
    assert sentence(found.result).startswith("The simulation lacks stribeck")
    assert "does worse" not in extend(found).to_toml()


@pytest.mark.parametrize(("error", "more_jumps", "loss"), [(0.5, 0, False), (0.5, 3, True), (1.0, 0, True)])
def test_a_lower_log_score_is_no_loss_where_the_error_falls(
    found: Search, error: float, more_jumps: int, loss: bool
) -> None:
    # As in a coast-down of some 90 samples, where correlated noise stands in for the law that the base model lacks.
    gain = found.result.gain
    less = gain.model_copy(
        update={
            "log_score_extended": gain.log_score_base - 0.2,
            "rmse_extended_Nm": error * gain.rmse_base_Nm,
            "changepoints_extended": gain.changepoints_base + more_jumps,
        }
    )
    assert less.is_a_loss is loss


# ---- the search again, without what it is judged on ------------------------------------------------------------------


def test_what_is_hidden_is_found_again_in_half_of_a_recording_and_gains_on_the_rest(searched: Samples) -> None:
    found = with_search_again(find_discrepancy([("searched", searched)], WHEEL), [("searched", searched)])
    again = found.result.gain.searched_again
    assert again.effects == ["stribeck"]
    assert again.rmse_extended_Nm < again.rmse_base_Nm
    assert again.log_score_extended > again.log_score_base + 0.02  # nats a sample, of 4,000
    in_message = found.result.to_json()["gain"]["searched_again"]
    assert SearchedAgainMessage.model_validate(in_message).effects == ["stribeck"]
    by_speed = found.result.gain.searched_again_by_speed
    assert by_speed.effects == ["stribeck"]
    assert by_speed.held_out == ["searched, speeds 2, 4, … of 5"]
    page = " ".join(html(found, ["searched"]).split())
    assert again.in_words()[1:] in page
    assert by_speed.in_words()[1:] in page


def test_of_two_recordings_the_last_is_not_searched_again(searched: Samples) -> None:
    recordings = [("first", searched), ("last", aside(1, hidden=False))]
    found = with_search_again(find_discrepancy(recordings, WHEEL), recordings)
    again = found.result.gain.searched_again
    assert found.result.gain.searched_again_by_speed is None
    assert again.held_out == ["last"]
    assert again.effects == ["stribeck"]
    assert again.rmse_extended_Nm > again.rmse_base_Nm  # it is not there: that is what shows


def test_the_likelihood_of_each_block_is_that_beside_its_own_fit() -> None:
    # Against dense covariances: a fit for each block leaves no seams between them.
    samples, _ = record(swing(600), ())
    problem = problem_of(samples)
    law = NoiseLaw(white=0.3, correlation=0.9)
    model = with_law(problem, (), NO_JUMPS, law)
    rows, *_ = regressors(Series.of(problem), ())
    lags = np.abs(np.subtract.outer(problem.slot, problem.slot))
    factor = np.linalg.cholesky(0.3 * (lags == 0) + 0.7 * 0.9**lags)
    friction, design = np.linalg.solve(factor, Series.of(problem).friction), np.linalg.solve(factor, rows.T)
    scores = []
    for here in np.split(np.arange(problem.size), BLOCKS):
        train = np.delete(np.arange(problem.size), here)
        strengths, *_ = np.linalg.lstsq(design[train], friction[train])
        left = friction - design @ strengths
        std = np.sqrt(np.mean(left[train] ** 2))
        density = norm.logpdf(left[here], scale=std) - np.log(np.diag(factor)[here])
        scores.append(float(density.mean()))
    assert held_out(problem, model).block_log_scores == pytest.approx(scores, rel=1e-9)


def test_the_error_of_the_base_law_is_that_of_least_squares() -> None:
    """In noise of long memory the likeliest law misses by more than the one that a user would fit."""
    rng, speed = np.random.default_rng(4), swing(600)
    drifting = lfilter([1.0], [1.0, -0.98], rng.normal(0.0, NOISE_NM, speed.size))
    samples, _ = record(speed, (), noise=np.sign(speed) * drifting)
    gain = find_discrepancy([("record", samples)], WHEEL).result.gain
    law = np.stack([np.sign(samples.speed_rad_s), samples.speed_rad_s], axis=1)
    rest = np.zeros(speed.size)
    for block in np.array_split(np.arange(speed.size), BLOCKS):
        others = np.setdiff1d(np.arange(speed.size), block)
        fitted = np.linalg.lstsq(law[others], samples.friction_torque_Nm[others])[0]
        rest[block] = samples.friction_torque_Nm[block] - law[block] @ fitted
    assert gain.rmse_base_Nm == pytest.approx(np.sqrt(np.mean(rest**2)), rel=1e-9)
