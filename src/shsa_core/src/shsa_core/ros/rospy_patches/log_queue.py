"""Lines of the log, written by a thread of their own: whoever says something waits for nothing.

Faults of rospy 1.15 to 1.17: a line of the log waits for a terminal that stands still, a disk, and
the master, which is asked about a parameter at every line. It follows a link that anybody has put
where its log is to be.
"""
import logging
import logging.handlers
import os
import queue
import sys
import threading
from contextlib import suppress
from typing import Any, List, Optional, Sequence, Set, Tuple

import rospy
from rospy.impl.paramserver import get_param_server_cache

from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES
from shsa_core.text import LONGEST_LINE, shown

LOGGERS = ("", "rosout")
ROSOUT = "/rosout_disable_topics_generation"

Line = Tuple[Sequence[logging.Handler], logging.LogRecord]


class LogQueue:
    """Takes the place of the handlers of LOGGERS, and hands them the lines in order."""

    def __init__(self) -> None:
        self._lines: "queue.Queue[Optional[Line]]" = queue.Queue(settings.LOG_LINES)
        for name in LOGGERS:
            logger = logging.getLogger(name)
            handlers, logger.handlers = logger.handlers, []
            if handlers:
                logger.addHandler(_Later(self._lines, handlers))
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Write what waits, as far as that is possible in a moment."""
        with suppress(queue.Full):  # whoever shows the lines stands still
            self._lines.put(None, timeout=settings.PATIENCE_S)
            self._thread.join(settings.PATIENCE_S)

    def _write(self) -> None:
        while True:
            line = self._lines.get()
            if line is None:
                return
            handlers, record = line
            for handler in handlers:
                if record.levelno >= handler.level:
                    try:
                        handler.handle(record)
                    except Exception:  # whatever it is, the next line is written
                        handler.handleError(record)


class _Later(logging.handlers.QueueHandler):
    """Puts records, each on one line, beside those who will handle them."""

    def __init__(self, lines: "queue.Queue[Optional[Line]]", handlers: List[logging.Handler]):
        super().__init__(lines)
        self._handlers = handlers

    def prepare(self, record: logging.LogRecord) -> Any:
        prepared: logging.LogRecord = super().prepare(record)
        prepared.msg = shown(prepared.getMessage(), LONGEST_LINE)  # names may be anybody's
        return prepared

    def enqueue(self, record: logging.LogRecord) -> None:
        with suppress(queue.Full):  # whoever shows the lines stands still: the newest are lost
            self.queue.put_nowait((self._handlers, record))


def say_failures_once() -> None:
    """Have a handler that fails say so once on stderr; no log is written to a link or a pipe."""
    logging.Handler.handleError = _failed  # type: ignore
    logging.FileHandler._open = _opened  # type: ignore


def _opened(handler: logging.FileHandler) -> Any:
    here = lambda path, flags: os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
    try:
        return open(handler.baseFilename, handler.mode, encoding=handler.encoding, opener=here)
    except OSError:
        _failed(handler)
        return open(os.devnull, "w", encoding="utf-8")


_said: Set[int] = set()


def _failed(handler: logging.Handler, *_: logging.LogRecord) -> None:
    if id(handler) not in _said:
        _said.add(id(handler))
        where = getattr(handler, "baseFilename", type(handler).__name__)
        with suppress(OSError):  # then nobody can be told
            text = f"The log {where} cannot be written: {sys.exc_info()[1]}. This is said once."
            sys.stderr.write(text + "\n")


def ask_once_for_rosout() -> None:
    """Have rospy know for good whether lines on /rosout name the topics of the node."""
    value = False
    with suppress(*FAILURES):
        value = bool(rospy.get_param(ROSOUT, False))
    get_param_server_cache().set(ROSOUT, value)
