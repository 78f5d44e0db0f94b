"""The YAML's model, its defaults with their reasons, and errors with line numbers.

Knows neither numpy nor any finite element code, so that checking a file is immediate.
"""

from .load import Loaded, config_from, load_config, place
from .model import Config
from .steps import steps, vectors_per_step

__all__ = ["Config", "Loaded", "config_from", "load_config", "place", "steps", "vectors_per_step"]
