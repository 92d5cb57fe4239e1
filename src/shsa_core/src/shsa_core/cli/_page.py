"""The resilience report as one HTML page that needs nothing else."""
import html
import os
import tempfile
from typing import Iterable, List, Sequence

from shsa_core.cli._drawing import TooLarge, draw
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som

STYLE = """
body { font: 15px/1.5 sans-serif; margin: 2em auto; max-width: 75em; padding: 0 1em; color: #222 }
table { border-collapse: collapse; margin: 1em 0 }
th, td { border: 1px solid #bbb; padding: .3em .6em; text-align: left; vertical-align: top; white-space: pre-line }
th { background: #eee }
figure { margin: 1em 0; overflow-x: auto }
"""


def page(ontology: Ontology, som: Som, summary: Sequence[str], tables: Iterable) -> str:
    """The page: what is said in short, the tables, and the graph of the ontology as SVG."""
    parts: List[str] = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8"><title>Resilience</title>',
        f"<style>{STYLE}</style></head><body><h1>Resilience</h1>",
        *(f"<p>{html.escape(line)}</p>" for line in summary),
    ]
    for table in tables:
        parts.append(f"<h2>{html.escape(table.title)}</h2>")
        if not table.rows:
            parts.append(f"<p>{html.escape(table.nothing)}</p>")
            continue
        parts.append("<table><tr>" + _cells("th", table.columns) + "</tr>")
        parts += ["<tr>" + _cells("td", row) + "</tr>" for row in table.rows]
        parts.append("</table>")
    parts.append("<h2>Ontology</h2>")
    try:
        parts.append(f"<figure>{_svg(ontology, som)}</figure>")
    except TooLarge as error:
        parts.append(f"<p>Not drawn: {html.escape(str(error))}.</p>")
    return "\n".join([*parts, "</body></html>"]) + "\n"


def _cells(tag: str, texts: Iterable[str]) -> str:
    return "".join(f"<{tag}>{html.escape(text)}</{tag}>" for text in texts)


def _svg(ontology: Ontology, som: Som) -> str:
    """The graph, without the XML declaration, which has no place inside a page."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "ontology.svg")
        draw(ontology, som, path)
        with open(path, encoding="utf-8") as stream:
            text = stream.read()
    return text[text.index("<svg") :]
