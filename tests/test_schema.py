"""The JSON schema takes what the configuration takes, and the shipped one is up to date."""

import json
from copy import deepcopy
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

from orchestrator.config.reference import schema

CONFIGS = Path(__file__).parents[1] / "configs"


@pytest.fixture(scope="module")
def validator():
    jsonschema.Draft202012Validator.check_schema(json.loads(schema()))
    return jsonschema.Draft202012Validator(json.loads(schema()))


def read(name):
    return YAML(typ="safe").load(CONFIGS / name)


@pytest.mark.parametrize("name", sorted(p.name for p in CONFIGS.glob("*.yaml")))
def test_shipped_configurations_name_the_schema_and_obey_it(validator, name):
    assert [e.message for e in validator.iter_errors(read(name))] == []
    assert (CONFIGS / name).read_text().startswith("# yaml-language-server: $schema=schema.json\n")


@pytest.mark.parametrize("path, value", [
    (("materials", 0, "young"), -1.0), (("materials", 0, "yuong"), 1.0), (("mesh", "beam", "h"), "fine"),
    (("method", "tolerance", "error"), "small"), (("boundary", 0, "displacement"), [0, 0]),
    (("interfaces",), [{"law": "contct"}]), (("interfaces",), [{"law": "contact", "frction": 0.1}]),
    (("interfaces",), [{"law": "perfect", "friction": 0.1}]), (("blackbox",), {"code": "freefem", "wrokers": 2}),
    (("subdomains",), "group")])
def test_misspelt_keys_and_wrong_values_are_found(validator, path, value):
    data = deepcopy(read("traction_beam.yaml"))
    *front, last = path
    at = data
    for key in front:
        at = at[key]
    at[last] = value

    assert list(validator.iter_errors(data))


def test_solvers_of_ones_own_may_have_any_options(validator):
    data = read("traction_beam.yaml") | {"blackbox": {"code": "solver.py", "threads": 3}}

    assert not list(validator.iter_errors(data))
