"""What the project measures of itself: each folder or file is one question, and a target of the Makefile runs it."""

import os

# One thread for linear algebra in every process, before numpy is imported: workers share the cores, and what is timed
# is the work of one.
os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
