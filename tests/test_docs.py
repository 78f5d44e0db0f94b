"""Documents keep their word: what they name exists, what they show is accepted, and nothing is left out."""

import ast
import io
import os
import re
import shlex
import signal
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

from benchmarks.registry import STUDIES
from benchmarks.studies import gallery
from benchmarks.validation import page as validation
from orchestrator.cli import app
from orchestrator.config.load import config_from
from orchestrator.config.method import Method
from orchestrator.config.model import Config

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "orchestrator"
DOCUMENTS = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
EQUATIONS = 46  # numbered in the paper
BY_NAME = [path.stem for path in DOCUMENTS]
# `file.py` `name`, `Class.name` …
MENTIONED = re.compile(r"`([\w/]+\.py)`((?:(?:, | and | )?`[\w.]+`)*)")
COMMAND = re.compile(r"(?:^|`| )orchestrator ((?:run|check|report|study|conformance|doctor|inspect|init|schema|sweep|compare)\b"
                     r"[^`\n#…*]*)")


def place(file: str) -> Path:
    """A file that a document names: of the package, or of the folder of studies beside it."""
    return (ROOT if file.startswith("benchmarks/") else PACKAGE) / file


@cache
def names_in(path: Path) -> set[str]:
    """Functions, classes, constants of a module, and the methods and fields of its classes."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        found |= assigned(node)
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}.{name}" for child in node.body for name in assigned(child)}
    return found


def assigned(node: ast.stmt) -> set[str]:
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        return {node.name}
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}


def rows(text: str) -> list[list[str]]:
    """Cells of the lines of all tables."""
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            for line in text.splitlines() if line.startswith("|")]


def code_blocks(path: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", path.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.mark.parametrize("name", ["equations.md", "glossary.md"])
def test_every_place_exists(name):
    places = MENTIONED.findall((ROOT / "docs" / name).read_text(encoding="utf-8"))
    assert len(places) > 50
    for file, names in places:
        assert place(file).is_file(), f"{name}: no file {file}"
        known = names_in(place(file))
        for wanted in re.findall(r"`([\w.]+)`", names):
            assert wanted in known, f"{name}: {file} has no {wanted}"


def test_every_equation_of_the_paper_has_its_place():
    """Mapped to code that names it in a docstring, or said to be unused, with the reason."""
    text = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8").split("## Ours")[0]
    found = {int(cells[0]): cells for cells in rows(text) if cells[0].isdigit()}
    assert sorted(found) == list(range(1, EQUATIONS + 1))
    for number, (_, meaning, where) in found.items():
        if meaning == "–":
            assert where.startswith("not used: ") and len(where) > len("not used: ") + 10, number
            continue
        files = [place(file) for file, _ in MENTIONED.findall(where)]
        assert files, f"eq. {number} has no place"
        named = any(re.search(rf"\beq\. {number}\b", file.read_text(encoding="utf-8")) for file in files)
        assert named, f"no file of {where} says eq. {number}"


def test_single_equations_are_named():
    """One search finds an equation: no ranges, no brackets."""
    for path in [*PACKAGE.rglob("*.py"), *ROOT.glob("tests/*.py"), *DOCUMENTS]:
        if path != Path(__file__):
            assert not re.search(r"\beqs\. |\beq\. ?\(|\beq\.\d", path.read_text(encoding="utf-8")), path


def anchors(path: Path) -> set[str]:
    """Of the headings of a document, as GitHub makes them."""
    titles = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("path", DOCUMENTS, ids=BY_NAME)
def test_links_lead_somewhere(path):
    for target in re.findall(r"\]\(([^)]+)\)", path.read_text(encoding="utf-8")):
        if re.match(r"\w+://", target):
            continue
        file, _, anchor = target.partition("#")
        there = (path.parent / file).resolve() if file else path
        assert there.exists(), f"{path.name}: {target}"
        assert not anchor or anchor in anchors(there), f"{path.name}: {target}"


@pytest.mark.long
def test_pages_are_made_of_every_document(tmp_path):
    """Without a warning: no reference that leads nowhere, no document outside the contents, no docstring that is no markup."""
    done = subprocess.run([sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", ROOT / "docs", tmp_path / "site"],
                          capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "searchindex.js").exists()
    linked = set(re.findall(r"\]\(docs/([\w/]+\.md)", (ROOT / "README.md").read_text(encoding="utf-8")))
    assert {"index.md", "start.md", "keys.md", "measured.md", "limits.md"} <= linked


def test_the_gallery_has_every_configuration_and_tutorial():
    """With what each says of itself, and a picture that is small; none of what is there no more."""
    rows = re.findall(r"^!\[(\w+)\]\((pictures/gallery/\w+\.png)\)\n\n(.*)\n", gallery.PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    wanted = {path.stem: gallery.told(path) for path in gallery.configurations()} | {
        path.stem: gallery.title(path) for path in gallery.tutorials()}
    assert {name: text for name, _, text in rows} == wanted and all(wanted.values()), "orchestrator study gallery --resume"
    sizes = {path.name: path.stat().st_size for path in gallery.PICTURES.iterdir()}
    assert sizes.keys() == {f"{name}.png" for name in wanted} and max(sizes.values()) <= 30e3 and sum(sizes.values()) <= 1.5e6


def test_every_key_is_told():
    """The reference is the model's, down to its words."""
    both = ("from contextlib import suppress; from orchestrator.cli import app\n"
            "for more in ([], ['--keys']):\n"
            "    with suppress(SystemExit):\n"
            "        app(['schema', *more])\n"
            "    print(flush=True, end='\\0')")
    said = subprocess.run([sys.executable, "-c", both], capture_output=True, text=True,
                          check=True).stdout  # here, tests have codes of their own
    schema, written, _ = said.split("\0")
    shipped, keys = ROOT / "configs" / "schema.json", ROOT / "docs" / "keys.md"
    assert shipped.read_text() == schema, "orchestrator schema > configs/schema.json"
    assert keys.read_text(encoding="utf-8") == written, "orchestrator schema --keys > docs/keys.md"
    told = re.findall(r"^\| `(\w+)` \|", written, flags=re.MULTILINE)
    assert keys_of(Config) <= set(told)
    assert not re.search(r"\| *\|$", written, flags=re.MULTILINE), "a key without a meaning"


