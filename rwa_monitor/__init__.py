"""Diagnosis of reaction wheels from their bearing friction, live on a bus and from recordings.

Public are `__version__` and the names in `__all__` of `rwa_monitor.api`, which are imported when first used, those in
`__all__` of `rwa_monitor.plot` for pictures, `read_results` of `rwa_monitor.batch.store`, and, to write an effect of
one's own, `rwa_monitor.wheel.effects.base` and `register` of `rwa_monitor.wheel.effects.catalogue`. A change of these
is recorded in the changelog; everything else may change at any time.
"""

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str

    from rwa_monitor import plot as plot
    from rwa_monitor.api import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: the command's --help needs none of the modules behind them."""
    if name == "__version__":
        return _build()
    if name == "plot":
        return import_module("rwa_monitor.plot")
    if name == "__all__":
        return [*import_module("rwa_monitor.api").__all__, "__version__", "plot"]
    # Python also looks here for a module of the package that is imported by its name: the API is not needed for that.
    known = name.startswith("_") or find_spec(f"{__name__}.{name}")
    if not known and name in (api := import_module("rwa_monitor.api")).__all__:
        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the names of the package, the public ones included."""
    return sorted([*globals(), *__getattr__("__all__")])


@cache
def _build() -> str:
    """Return the version of the installed package; between releases its local part names the commit.

    It is used only in output that is not compared: `--version`, the settings of a recording, a report's foot. Diagnoses
    give the release alone (`rwa_monitor.words`), because their bytes must not differ from commit to commit.

    Returns
    -------
    str
        `0.1.0` of a release; `0.1.0.post1.dev12+g8e3a56a12` of commit 8e3a56a12 (PEP 440, as setuptools-scm writes it),
        `….d20261121` appended if files were changed there; `….editable` appended where the package was installed so
        that its files can have changed since (PEP 610); `0+unknown` where it was not installed, only found on the path.
    """
    import json
    from importlib.metadata import PackageNotFoundError, distribution
    from pathlib import Path
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    try:
        installed = distribution("rwa-monitor")
    except PackageNotFoundError:
        return "0+unknown"
    origin = json.loads(installed.read_text("direct_url.json") or "{}")
    editable = origin.get("dir_info", {}).get("editable")
    folder = Path(url2pathname(urlsplit(origin["url"]).path)) if editable else Path(str(installed.locate_file("")))
    if (folder / "rwa_monitor").resolve() != Path(__file__).resolve().parent:
        return "0+unknown"
    return f"{installed.version}{'.' if '+' in installed.version else '+'}editable" if editable else installed.version
