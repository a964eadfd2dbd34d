"""Space packets over UDP: `bridge` publishes received telemetry on the bus, `packets` sends its verdicts and alarms."""

from __future__ import annotations

import json
import time
from pathlib import Path

import click

from rwa_monitor.cli import options as cli


@click.command(short_help="Bring CCSDS space packets from UDP onto the bus.")
@cli.option("--udp", str, "[HOST:]PORT", "Where packets come in.  [HOST: 127.0.0.1 where none is given]", required=True)
@cli.decoding_options
@cli.option("--batch", cli.Whole(1, 10_000), "N", "Samples of one message at most.", default=256)
@cli.flag("--stored", "The packets are a dump: publish their samples as stored, not live.")
@cli.bus_options
def bridge(udp: str, decoding: cli.Decoding, batch: int, stored: bool, bus: cli.BusOptions) -> None:
    """Bring CCSDS space packets from UDP onto the bus, as samples of the wheels that the map names.

    A datagram holds one packet or several. What cannot be read, is unknown or missing is logged on stderr as it comes;
    at the end, on SIGINT or SIGTERM, all counts are printed as one JSON object.
    """
    from rwa_monitor.dashboard.space_packets import Bridge, UdpAddress, listening, run_bridge
    from rwa_monitor.messages import PERIOD_S
    from rwa_monitor.monitor.bus import BusWatch, SamplesPublisher
    from rwa_monitor.telemetry.ccsds_packets import PacketDecoder

    address = UdpAddress.parse(udp, "--udp")
    decoder = PacketDecoder(decoding, "bridge")
    if not cli.is_loopback(address.host):
        cli.log(f"--udp {udp} takes packets from everybody who reaches it: UDP does not identify the sender")
    with cli.on_bus(bus) as (stop, session), listening(address) as receiver:
        publishers = {
            wheel.map.key: SamplesPublisher(session, wheel.map.key, "stored" if stored else None)
            for wheel in decoder.wheels
        }
        bridge = Bridge(decoder, publishers, batch)
        cli.log(f"bridging UDP {address.host} port {address.port} to {', '.join(list(publishers)[:4])}")
        watch = BusWatch(session, bus)
        run_bridge(bridge, receiver, stop, cli.log, lambda now_s: watch.log_changes(now_s, cli.log))
        stop.clear()
        stop.wait(PERIOD_S)  # so that the last message is sent; a second signal ends the wait
    click.echo(json.dumps(bridge.counts(), ensure_ascii=False))


@click.command(short_help="Send verdicts and alarms as CCSDS space packets over UDP.")
@click.argument("wheels", nargs=-1, required=True, metavar="SPACECRAFT/WHEEL...")
@cli.option("--to", str, "[HOST:]PORT", "Where packets go.  [HOST: 127.0.0.1 where none is given]")
@cli.option("--xtce", cli.FILE, "X.xml", "Write their XTCE definition.")
@cli.option("--apid", cli.Whole(0, 2046), "N", "APID of the first wheel; each other has the next.", default=1000)
@cli.setup_options
@cli.bus_options
def packets(
    wheels: tuple[str, ...],
    to: str | None,
    xtce: Path | None,
    apid: int,
    setup: cli.Setup,
    bus: cli.BusOptions,
) -> None:
    """Send each diagnosis of these wheels, and each change of their alarms, as a CCSDS space packet over UDP.

    The definition (--xtce) and the packets follow from the wheels, --apid, --wheel and --model: give both the same.
    Without --to only the definition is written. Alarms come from a dashboard on the bus; without one there are none.
    """
    from rwa_monitor.dashboard.space_packets import PacketSender, PacketWriter, UdpAddress
    from rwa_monitor.messages import PERIOD_S
    from rwa_monitor.monitor.bus import BusWatch
    from rwa_monitor.telemetry.files import display_name, write_text

    if to is None and xtce is None:
        raise click.UsageError("nothing to do: give --to [HOST:]PORT, --xtce X.xml, or both")
    address = None if to is None else UdpAddress.parse(to, "--to")
    writer = PacketWriter(wheels, apid, setup.common, setup.model)
    if xtce is not None:
        write_text(xtce, writer.definition())
        cli.log(f"written to {display_name(xtce)}")
    if address is None:
        return
    if not cli.is_loopback(address.host):
        cli.log(f"--to {to} sends to another machine: UDP neither encrypts nor identifies the sender")
    with cli.on_bus(bus) as (stop, session), PacketSender(session, writer, address, cli.log) as sender:
        cli.log(f"sending to UDP {address.host} port {address.port}")
        watch = BusWatch(session, bus)
        while not stop.wait(PERIOD_S):
            watch.log_changes(time.monotonic(), cli.log)
    cli.log(f"packets sent: {sender.packets}")