@pytest.mark.parametrize("page", ["warnings", "symptoms"])
def test_messages_told_are_those_there_are(page):
    """What the page quotes stands in the program, but for what is filled in."""
    said = re.sub(r"['\"]\s*\n\s*f?['\"]", "", "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")))
    table = [row for row in rows((ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")) if '"' in row[0]]
    assert len(table) > 15
    for first, *_ in table:
        for quoted in re.findall('"([^"]+)"', first):
            assert quoted in said, quoted


@cache
def help_of(command: str) -> str:
    """What a command that there is says of itself."""
    shown = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200", "TERM": "dumb"})
    assert shown.exit_code == 0, f"no command orchestrator {command}"
    return shown.stdout


@pytest.mark.parametrize("path", DOCUMENTS, ids=BY_NAME)
def test_commands_and_files_exist(path):
    """Subcommands, their options, studies, configurations and tests that a document names."""
    text = path.read_text(encoding="utf-8")
    for command in COMMAND.findall(text):
        name, *arguments = shlex.split(command.rstrip(" ,.;:)"))
        told = help_of(name)
        for argument in arguments:
            if argument.startswith("--"):
                assert argument.partition("=")[0] in told, f"orchestrator {name} has no {argument}"
        if name == "study" and arguments and arguments[0] != "NAME":
            assert arguments[0] in STUDIES, command
    for file in re.findall(r"(?:configs|tests|meshes|freefem_scripts|orchestrator)/[\w/]+\.\w+", text):
        assert (ROOT / file).is_file(), f"{path.name}: no {file}"
    for study in re.findall(r"`study (\w+)`", text):
        assert study in STUDIES, study


@pytest.mark.long
def test_symptoms_are_as_told(tmp_path):
    """Commands of the page end with the exit code, and say in the summary what stands in italics behind them."""
    text = re.sub(r"\n +", " ", (ROOT / "docs" / "symptoms.md").read_text(encoding="utf-8"))
    tried = re.findall(r"^- `orchestrator (run [^`]+)`: exit code (\d)(.*)$", text, flags=re.MULTILINE)
    assert len(tried) > 10
    for number, (command, code, told) in enumerate(tried):
        done = subprocess.run([sys.executable, "-m", "orchestrator", *shlex.split(command), "--verbose", "--output", tmp_path / str(number),
                               "--set", "output.figures=false"], cwd=ROOT, capture_output=True, text=True, env={**os.environ, "COLUMNS": "4000"})
        assert done.returncode == int(code), f"{command}: {done.stderr}"
        for words in re.findall(r"\*([^*]+)\*", told.partition("; with")[0]):
            assert " ".join(words.split()) in " ".join((done.stdout + done.stderr).split()), command


@pytest.mark.parametrize("path", DOCUMENTS, ids=BY_NAME)
def test_configurations_shown_are_accepted(path):
    for block in code_blocks(path, "yaml"):
        data = YAML(typ="safe").load(io.StringIO(block))
        if "name" in data and "mesh" in data:
            config_from(data)


def test_validation_has_the_figures_that_were_measured():
    assert (ROOT / "docs" / "validation.md").read_text(encoding="utf-8") == validation(), \
        "python -m benchmarks.validation > docs/validation.md"


def test_the_yaml_in_full():
    """Accepted, with the defaults there are, and no key is missing."""
    text = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    block = next(b for b in code_blocks(ROOT / "docs" / "model.md", "yaml") if "max_iterations" in b)
    config = config_from(YAML(typ="safe").load(io.StringIO(block)))
    assert config.method == Method()
    missing = {key for key in keys_of(type(config)) if not re.search(rf"\b{key}\b", block)}
    assert not missing
    assert text.count("```") % 2 == 0


def keys_of(model) -> set[str]:
    """All keys of a part of the configuration and of its parts, but those of interface laws."""
    found = set()
    for name, field in model.model_fields.items():
        found.add(name)
        if name != "interfaces":
            found |= {key for part in parts_of(field.annotation) for key in keys_of(part)}
    return found


def parts_of(annotation) -> list:
    if hasattr(annotation, "model_fields"):
        return [annotation]
    return [part for argument in getattr(annotation, "__args__", ()) for part in parts_of(argument)]


@pytest.mark.long
def test_python_shown_runs_and_prints_what_it_says(tmp_path, capsys, monkeypatch):
    """Numbers behind ``print(…)   # …`` are those that are printed, but for rounding."""
    for folder in ("configs", "meshes"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    blocks = [block for path in DOCUMENTS for block in code_blocks(path, "python")
              if "sys.argv" not in block]  # scripts are called where tutorials are followed
    assert blocks
    handlers = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGPIPE, signal.SIGTERM, signal.SIGINT)}
    for block in blocks:
        exec(block, {})
        for number, handler in handlers.items():
            signal.signal(number, handler)  # gmsh, where a block begins it, gives these back to the system
        said = [numbers(line) for line in re.findall(r"^print\(.*\) *# (.*)$", block, flags=re.MULTILINE)]
        for wanted, line in zip(said, capsys.readouterr().out.splitlines(), strict=True):
            assert numbers(line) == pytest.approx(wanted, rel=1e-3)


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?(?:e[+-]\d+)?", text)]
