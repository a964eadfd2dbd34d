"""`bridge`: space packets from UDP onto the bus, until SIGINT or SIGTERM."""

from __future__ import annotations

import json

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
    from contextlib import ExitStack

    from rwa_monitor.monitor.bridge import Bridge, UdpAddress, listening, run_bridge
    from rwa_monitor.monitor.bus import LINGER_S, BusWatch, SamplesPublisher, endpoints, open_session
    from rwa_monitor.telemetry.ccsds_packets import PacketDecoder

    address = UdpAddress.parse(udp, "--udp")
    decoder = PacketDecoder(decoding, "bridge")
    cli.warn_if_alone(bus)
    if not cli.is_loopback(address.host):
        cli.log(f"--udp {udp} takes packets from everybody who reaches it: UDP does not identify the sender")
    with cli.stop_on_signals() as stop, ExitStack() as stack:
        receiver = stack.enter_context(listening(address))
        session = stack.enter_context(open_session(bus))
        publishers = {
            wheel.key: SamplesPublisher(session, wheel.key, "stored" if stored else None) for wheel in decoder.wheels
        }
        for publisher in publishers.values():
            stack.callback(publisher.close)
        bridge = Bridge(decoder, publishers, batch)
        cli.log(f"bridging UDP {address.host} port {address.port} to {', '.join(list(publishers)[:4])}")
        watch = BusWatch(session, endpoints(bus))
        run_bridge(bridge, receiver, stop, cli.log, lambda now_s: watch.log_changes(now_s, cli.log))
        stop.clear()
        stop.wait(LINGER_S)  # the last message goes out; a second signal ends at once
    click.echo(json.dumps(bridge.counts(), ensure_ascii=False))
