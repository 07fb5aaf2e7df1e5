"""Tests of all packages; the folders are those of the code."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""Before NumPy loads. As many test processes as cores, each with as many threads of OpenBLAS, spend
half of their time waiting for each other: planning tests took twice the CPU time."""
