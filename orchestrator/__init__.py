"""Multiscale LATIN domain decomposition around an untouched finite element code.

Data flows one way: configuration → scene → black box → method → results.
"""

import os

# The cores belong to the black box: numpy's threads would only spin against its processes.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"

