"""The trace of a run of chaos: one JSON line an event, with the time since its beginning."""
import json
import threading
from typing import Any, Callable, Dict, Optional, TextIO


class Trace:
    """Writes events. `clock` tells the time in s; `show(event)` is called with each as well."""

    def __init__(
        self,
        file: Optional[TextIO],
        clock: Callable[[], float],
        show: Callable[[Dict[str, Any]], None],
    ) -> None:
        self._file, self._clock, self._show = file, clock, show
        self._start = clock()
        self._lock = threading.Lock()

    def write(self, event: str, **details: Any) -> None:
        """One event, now."""
        with self._lock:
            line = {"time": round(self._clock() - self._start, 4), "event": event, **details}
            if self._file is not None:
                self._file.write(json.dumps(line) + "\n")
                self._file.flush()
            self._show(line)
