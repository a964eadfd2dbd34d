"""Diagnosis of reaction wheels from their bearing friction, live on a bus and from recordings."""

__version__ = "0.1.0"
