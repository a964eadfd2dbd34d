"""The command line: each command parses its options, calls the other packages, and prints; it does nothing else."""
