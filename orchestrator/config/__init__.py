"""The YAML's model, its defaults with their reasons, and errors with line numbers.

Knows neither numpy nor any finite element code, so that checking a file is immediate.

``model`` has the whole, ``mesh``, ``boundary``, ``method``, ``blackbox`` and ``entry`` (of interface laws) its parts.
``load`` goes from file to configuration: ``text`` parses, ``overrides`` changes, ``files`` looks files up, ``checks`` has
the rules that concern several keys, ``explain`` words what is wrong, ``source`` says where. ``steps`` counts load steps.
"""

from orchestrator.config.load import Loaded, config_from, load_config, located
from orchestrator.config.model import Config
from orchestrator.config.steps import factors, steps

__all__ = ["Config", "Loaded", "config_from", "factors", "load_config", "located", "steps"]
