"""A small document (headings, paragraphs, tables, pictures) as Markdown or as one HTML file."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Heading:
    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    text: str


@dataclass(frozen=True)
class Table:
    """``rows`` of texts below a ``head``; columns after the first are aligned right if ``numeric``."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: bool = False


@dataclass(frozen=True)
class Picture:
    """An image file with what it shows; ``path`` is relative to the document's folder."""

    path: str
    text: str


@dataclass(frozen=True)
class Listing:
    """Text shown as it is, folded away in HTML."""

    title: str
    text: str


def number(value: float | None) -> str:
    """A number for a table; a dash where there is none."""
    return "–" if value is None else f"{value:.5g}"


Block = Heading | Paragraph | Table | Picture | Listing

_STYLE = """body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 60rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; margin: 1rem 0 }
th, td { text-align: left; vertical-align: top; padding: .25rem 1rem .25rem 0; border-bottom: 1px solid #ddd }
.numeric td:not(:first-child), .numeric th:not(:first-child) { text-align: right; font-variant-numeric: tabular-nums }
img { max-width: 100% } figure { margin: 1.5rem 0 } figcaption { color: #555; font-size: .9em }
pre { background: #f6f6f6; padding: 1rem; overflow-x: auto; font-size: .85em }"""


def to_markdown(blocks: Sequence[Block]) -> str:
    """The document as Markdown; pictures are linked."""
    return "\n\n".join(_markdown(block) for block in blocks) + "\n"


def _markdown(block: Block) -> str:
    if isinstance(block, Heading):
        return f"{'#' * block.level} {block.text}"
    if isinstance(block, Paragraph):
        return block.text
    if isinstance(block, Table):
        rule = ["---"] + ["---:" if block.numeric else "---"] * (len(block.head) - 1)
        rows = [block.head, rule, *block.rows]
        return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)
    if isinstance(block, Picture):
        return f"![{block.text}]({block.path})"
    return f"### {block.title}\n\n```\n{block.text}\n```"


def to_html(blocks: Sequence[Block], folder: Path, title: str) -> str:
    """The document as one HTML file with its pictures (read from ``folder``) inside."""
    body = "\n".join(_html(block, folder) for block in blocks)
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{html.escape(title)}</title>\n'
            f"<style>\n{_STYLE}\n</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n")


def _html(block: Block, folder: Path) -> str:
    safe = html.escape
    if isinstance(block, Heading):
        return f"<h{block.level}>{safe(block.text)}</h{block.level}>"
    if isinstance(block, Paragraph):
        return f"<p>{safe(block.text)}</p>"
    if isinstance(block, Table):
        rows = [_row(block.head, "th")] + [_row(row, "td") for row in block.rows]
        return f'<table{" class=numeric" if block.numeric else ""}>\n' + "\n".join(rows) + "\n</table>"
    if isinstance(block, Picture):
        data = base64.b64encode((folder / block.path).read_bytes()).decode()
        return (f'<figure><img alt="{safe(block.text)}" src="data:image/png;base64,{data}">'
                f"<figcaption>{safe(block.text)}</figcaption></figure>")
    return f"<details><summary>{safe(block.title)}</summary><pre>{safe(block.text)}</pre></details>"


def _row(cells: Sequence[str], tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"
