"""The parts of a document (headings, tables, pictures) as Markdown, and a document as one HTML
file.
"""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Sequence
from pathlib import Path

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 60rem; margin: 2rem auto;
  padding: 0 1rem }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums }
th, td { text-align: left; vertical-align: top; padding: .25rem 1rem .25rem 0;
  border-bottom: 1px solid #ddd }
img { max-width: 100% } em { color: #555; font-size: .9em }
pre { background: #f6f6f6; padding: 1rem; overflow: auto; max-height: 30rem; font-size: .85em }
td[style*="right"], th { white-space: nowrap }
div.wide { overflow-x: auto }
strong { background: #fff0c2; color: #7a2e00; padding: .1rem .4rem;
  border-left: .3rem solid #d55e00 }
@media print {
  @page { margin: 15mm }
  body { font-size: 10pt; max-width: none; margin: 0; padding: 0 }
  h1, h2, h3 { break-after: avoid }
  tr, img { break-inside: avoid }
  thead { display: table-header-group }
  td, th { padding-right: .5rem } img { max-height: 18cm }
  pre { max-height: none; overflow: visible; white-space: pre-wrap }
  div.wide { overflow: visible; font-size: 7.5pt }
  strong { -webkit-print-color-adjust: exact; print-color-adjust: exact }
}"""
# What Markdown would take for code, the end of a table's cell, emphasis (a * that begins it, a _
# that ends it), an entity or a link.
_MARKS = re.compile(r"[\\`|]|\*(?=\S)|_(?!\w)|&(?=#?\w+;)|\](?=[(\[:])")


_FIGURE = re.compile(r"(?:figures/)?\w[\w.-]*\.png")


class Marked(str):
    """Text that is Markdown already."""

    @classmethod
    def of(cls, text: str) -> Marked:
        """A sentence that stands out."""
        return cls(f"**{plain(text)}**")


def plain(text: str) -> str:
    """Text that Markdown shows as it is."""
    return text if isinstance(text, Marked) else _MARKS.sub(r"\\\g<0>", text)


def heading(text: str, level: int = 2) -> str:
    return f"{'#' * level} {plain(text)}"


def section(title: str, *parts: str, level: int = 2) -> list[str]:
    """Parts below a heading; nothing where all of them are empty."""
    return [heading(title, level), *filter(None, parts)] if any(parts) else []


def table(head: Sequence[str], rows: Sequence[Sequence[str]], numeric: bool = False) -> str:
    """Rows of texts below a ``head``, nothing without rows; a text of several lines takes several
    rows.

    numeric : columns after the first are aligned right
    """
    if not rows:
        return ""
    rule = ["---"] + ["---:" if numeric else "---"] * (len(head) - 1)
    lines = [[plain(cell) for cell in head], rule]
    for row in rows:
        cells = [plain(cell).split("\n") for cell in row]
        lines += [[cell[k] if k < len(cell) else "" for cell in cells] for k
                  in range(max(map(len, cells)))]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def picture(path: str, text: str) -> str:
    """An image file, ``path`` relative to the document's folder, above what it shows."""
    return f"![{plain(text)}]({path})\\\n*{plain(text)}*"


def page(markdown: str, folder: Path, title: str) -> str:
    """One HTML file of a document in Markdown, with its pictures (PNG, read from ``folder``)
    inside.
    """
    from markdown_it import MarkdownIt  # no more than a report needs it

    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    blocks = parser.parse(markdown)
    for part in (part for block in blocks for part in block.children or () if part.type == "image"):
        found = _FIGURE.fullmatch(str(part.attrs["src"]))
        if not found:  # a text that looks like a picture: no other file gets into the page
            part.attrs["src"] = ""
            continue
        data = base64.b64encode((folder / part.attrs["src"]).read_bytes()).decode()
        part.attrs["src"] = f"data:image/png;base64,{data}"
    body = parser.renderer.render(blocks, parser.options, {})
    body = body.replace("<table>", '<div class="wide"><table>').replace("</table>",
                                                                        "</table></div>")
    return ('<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f"<title>{html.escape(title)}</title>\n"
            f"<style>{_STYLE}\n</style>\n</head>\n<body>\n{body}</body>\n</html>\n")
