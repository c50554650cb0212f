"""What tests of several layers share: import it by name, ``from helpers.dask_cluster import Cluster``."""

import os

# Before NumPy is imported: a fit of ten numbers by threads of OpenBLAS takes four times the processor time, as they
# wait for each other by spinning, and xdist has a worker for each processor already. Programs that tests start
# inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
