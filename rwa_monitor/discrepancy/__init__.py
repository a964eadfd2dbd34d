"""What the simulation gets wrong: records, search, extension, gain, report."""
