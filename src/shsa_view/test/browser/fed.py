"""The real server of the view, fed with documents instead of a robot."""
import threading
from typing import Any, Dict, List, Optional, Tuple

from documents import Document, drawing
from shsa_testing.waiting import wait_until
from shsa_view.history import History
from shsa_view.live import Settings, View
from shsa_view.server import serve

WAIT_S = 10.0


class FedState:
    """A document, and the changes that were told; it stands where the server has its state."""

    def __init__(self, whole: Document) -> None:
        self.whole = whole
        self.history = History()
        self._waiting: List[Document] = []
        self._lock = threading.Lock()

    def tell(self, **changes: Any) -> None:
        """Change the document; the page hears of it with the next event."""
        with self._lock:
            for name, value in changes.items():
                if name == "services":
                    services = {**self.whole["services"], **value}
                    self.whole["services"] = {k: row for k, row in services.items() if row}
                elif name == "incidents":
                    keys = {each["key"] for each in value}
                    kept = [each for each in self.whole[name] if each["key"] not in keys]
                    self.whole[name] = [*value, *kept]
                else:
                    self.whole[name] = value
            self._waiting.append(changes)

    def knows(self, service: str) -> bool:
        """Asked by the server."""
        return service in self.whole["services"] or self.history.knows(service)

    def document(self, now: float) -> Document:
        """Asked by the server."""
        return self.whole

    def changes(self, now: float) -> Optional[Document]:
        """Asked by the server, ten times a second."""
        with self._lock:
            told, self._waiting = self._waiting, []
        merged: Document = {}
        for each in told:
            for name, value in each.items():
                rows = name == "services"
                merged[name] = {**merged.get(name, {}), **value} if rows else value
        return {"now": self.whole["now"], **merged} if merged else None

    def handle(self, fact: Any) -> None:
        """Nothing but what is told counts."""

    def second(self, now: float) -> None:
        """Sample the document, as often as the server asks."""
        for name, row in self.whole["services"].items():
            self.history.second(now, name, row, {})

    def timeline(self, now: float) -> Document:
        """Asked by the server."""
        return self.history.timeline(now, self.whole["incidents"])


class FedAnswers:
    """Fixed answers; what was done is kept."""

    def __init__(self) -> None:
        self.drawing = drawing()
        self.left = "amperemeter: nothing"
        self.acted: List[Tuple[str, Dict[str, Any]]] = []

    def graph(self) -> Document:
        """Asked by the server."""
        return self.drawing

    def what_if(self, service: str, node: str) -> Document:
        """Asked by the server."""
        answer = {
            **{"service": service or "amperemeter", "found": True, "quality": 0.87},
            **{"inputs": ["/battery_voltage/data"], "relations": ["power"]},
            **{"outputs": ["/battery_current/data"], "code": "t0=x[0]\ny=t0"},
            **{"error_rms": [0.2], "error_p95": [0.4], "missing": [], "detail": ""},
        }
        return {
            **{"question": service or node, "services": [answer], "left": self.left},
            "cut_sets": [["/amperemeter", "/voltmeter"]],
        }

    def act(self, action: str, body: Any, who: str) -> Document:
        """Asked by the server."""
        self.acted.append((action, dict(body)))
        return {}


class Fed:
    """Serves a document at a port of this computer until it is closed; the port may be given."""

    def __init__(self, whole: Document, port: int = 0, token: str = "") -> None:
        self.state, self.answers = FedState(whole), FedAnswers()
        self.failures: List[str] = []
        self._ended = threading.Event()
        self._port: List[int] = []
        state: Any = self.state
        view = View(
            Settings(port=port, token=token),
            state,
            self.answers,
            take=lambda: (),
            now=lambda: float(whole["now"]),
            failed=self.failures.append,
        )
        self._thread = threading.Thread(
            target=serve, args=(view, self._ended.is_set, self._port.append), daemon=True
        )
        self._thread.start()
        wait_until(lambda: self._port, WAIT_S, "the server takes connections")

    @property
    def port(self) -> int:
        """The address at which it is served."""
        return self._port[0]

    @property
    def address(self) -> str:
        """The page's address."""
        return f"http://127.0.0.1:{self.port}/"

    def close(self) -> None:
        """End it; open streams break."""
        self._ended.set()
        self._thread.join(WAIT_S)
        assert not self._thread.is_alive(), "the server does not end"
