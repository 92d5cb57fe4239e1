"""Sphinx's part of the site: pages ask for a part of the reference by its name."""
from typing import Any, Dict, List

from docutils import nodes
from docutils.statemachine import StringList
from pygments.lexers.special import TextLexer
from reference_tables import PARTS
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from shsa_core import __version__


class Reference(SphinxDirective):
    """A part of the reference: {reference} followed by its name."""

    required_arguments = 1

    def run(self) -> List[nodes.Node]:
        """The part, read as Markdown where it stands."""
        name = self.arguments[0]
        if name not in PARTS:
            raise self.error(f"there is no part {name}; there are {', '.join(PARTS)}")
        lines = PARTS[name]().splitlines()
        node = nodes.section()
        node.document = self.state.document
        self.state.nested_parse(StringList(lines, source=name), 0, node, match_titles=True)
        return list(node.children)


def setup(app: Sphinx) -> Dict[str, Any]:
    """Say to Sphinx what there is."""
    app.add_directive("reference", Reference)
    app.add_lexer("mermaid", TextLexer)
    return {"version": __version__, "parallel_read_safe": True, "parallel_write_safe": True}
