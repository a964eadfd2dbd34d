"""Common code of the commands: exit codes, log and progress on stderr (stdout is for data), clean stop, options."""

from __future__ import annotations

import _thread
import functools
import ipaddress
import math
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from rwa_monitor.errors import InputError

if TYPE_CHECKING:
    import zenoh
    from rich.console import Console

    from rwa_monitor.monitor.bus import BusOptions as BusOptions  # noqa: PLC0414 - re-exported for the commands
    from rwa_monitor.monitor.setup import Setup as Setup  # noqa: PLC0414
    from rwa_monitor.samples import Samples
    from rwa_monitor.telemetry.reader import Decoding as Decoding  # noqa: PLC0414
    from rwa_monitor.wheel.wheel import Wheel


PROGRAM: Final = "rwa-monitor"
WIDTH_IN_FILES: Final = 120  # characters of a line

# Exit codes; 0 is done.
FAILED: Final = click.ClickException.exit_code  # or a check found a difference
WRONG_USE: Final = click.UsageError.exit_code  # or bad input
UNREADABLE: Final = 3  # done, but bytes of the input could not be read

Item = TypeVar("Item")


def log(*messages: str) -> None:
    """Write messages to stderr, each in one line; empty ones are left out."""
    for message in filter(None, messages):
        click.echo(f"{PROGRAM}: {' '.join(message.split())}", err=True)


def console_of_stdout() -> Console:
    """Return the console for stdout; without a terminal, lines have a fixed width."""
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = WIDTH_IN_FILES
    return console


def track(items: Iterable[Item], total: int, description: str) -> Iterable[Item]:
    """Yield items with a progress bar on stderr, of `total` items; no bar if stderr is not a terminal."""
    from rich.console import Console
    from rich.progress import track as rich_track

    console = Console(stderr=True)
    return rich_track(items, description, total=total, console=console, transient=True, disable=not console.is_terminal)


@contextmanager
def status_line(description: str) -> Iterator[Callable[[str], None]]:
    """Provide a function that shows the current step on one line of stderr; no output if that is not a terminal."""
    from rich.console import Console

    with Console(stderr=True).status(description) as status:
        yield lambda step: status.update(f"{description}: {step}")


