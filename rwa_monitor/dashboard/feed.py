"""The feed: what comes from the bus goes to every open page, in frames, over one WebSocket each.

A frame is a JSON array of entries {key, received_wall_ns, message}; `message` follows the bus's schema of its key. Of
`status` only the latest of each wheel is sent in a frame. A page that does not keep up is let go and comes again,
rather than falling behind without a sign.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from typing import Final

from rwa_monitor.dashboard.fleet import Received
from rwa_monitor.messages import dump_json

FRAME_PERIOD_S: Final = 0.1
BEAT_PERIOD_S: Final = 1.0  # a page without a beat for some seconds knows that the server is gone
MAX_FRAMES: Final = 100  # that wait for one page
MAX_ENTRIES: Final = 20_000  # of one frame
BEAT_KEY: Final = "dashboard/beat"


class Client:
    """One open page: the frames that wait for it, and the wheel whose samples it wants."""

    def __init__(self) -> None:
        self.frames: asyncio.Queue[str | None] = asyncio.Queue(MAX_FRAMES)
        self.watches = ""
        self.lost = False

    def put(self, frame: str) -> None:
        """Queue a frame, or give the page up."""
        try:
            self.frames.put_nowait(frame)
        except asyncio.QueueFull:
            self.lost = True
            with suppress(asyncio.QueueEmpty):
                self.frames.get_nowait()
            self.frames.put_nowait(None)


class Hub:
    """Gathers what comes and hands it out. Everything but `post` belongs to the event loop."""

    def __init__(self) -> None:
        self.clients: set[Client] = set()
        self.notes: dict[str, str] = {}  # what is wrong with the dashboard itself, in words, by what it is
        self._loop: asyncio.AbstractEventLoop | None = None
        self._entries: list[Received] = []
        self._statuses: dict[str, Received] = {}
        self._samples: list[Received] = []

    def post(self, received: Received) -> None:
        """Take a message from any thread; before the server runs, and after it, nobody is there to see it."""
        if self._loop is not None:
            with suppress(RuntimeError):  # the loop has just ended
                self._loop.call_soon_threadsafe(self._take, received)

    def note(self, what: str, trouble: str) -> None:
        """Tell every page what is wrong with something of the dashboard, "" where nothing is."""
        if trouble:
            self.notes[what] = trouble
        else:
            self.notes.pop(what, None)

    def watched(self, wheel: str) -> bool:
        """Tell whether a page wants the samples of a wheel ("spacecraft/wheel")."""
        return any(client.watches == wheel for client in tuple(self.clients))

    def _take(self, received: Received) -> None:
        if not self.clients:
            return
        if received.key.endswith("/status"):
            self._statuses[received.key] = received
        elif received.key.endswith("/samples"):
            self._samples.append(received)
        elif len(self._entries) < MAX_ENTRIES:
            self._entries.append(received)

    async def run(self) -> None:
        """Send frames until cancelled."""
        self._loop = asyncio.get_running_loop()
        beat_due = 0.0
        while True:
            await asyncio.sleep(FRAME_PERIOD_S)
            now = self._loop.time()
            if now >= beat_due:
                beat_due = now + BEAT_PERIOD_S
                beat = dump_json({"wall_ns": time.time_ns(), "notes": [*self.notes.values()]})
                self._entries.append(Received(BEAT_KEY, beat, time.time_ns()))
            self.flush()

    def flush(self) -> None:
        """Hand out what has been gathered."""
        entries = [*self._statuses.values(), *self._entries]
        samples = self._samples
        self._statuses, self._entries, self._samples = {}, [], []
        shared = b",".join(entry.to_json() for entry in entries)
        for client in tuple(self.clients):
            wanted = f"rwa/{client.watches}/samples"
            own = [entry.to_json() for entry in samples if entry.key == wanted]
            body = b",".join([shared, *own] if shared else own)
            if body:
                client.put("[" + body.decode() + "]")

    def close(self) -> None:
        """Take nothing more."""
        self._loop = None


def frame(entries: list[Received]) -> str:
    """Return entries as one frame."""
    return "[" + b",".join(entry.to_json() for entry in entries).decode() + "]"
