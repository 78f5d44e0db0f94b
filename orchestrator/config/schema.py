"""The configuration's JSON schema, for editors that complete and check as one types.

It is the model's own: keys, types, bounds and descriptions. Rules that concern several keys are ``check``'s.
"""

from __future__ import annotations

import json

from orchestrator.config.model import Config

DRAFT = "https://json-schema.org/draft/2020-12/schema"


def schema() -> str:
    """The schema as text, with an end of line.

    Notes
    -----
    An entry that names a law or a code is any of their models; a solver of one's own takes any keys.
    """
    head = {"$schema": DRAFT, "$comment": "written by: orchestrator schema > configs/schema.json"}
    return json.dumps({**head, **Config.model_json_schema()}, indent=1, ensure_ascii=False) + "\n"
