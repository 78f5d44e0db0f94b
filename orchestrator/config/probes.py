"""``output.probes``: values that are asked of the solution. A kind brings the model of its own
entries, which a key tells that it alone has; none is known here.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from orchestrator.config.base import ByKey, Name, Part
from orchestrator.registry import PROBES

Quantity = Literal["displacement", "stress"]


class ProbeEntry(Part):
    """Keys that the entries of all kinds understand."""

    name: Annotated[str, Field(pattern=r"^\w[\w. -]*$")] | None = Field(None, description=(
        "in the results; none: probe_1, probe_2, … by its place in the list"))
    part: Name | None = Field(None, description=(
        "name of the volume or body that is meant, shell wildcards allowed; none: whichever is "
        "there"))


Probes = list[ByKey(ProbeEntry, PROBES, "on").mapping]
