"""How the program names itself in what it writes: messages, recordings, reports.

The version of the installed package, which names the commit it was built from, is `rwa_monitor.__version__` (build.py).
"""

from __future__ import annotations

from typing import Final

# In what must be the same bytes wherever and whenever it is made: the release whose numbers these are. Raised by hand
# with a release that changes a diagnosis. The version of the package counts commits and does not belong there: it would
# make equal diagnoses differ.
RELEASE: Final = "0.1.0"
SOFTWARE: Final = f"rwa-monitor {RELEASE}"
