"""Diagnoses over months: what was found, when, what alarm it raised, and who has seen it."""
