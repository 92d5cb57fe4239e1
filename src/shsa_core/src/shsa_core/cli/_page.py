"""The resilience report as one HTML page that needs nothing else."""
from pathlib import Path
from typing import Iterable, Sequence

import jinja2

from shsa_core.cli._drawing import CannotDraw, draw
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som

TEMPLATES = Path(__file__).resolve().parent / "templates"


def page(ontology: Ontology, som: Som, summary: Sequence[str], tables: Iterable[object]) -> str:
    """The page: what is said in short, the tables, and the graph of the ontology as SVG."""
    svg, not_drawn = "", ""
    try:
        svg = draw(ontology, som.sources, "svg").decode()
    except CannotDraw as error:
        not_drawn = str(error)
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(str(TEMPLATES)),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("report.html").render(
        summary=summary,
        tables=tables,
        # The XML declaration has no place inside a page.
        svg=svg[svg.index("<svg") :] if svg else "",
        not_drawn=not_drawn,
    )
