"""Multiscale LATIN domain decomposition around an untouched finite element code.

Data flows one way: configuration → scene → black box → method → results.
"""

__version__ = "0.1.0"
