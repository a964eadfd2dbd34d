"""The speed benchmark: this package, peers and lower limits timed in one run, so that ratios are meaningful."""
