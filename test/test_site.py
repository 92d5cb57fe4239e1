"""The documentation as a site: it builds without a warning, and works in a browser."""
import importlib.util
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Dict, List, Optional, Set, Tuple
from urllib.parse import unquote, urlparse

import pytest
from listings import ROOT

sys.path.append(str(ROOT / "src" / "shsa_view" / "test" / "browser"))
from chromium import PHONE, WIDE, Browser  # noqa: E402

from shsa_testing.thorough import some  # noqa: E402

MODULES = ("sphinx", "myst_parser", "sphinx_rtd_theme")
MISSING = [name for name in MODULES if importlib.util.find_spec(name) is None]
pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}")


class Html(HTMLParser):
    """The links of a page of the site, what it loads, and the names of its places."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: List[str] = []
        self.loads: List[str] = []
        self.ids: Set[str] = set()
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: List[Tuple[str, Optional[str]]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.ids |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag in ("script", "img", "link", "iframe"):
            self.loads += [given[name] for name in ("src", "href") if name in given]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as `make docs` builds it."""
    folder = tmp_path_factory.mktemp("site")
    recipe = (ROOT / "Makefile").read_text().partition("\ndocs:")[2].partition("\n\n")[0]
    options = "-W --keep-going -n -q -E -c docs"
    assert f"-m sphinx {options} " in recipe
    places = ["-d", str(folder / "cache"), ".", str(folder / "site")]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *options.split(), *places],
        cwd=str(ROOT),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
    )
    assert done.returncode == 0, done.stdout
    return folder / "site"


@pytest.fixture(scope="module")
def pages(site: Path) -> Dict[Path, Html]:
    return {path: Html(path) for path in site.rglob("*.html")}


def test_every_page_is_in_the_site_and_can_be_searched(site: Path) -> None:
    for page in (*ROOT.glob("docs/**/*.md"), *ROOT.glob("*/*/README.md")):
        assert (site / page.relative_to(ROOT)).with_suffix(".html").is_file()
    assert "babbl" in (site / "searchindex.js").read_text("utf-8")
    assert (site / "index.html").is_file()


def test_no_link_leads_nowhere(site: Path, pages: Dict[Path, Html]) -> None:
    broken = []
    for page, html in pages.items():
        for link in html.links + html.loads:
            parts = urlparse(link)
            if parts.scheme or parts.netloc or link.startswith("#") and page.name == "search.html":
                continue
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            known = pages[target].ids if target in pages else set()
            if not target.exists() or (parts.fragment and unquote(parts.fragment) not in known):
                broken.append(f"{page.relative_to(site)}: {link}")
    assert not broken


def test_nothing_is_loaded_from_another_host(pages: Dict[Path, Html]) -> None:
    for page, html in pages.items():
        assert not [link for link in html.loads if urlparse(link).netloc], page


def test_a_browser_shows_pages_without_a_complaint(site: Path) -> None:
    browser = Browser()
    try:
        for page in some(sorted(site.rglob("*.html")), 3):
            browser.driver.get(page.as_uri())
            for size in (WIDE, PHONE):
                browser.size(*size)
                wider = "document.documentElement.scrollWidth > window.innerWidth"
                assert not browser.run(wider), f"{page} is wider than {size[0]} px"
            assert browser.log() == [], page
        browser.driver.get((site / "search.html").as_uri() + "?q=babbling")
        browser.wait("document.querySelectorAll('#search-results li').length > 0")
    finally:
        browser.close()
