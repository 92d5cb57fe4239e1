"""Reports as one HTML page that needs nothing else."""
from pathlib import Path
from typing import Iterable, Sequence

import jinja2

from shsa_core.cli._drawing import CannotDraw, draw
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.text import LONGEST_LINE, shown

REPORT = Path(__file__).resolve().parent / "templates" / "report.html"


def page(ontology: Ontology, som: Som, summary: Sequence[str], tables: Iterable[object]) -> str:
    """The resilience report: in short, the tables, and the graph of the ontology as SVG."""
    svg, not_drawn = "", ""
    try:
        svg = draw(ontology, som.sources, "svg").decode()
    except CannotDraw as error:
        not_drawn = str(error)
    return render(
        REPORT,
        summary=summary,
        tables=tables,
        # The XML declaration has no place inside a page.
        svg=svg[svg.index("<svg") :] if svg else "",
        not_drawn=not_drawn,
    )


def render(template: Path, **values: object) -> str:
    """The page that a template makes of some values."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(str(template.parent)),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_printable,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(template.name).render(**values)


def _printable(value: object) -> object:
    """What a template writes: text of the models as it may be shown, and the drawing as it is."""
    if type(value) is not str:
        return value
    return "\n".join(shown(line, LONGEST_LINE) for line in value.split("\n"))
