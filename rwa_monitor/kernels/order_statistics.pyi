from rwa_monitor.samples import FloatArray

def median(values: FloatArray) -> float:
    """Return the median of finite numbers, float64 (n,), n > 0: the mean of the two in the middle where n is even."""

def sum_up(values: FloatArray) -> float:
    """Return the sum, float64 (n,), in an order of its own that is the same on every machine."""
