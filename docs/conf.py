"""Settings of the documentation's site: `make docs`."""
import sys
from pathlib import Path
from typing import Any, Callable, Dict

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "docs"))

from shsa_core import __version__ as release  # noqa: E402

project = "Self-healing for robots on ROS 1"
author = "the authors of this workspace"
copyright = "the authors; BSD 3-clause"
version = release

# The workspace is the source: a link between files is right on the site and beside the code.
root_doc = "docs/index"
include_patterns = ["*.md", "docs/*.md", "docs/**/*.md", "examples/*.md", "*/*/README.md"]
exclude_patterns = ["build", "devel", "install", "results"]
extensions = ["myst_parser", "sphinx.ext.autodoc", "reference_directive"]

myst_heading_anchors = 4
myst_enable_extensions = ["deflist", "html_image"]
default_role = "code"
highlight_language = "none"
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]  # Python's own names, and those that nobody imports
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True

html_theme = "sphinx_rtd_theme"
html_title = "Self-healing for ROS 1"
html_copy_source = False
html_show_sphinx = False
html_extra_path = ["site"]
html_static_path = ["static"]
html_css_files = ["site.css"]
html_favicon = "static/icon.svg"


def give_captions_a_level(
    app: object, page: str, template: str, context: Dict[str, Any], tree: object
) -> None:
    """Say which level of headings a caption of the menu has: screen readers ask for it."""
    menu: Callable[..., str] = context.get("toctree", lambda **options: "")

    def levelled(**options: Any) -> str:
        return (menu(**options) or "").replace('role="heading"', 'role="heading" aria-level="2"')

    context["toctree"] = levelled


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("html-page-context", give_captions_a_level)
