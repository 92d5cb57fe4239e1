"""Attacks on the live view."""
import http.client
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Dict, List, Tuple

from redteam_attacks.target import ERRORS, Target


def view(target: Target, end: float) -> int:
    """Ask the view as a page of another site does: by other names, with forms, and no token."""
    at = "127.0.0.1", int(os.environ["VIEW_PORT"])
    evil = {"Origin": "http://evil.example", "Referer": "http://evil.example/"}
    form = {"Content-Type": "application/x-www-form-urlencoded"}
    code = "<script>alert(1)</script>"
    tries: List[Tuple[str, str, Dict[str, str], str]] = [
        ("GET", "/api/state", {"Host": "evil.example"}, ""),
        ("GET", "/", {"Host": "evil.example:80"}, ""),
        ("POST", "/api/actions/release", {**evil, **form}, "topic=/warm"),
        ("POST", "/api/actions/substitute", {**evil, "Authorization": "Bearer x"}, "{}"),
        ("POST", "/api/actions/inject", {**evil, "Content-Type": "text/plain"}, "{}"),
        ("GET", f"/api/what_if?node=/{code}", evil, ""),
        ("GET", "/static/../../../../etc/passwd", {}, ""),
        ("GET", "/static/%2e%2e/%2e%2e/handlers.py", {}, ""),
    ]
    count = 0
    while time.monotonic() < end:
        for method, path, headers, body in tries:
            connection = http.client.HTTPConnection(*at, timeout=2.0)
            with suppress(*ERRORS):
                connection.request(method, path.replace(" ", "%20"), body, headers)
                answer = connection.getresponse()
                text = answer.read().decode("utf-8", "replace")
                told = answer.getheader("Content-Type", "")
                if answer.status == 200 or (code in text and "json" not in told):
                    Path(target.folder, "ran").touch()
                count += 1
            connection.close()
        time.sleep(0.02)
    return count
