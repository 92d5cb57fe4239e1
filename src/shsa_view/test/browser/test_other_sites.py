"""A page of another site, in a real browser: it learns nothing of the robot, and does nothing."""
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Iterator

import pytest
from chromium import OPTIONS, Browser
from documents import robot
from fed import Fed

EVIL = "evil.example"
PAGE = """<iframe name=frame></iframe>
<form target=frame method=post action="{at}api/actions/release"><input name=topic></form>
<script>
const at = "{at}", act = at + "api/actions/release", body = '{{"topic": "/battery_current"}}';
const text = (answer) => answer.text();
const loads = (name, more) => new Promise((done) => {{
  const element = Object.assign(document.createElement(name), more);
  [element.onload, element.onerror] = [() => done(name), () => done("")];
  document.body.append(element);
}});
const tries = [
  () => fetch(at + "api/state").then(text),
  () => fetch(at + "api/state", {{mode: "no-cors"}}).then(text),
  () => fetch(at + "metrics").then(text),
  () => fetch(act, {{method: "POST", mode: "no-cors", body}}).then(text),
  () => fetch(act, {{method: "POST", headers: {{Authorization: "Bearer x"}}, body}}).then(text),
  () => new Promise((done) => {{
    const events = new EventSource(at + "api/events");
    [events.onopen, events.onerror] = [() => done("events"), () => done("")];
  }}),
  () => loads("script", {{src: at + "api/state"}}),
  () => loads("link", {{rel: "stylesheet", href: at + "static/view.css"}}),
  () => new Promise((done) => {{
    document.querySelector("iframe").onload = () => done("");
    document.querySelector("form").submit();
  }}),
];
(async () => {{
  window.had = [];
  for (const each of tries) had.push(await each().catch(() => ""));
  window.done = true;
}})();
</script>"""


@pytest.fixture
def view() -> Iterator[Fed]:
    """A view that acts for who has the token."""
    made = Fed({**robot(), "actions": True}, token="secret")
    yield made
    made.close()


@pytest.fixture
def browser(monkeypatch: pytest.MonkeyPatch) -> Iterator[Browser]:
    """A browser for which a name of a stranger's is our own address."""
    names = f"--host-resolver-rules=MAP {EVIL} 127.0.0.1"
    monkeypatch.setattr("chromium.OPTIONS", (*OPTIONS, names))
    made = Browser()
    yield made
    made.close()


@pytest.fixture
def site(view: Fed) -> Iterator[str]:
    """Return the address of a page that attacks the view."""

    class Site(BaseHTTPRequestHandler):
        """One page."""

        def do_GET(self) -> None:
            """Return it."""
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(PAGE.format(at=view.address).encode())

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Site) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://{EVIL}:{server.server_port}/"
        server.shutdown()


def test_a_page_of_another_site_reads_nothing_and_does_nothing(
    browser: Browser, view: Fed, site: str
) -> None:
    browser.driver.get(site)
    browser.wait("window.done")
    assert browser.run("had") == [""] * 9
    assert view.answers.acted == []


def test_a_stranger_s_name_for_our_address_shows_nothing(browser: Browser, view: Fed) -> None:
    browser.driver.get(view.address.replace("127.0.0.1", EVIL))
    assert "this is not the name of this server" in browser.text("body")
    fetched = browser.driver.execute_async_script(
        "fetch('api/state').then((answer) => arguments[0](answer.status))"
    )
    assert fetched == 403
