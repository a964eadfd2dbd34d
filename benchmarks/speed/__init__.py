"""The speed benchmark: ours, peers and limits side by side in one run, so that ratios mean something."""
