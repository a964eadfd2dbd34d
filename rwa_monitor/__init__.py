"""Diagnosis of reaction wheels from their bearing friction, live on a bus and from recordings."""

__version__ = "0.1.0"

# How the program names itself in what it writes: messages, recordings, models.
SOFTWARE = f"rwa-monitor {__version__}"