@contextmanager
def stop_on_signals() -> Iterator[Event]:
    """Provide an event that SIGINT or SIGTERM sets; a SIGINT after that raises KeyboardInterrupt as usual."""
    stop = Event()

    def stop_cleanly(*_: object) -> None:
        # In another thread: if the signal interrupts `stop.wait`, this thread may hold the lock that `set` waits for.
        _thread.start_new_thread(stop.set, ())
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = {number: signal.signal(number, stop_cleanly) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


# ---- options ---------------------------------------------------------------------------------------------------------


# Transports that authenticate the other end.
_PROTECTED: Final = ("tls", "quic", "unixsock-stream", "unixpipe")

Decorated = TypeVar("Decorated", bound=Callable[..., Any])

# click only makes a Path of it; the code that reads a file reports, with the reason, if it cannot be used.
FILE: Final = click.Path(path_type=Path)


class Whole(click.IntRange):
    """A whole number in a range; `name` replaces click's "integer range" in messages to users."""

    name = "whole number"


class Real(click.FloatRange):
    """A number in a range; NaN, which click accepts, is refused."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number."""
        number = float(super().convert(value, param, ctx))
        if math.isnan(number):
            self.fail("nan is no number here", param, ctx)
        return number


def option(names: str, kind: Any, metavar: str | None, about: str, **more: Any) -> Callable[[Decorated], Decorated]:
    """Return click's option, from its names, its type, the placeholder of its value in the help, and its help text."""
    return click.option(*names.split(), type=kind, metavar=metavar, help=about, **more)


def flag(name: str, about: str) -> Callable[[Decorated], Decorated]:
    """Return click's option without a value."""
    return click.option(name, is_flag=True, help=about)


def as_one(name: str, make: Callable[..., Any], *options: Callable[[Any], Any]) -> Callable[[Decorated], Decorated]:
    """Return a decorator that adds options to a command, which receives them as one value.

    Parameters
    ----------
    name
        The parameter of the command.
    make
        Makes its value; called with the values of the options by name.
    options
        Decorators of click.
    """

    def add(command: Decorated) -> Decorated:
        """Return a command that takes the options and passes them on as one value."""

        @functools.wraps(command)
        def with_one(**given: Any) -> Any:
            return command(**{name: make(**{key: given.pop(key) for key in added})}, **given)

        known = len(getattr(command, "__click_params__", ()))
        for one in reversed(options):
            one(with_one)
        added = [parameter.name for parameter in with_one.__click_params__[known:]]  # type: ignore[attr-defined]
        return with_one  # type: ignore[return-value]

    return add


speed_option = option(
    "--speed", Real(0, min_open=True), "X", "Times real time when publishing; inf: as fast as it goes.", default=1.0
)
wheel_option = option("--wheel", FILE, "W.toml", "Constants of the wheel.  [default: the built-in wheel]")
wheel_folder_option = option(
    "--wheel-folder",
    FILE,
    "DIR",
    "Wheel files of single wheels, DIR/SPACECRAFT/WHEEL.toml; all others are that of --wheel.",
)
model_option = option("--model", FILE, "M.json", "Trained classifiers.  [default: the built-in model]")
motor_off_option = flag(
    "--motor-off", "The wheel runs down with its motor off: friction is -J dω/dt, speed and inertia_kg_m2 are enough."
)
method_option = option(
    "--method", click.Choice(["joint", "paper"]), None, "Assign jumps jointly, or as in the paper.", default="joint"
)
recording_output_option = option("-o --output", FILE, "OUT.mcap", "Where to write; must not exist.", required=True)
record_option = option("--record", FILE, "DIR", "Folder of the recordings and the history.", default=Path("recordings"))
port_option = option("--port", Whole(0, 65535), "P", "Port of the page, on loopback.  [default: 8750, or any]")
no_browser_option = flag("--no-browser", "Open no browser.")
scheduler_option = option(
    "--scheduler", str, "ADDR", "Work on this Dask cluster, such as tcp://host:8786.  [default: this machine]"
)
workers_option = option("--workers", Whole(1, 1024), "N", "Processes on this machine.  [default: cores]")


def _setup(wheel: Path | None, model: Path | None, wheel_folder: Path | None = None) -> Setup:
    from rwa_monitor.monitor.setup import Setup, read_model, read_wheel, read_wheel_folder

    return Setup(read_wheel(wheel), read_wheel_folder(wheel_folder) if wheel_folder else {}, read_model(model))


setup_options = as_one("setup", _setup, wheel_option, model_option)
fleet_options = as_one("setup", _setup, wheel_option, wheel_folder_option, model_option)


def _decoding(**files: Path | None) -> Decoding:
    from rwa_monitor.telemetry.reader import read_decoding

    return read_decoding(files["map"], files["xtce"])


_DECODING: Final = (
    option("--map", FILE, "MAP.toml", "For space packets and ROS 2 bags: which parameter or topic is which channel."),
    option("--xtce", FILE, "X.xml", "For space packets: what is in them."),
)
decoding_options = as_one("decoding", _decoding, *_DECODING)


def _bus(**options: Any) -> BusOptions:
    from rwa_monitor.monitor.bus import BusOptions

    return BusOptions(**options)


bus_options = as_one(
    "bus",
    _bus,
    option("-m --mode", click.Choice(["peer", "client", "router"]), None, "Role in the Zenoh network."),
    option("-e --connect", str, "ENDPOINT", "Connect there, such as tcp/HOST:7447 (repeatable).", multiple=True),
    option("-l --listen", str, "ENDPOINT", "Listen, as on tcp/127.0.0.1:7447 (repeatable).", multiple=True),
    option("-c --config", FILE, "FILE", "Zenoh configuration (JSON5), as for TLS."),
    flag("--no-multicast-scouting", "Do not look for others by multicast: the default, unless -c sets otherwise."),
)


def is_loopback(host: str) -> bool:
    """Return whether a host is on loopback, so unreachable from other machines; an IPv6 address may be in brackets."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def warn_if_alone(bus: BusOptions) -> None:
    """Log a warning if the bus is limited to this process, or open to everybody on the network."""
    if not (bus.connect or bus.listen or bus.config):
        log("without -e, -l or -c the bus is this process alone; for example -l tcp/127.0.0.1:7447, and -e elsewhere")
    for endpoint in bus.listen:
        protocol, _, address = endpoint.partition("/")
        host, colon, _ = address.rpartition(":")
        # An endpoint without an address or port is not listened on: it is refused when the bus is opened.
        if colon and protocol not in _PROTECTED and not is_loopback(host):
            log(f"{endpoint} lets in everybody who reaches it; docker/client.json5 shows how to join by mutual TLS")


@contextmanager
def on_bus(bus: BusOptions) -> Iterator[tuple[Event, zenoh.Session]]:
    """Provide an event that signals set (`stop_on_signals`) and an open session, after `warn_if_alone`."""
    from rwa_monitor.monitor.bus import open_session

    warn_if_alone(bus)
    with stop_on_signals() as stop, open_session(bus) as session:
        yield stop, session


# ---- recordings ------------------------------------------------------------------------------------------------------


class Recordings:
    """The recordings given to a command, how they are read, and the problems with them so far.

    Attributes
    ----------
    files
        Their paths.
    decoding
        Settings to read files that do not name their channels.
    failures
        Recordings that cannot be used, and why.
    """

    def __init__(self, files: tuple[Path, ...], decoding: Decoding) -> None:
        self.files = files
        self.decoding = decoding
        self.failures: list[tuple[Path, str]] = []
        self._log_once = functools.cache(log)
        self._unreadable = False

    @property
    def status(self) -> int:
        """Exit code so far: 2 if a recording failed, else 3 if bytes of one could not be read, else 0."""
        if self.failures:
            return WRONG_USE
        return UNREADABLE if self._unreadable else 0

    def failed(self, file: Path, error: str) -> None:
        """Register and log why a recording cannot be used."""
        self.failures.append((file, error))
        log(error)

    def done(self, problems: Sequence[str], notes: Iterable[str]) -> None:
        """Log problems and notes of a recording, equal lines once; `problems` are bytes that could not be read."""
        for note in (*problems, *notes):
            self._log_once(note)
        self._unreadable |= bool(problems)

    def of_one_wheel(
        self, wheel: Wheel | None, others: Sequence[Path] | None = None
    ) -> tuple[list[tuple[str, Samples]], Wheel | None]:
        """Read the files, or `others` in their place, as recordings of one wheel.

        Returns
        -------
        samples
            Name and samples of each file.
        wheel
            The one given, else the first that is attached to a file; None where there is none.

        Raises
        ------
        InputError
            If a file cannot be used, or holds several wheels.
        """
        from rwa_monitor.monitor.telemetry_files import read_telemetry
        from rwa_monitor.telemetry.files import display_name
        from rwa_monitor.telemetry.reader import joined, only_wheel

        found: list[tuple[str, Samples]] = []
        decoding = self.decoding.of_wheel(wheel)
        for file in self.files if others is None else others:
            content = read_telemetry(file, decoding)
            self.done(content.problems, content.notes)
            telemetry = only_wheel(content, display_name(file))
            wheel = wheel or telemetry.constants
            found.append((str(file), joined(telemetry)))
        return found, wheel


recordings_options = as_one(
    "recordings",
    lambda files, **decoding: Recordings(files, _decoding(**decoding)),
    click.argument("files", nargs=-1, required=True, type=FILE, metavar="FILE..."),
    *_DECODING,
)


def known_wheel(wheel: Path | None, motor_off: bool) -> Wheel | None:
    """Return the wheel of a file, with its motor off if `motor_off`; None where there is no file.

    Raises
    ------
    InputError
        If the file cannot be used, or if the motor is to be off and no inertia is known.
    """
    from rwa_monitor.monitor.setup import read_wheel

    known = read_wheel(wheel) if wheel else None
    if not motor_off:
        return known
    if known is None or known.inertia_kg_m2 is None:
        raise InputError("--motor-off", "needs inertia_kg_m2 under [wheel] of the file given with --wheel")
    return known.model_copy(update={"friction": known.friction.model_copy(update={"motor_off": True})})
