"""`packets`: verdicts and alarms from the bus as CCSDS space packets over UDP."""

from __future__ import annotations

import time
from pathlib import Path

import click

from rwa_monitor.cli import options as cli


@click.command(short_help="Send verdicts and alarms as CCSDS space packets over UDP.")
@click.argument("wheels", nargs=-1, required=True, metavar="SPACECRAFT/WHEEL...")
@cli.option("--to", str, "[HOST:]PORT", "Where packets go.  [HOST: 127.0.0.1 where none is given]")
@cli.option("--xtce", cli.FILE, "X.xml", "Write their XTCE definition.")
@cli.option("--apid", cli.Whole(0, 2046), "N", "APID of the first wheel; each other has the next.", default=1000)
@cli.wheel_option
@cli.model_option
@cli.bus_options
def packets(
    wheels: tuple[str, ...],
    to: str | None,
    xtce: Path | None,
    apid: int,
    wheel: Path | None,
    model: Path | None,
    bus: cli.BusOptions,
) -> None:
    """Send each diagnosis of these wheels, and each change of their alarms, as a CCSDS space packet over UDP.

    The definition (--xtce) and the packets follow from the wheels, --apid, --wheel and --model: give both the same.
    Without --to only the definition is written. Alarms come from a dashboard on the bus; without one there are none.
    """
    from rwa_monitor.dashboard.space_packets import PacketSender, PacketWriter
    from rwa_monitor.messages import PERIOD_S
    from rwa_monitor.monitor.bridge import UdpAddress
    from rwa_monitor.monitor.bus import BusWatch, endpoints, open_session
    from rwa_monitor.telemetry.configuration import read_model, read_wheel
    from rwa_monitor.telemetry.files import display_name, write_text

    if to is None and xtce is None:
        raise click.UsageError("nothing to do: give --to [HOST:]PORT, --xtce X.xml, or both")
    address = None if to is None else UdpAddress.parse(to, "--to")
    writer = PacketWriter(wheels, apid, read_wheel(wheel), read_model(model))
    if xtce is not None:
        write_text(xtce, writer.definition())
        cli.log(f"written to {display_name(xtce)}")
    if address is None:
        return
    cli.warn_if_alone(bus)
    if not cli.is_loopback(address.host):
        cli.log(f"--to {to} sends to another machine: UDP neither encrypts nor identifies the sender")
    with (
        cli.stop_on_signals() as stop,
        open_session(bus) as session,
        PacketSender(session, writer, address, cli.log) as sender,
    ):
        cli.log(f"sending to UDP {address.host} port {address.port}")
        watch = BusWatch(session, endpoints(bus))
        while not stop.wait(PERIOD_S):
            watch.log_changes(time.monotonic(), cli.log)
    cli.log(f"packets sent: {sender.packets}")
