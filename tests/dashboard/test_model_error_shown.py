"""What is not judged, uncertain, or more or less urgent is shown: in words and shapes, and in colours that differ."""

from typing import Any

import pytest
import zenoh

from rwa_monitor.dashboard.server import Running
from rwa_monitor.messages import Diagnosis
from tests.dashboard.support import expect, findings
from tests.history.support import diagnosis

pytestmark = pytest.mark.browser

WINDOWS = 3


def doubtful(number: int, wheel: str, **changes: Any) -> Diagnosis:
    """Return the diagnosis of a window whose viscous friction is anomalous with a probability of one half."""
    window = diagnosis(number, wheel=wheel)
    viscous = window.anomalies["viscous"].model_copy(update={"probability": 0.48} | changes.pop("part", {}))
    return window.model_copy(update={"anomalies": {"viscous": viscous}} | changes)


@pytest.mark.parametrize("look", [{"color_scheme": "light"}, {"color_scheme": "dark"}], ids=["light", "dark"])
def test_nothing_is_green_while_the_model_does_not_fit_or_the_verdict_is_open(
    session: zenoh.Session, dashboard: Running, page: Any
) -> None:
    cases: dict[str, tuple[dict[str, Any], str, str]] = {  # changes of the diagnosis; of the part: its words, the note
        "misfit": (
            {"model_adequate": False, "suspected_effect": "stribeck"},
            "? open", "the friction model does not fit",
        ),
        "open": ({"verdict": "inconclusive"}, "? open", "the verdict on this window is open"),
        "hidden": ({"verdict": "inconclusive", "part": {"active": True}}, "? may be active", "nor an all-clear"),
        "unjudged": (
            {"verdict": "inconclusive", "part": {"nominal_low": None, "nominal_high": None, "severity": None}},
            "– not judged", "no nominal range is known",
        ),
    }  # fmt: skip
    for wheel, (changes, _, _) in cases.items():
        for number in range(WINDOWS):
            session.put(f"rwa/sat/{wheel}/diagnosis", doubtful(number, wheel, **dict(changes)).to_json())
    session.put("rwa/sat/well/diagnosis", diagnosis(0, wheel="well").to_json())
    page.goto(dashboard.address)
    expect(page.locator(".wheel")).to_have_count(len(cases) + 1)
    expect(page.locator(".wheel.is-nominal")).to_have_count(1)
    expect(page.locator(".wheel", has_text="misfit")).to_contain_text("? model misfit")
    assert findings(page) == []
    for wheel, (_, words, note) in cases.items():
        page.goto(f"{dashboard.address}#/wheel/sat/{wheel}")
        expect(page.get_by_role("row", name="viscous")).to_contain_text(words)
        expect(page.get_by_role("region", name="Diagnosis of the latest window")).to_contain_text(note)
        expect(page.locator("td.nominal, p.nominal")).to_have_count(0)
        assert findings(page) == []
    page.goto(f"{dashboard.address}#/wheel/sat/well")
    expect(page.locator("td.nominal")).to_have_text("✓ none")
    # Nothing is drawn of samples that are not there, but what the diagnosis estimated.
    expect(page.get_by_text("No samples of this window are kept.")).to_be_visible()
    expect(page.get_by_role("img", name="speed [rad/s] over time")).to_have_count(0)


@pytest.mark.parametrize("look", [{"color_scheme": "light"}, {"color_scheme": "dark"}], ids=["light", "dark"])
def test_each_level_of_an_alarm_has_its_own_word_shape_and_colour(
    session: zenoh.Session, dashboard: Running, page: Any
) -> None:
    levels = {"watch": 0.2, "warning": 0.8, "distress": 2.0, "critical": 4.0}
    for level, severity in levels.items():
        for number in range(WINDOWS):
            bad = severity if number else None
            # Each on a spacecraft of its own: what wheels of one share would be an alarm of that spacecraft.
            message = diagnosis(number, severity=bad).model_copy(update={"spacecraft": level})
            session.put(f"rwa/{level}/wheel_1/diagnosis", message.to_json())
    for view in ("#/", "#/alarms"):
        page.goto(dashboard.address + view)
        badges = page.locator(".level")
        expect(badges).to_have_count(len(levels))
        looks = badges.evaluate_all(
            "all => all.map(one => [one.textContent, getComputedStyle(one).color,"
            " getComputedStyle(one).backgroundColor])"
        )
        texts = [text for text, *_ in looks]
        assert [text.split()[1] for text in texts] == ["critical", "distress", "warning", "watch"]
        assert len({text[0] for text in texts}) == len(levels)
        assert len({tuple(colours) for _, *colours in looks}) == len(levels)
        assert findings(page) == []
    page.goto(dashboard.address + "#/")
    expect(page.locator(".wheel").first).not_to_contain_text("·")
