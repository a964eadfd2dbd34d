"""Which source the running program was built from, for whoever looks into what it did.

It belongs to what nobody compares: `--version`, the settings of a recording, a report's foot. In diagnoses stands the
release alone (`rwa_monitor.words`), for their bytes must not differ from commit to commit.
"""

from __future__ import annotations

import json
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit
from urllib.request import url2pathname

UNKNOWN: Final = "0+unknown"


@cache
def build() -> str:
    """Return the version of the installed package; between releases its local part names the commit.

    Returns
    -------
    str
        `0.1.0` of a release; `0.1.0.post1.dev12+g8e3a56a12` of commit 8e3a56a12 (PEP 440, as setuptools-scm writes it),
        `….d20261121` behind it if files were changed there; `….editable` behind it where the package was installed so
        that its files can have changed since; `0+unknown` where it was not installed, only found on the path.
    """
    try:
        installed = distribution("rwa-monitor")
    except PackageNotFoundError:
        return UNKNOWN
    project = _edited_in(installed)
    package = project / "rwa_monitor" if project else Path(str(installed.locate_file("rwa_monitor")))
    if package.resolve() != Path(__file__).resolve().parent:
        return UNKNOWN
    if project is None:
        return installed.version
    return f"{installed.version}{'.' if '+' in installed.version else '+'}editable"


def _edited_in(installed: Distribution) -> Path | None:
    """Return the folder from which an editable package is used, None of one that was copied (PEP 610)."""
    origin = json.loads(installed.read_text("direct_url.json") or "{}")
    if not origin.get("dir_info", {}).get("editable"):
        return None
    return Path(url2pathname(urlsplit(origin["url"]).path))
