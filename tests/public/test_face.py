"""These tests hold whatever stands below the public face: they import nothing of that."""

import ast
from pathlib import Path

import orchestrator
import pytest

HERE = Path(__file__).parent
PRIVATE = {"benchmarks", *(path.stem for path in HERE.parent.glob("*.py"))}


@pytest.mark.parametrize("path", sorted(HERE.glob("*.py")), ids=lambda path: path.stem)
def test_only_the_public_face_is_imported(path):
    """``orchestrator`` and names in its ``__all__``; no study, no helper of other tests."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            modules, names = [node.module], {alias.name for alias in node.names}
            assert node.module != "orchestrator" or names <= {*orchestrator.__all__}
        else:
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        for name in modules:
            assert name.split(".")[0] not in PRIVATE and not name.startswith("orchestrator."), name
