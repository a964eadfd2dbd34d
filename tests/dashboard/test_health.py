"""…/health on a real bus: at each window's close by the monitor, at each change of an alarm by the dashboard."""

from contextlib import closing
from typing import Any

import pytest
import zenoh

from rwa_monitor.dashboard.server import Running
from rwa_monitor.messages import Health, health_message
from tests.dashboard.support import acknowledge, send_windows
from tests.history.support import diagnosis
from tests.monitor.processes import wait_for

pytestmark = pytest.mark.processes


def asked(session: zenoh.Session) -> dict[str, Health]:
    """Ask for the last health of every wheel."""
    replies = [reply.ok for reply in session.get("rwa/**/health") if reply.ok is not None]
    keys = [str(reply.key_expr) for reply in replies]
    assert len(set(keys)) == len(keys)  # one answer a wheel, however many know it
    return {key: Health.parse(reply.payload.to_bytes(), key) for key, reply in zip(keys, replies, strict=True)}


def test_a_dashboard_publishes_the_health_at_each_change_of_an_alarm(
    session: zenoh.Session, dashboard: Running
) -> None:
    received: list[Health] = []
    subscriber: Any = session.declare_subscriber(
        "rwa/sat/*/health", lambda sample: received.append(Health.parse(sample.payload.to_bytes(), "received"))
    )

    def phases() -> list[tuple[str, str | None]]:
        states = [one.alarm_states or {} for one in received]
        return [(one["viscous"].phase, one["viscous"].acknowledged_by) if one else ("none", None) for one in states]

    send_windows(session, "wheel_1", failing=True)
    wait_for(lambda: phases() == [("active", None)], "the alarm on the bus")
    assert acknowledge(dashboard.address) == 200
    wait_for(lambda: phases()[1:] == [("acknowledged", "Ann")], "the acknowledgement on the bus")
    assert asked(session) == {"rwa/sat/wheel_1/health": received[-1]}
    assert received[-1].alarms == ["viscous"]
    send_windows(session, "wheel_1", failing=False, first=3)
    wait_for(lambda: phases()[-1] == ("none", None), "the end of the alarm on the bus")
    assert asked(session)["rwa/sat/wheel_1/health"].alarm_states == {}
    subscriber.undeclare()


def test_a_query_gets_the_later_health_of_monitor_and_dashboard(session: zenoh.Session, dashboard: Running) -> None:
    from rwa_monitor.monitor.bus import MonitorBus

    key = "rwa/sat/wheel_1/health"
    with closing(MonitorBus(session)) as bus:

        def publish(number: int) -> None:
            message = diagnosis(number, severity=1.0)
            bus.publish(health_message(message).encoded("sat", "wheel_1"))
            session.put("rwa/sat/wheel_1/diagnosis", message.to_json())

        publish(0)
        publish(1)
        wait_for(lambda: asked(session)[key].alarm_states, "the alarm")
        assert acknowledge(dashboard.address) == 200
        states = asked(session)[key].alarm_states
        assert states["viscous"].acknowledged_by == "Ann"
        publish(2)  # changes no alarm: the monitor's is the later one
        assert asked(session)[key].window_end_ns == diagnosis(2).window_end_ns


@pytest.mark.usefixtures("dashboard")
def test_what_all_wheels_share_is_published_once_for_the_spacecraft(session: zenoh.Session) -> None:
    for number in range(4):
        for wheel in ("wheel_1", "wheel_2", "wheel_3", "wheel_4"):
            send_windows(session, wheel, failing=True, windows=1, first=number)
    wait_for(lambda: asked(session), "the alarm on the bus")
    (health,) = asked(session).values()
    assert (health.wheel, health.verdict, health.alarms) == ("all_wheels", "anomalous", ["viscous"])
    assert health.reason.startswith("Viscous friction of all 4 wheels moved")
