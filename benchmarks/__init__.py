"""Benchmarks of the project: each folder or file answers one question, and a target of the Makefile runs it."""

import os

# One thread for linear algebra in every process, set before numpy is imported: workers share the cores, and each timing
# is that of a single thread.
os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
