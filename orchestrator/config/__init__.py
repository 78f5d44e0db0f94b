"""The YAML's model, its defaults with their reasons, and errors with line numbers.

Knows neither numpy nor any finite element code, so that checking a file is immediate.
"""

from orchestrator.config.load import Loaded, config_from, load_config, located
from orchestrator.config.model import Config
from orchestrator.config.steps import steps, vectors_per_step

__all__ = ["Config", "Loaded", "config_from", "load_config", "located", "steps", "vectors_per_step"]
