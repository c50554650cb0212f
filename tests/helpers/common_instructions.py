"""Importing this before NumPy makes it compute alike on every x86 processor with AVX2.

NumPy's exp, log, sin, cos and powers, and sums of products by OpenBLAS, have other last bits with other vector
instructions. The ledger is made without those of AVX-512, so that it holds with and without them.
"""

from __future__ import annotations

import os
import platform
from pathlib import Path

if platform.machine() in ("x86_64", "AMD64"):
    os.environ.setdefault("NPY_DISABLE_CPU_FEATURES", "X86_V4")
    told = Path("/proc/cpuinfo")
    if told.is_file() and " avx2 " in told.read_text():
        os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")
