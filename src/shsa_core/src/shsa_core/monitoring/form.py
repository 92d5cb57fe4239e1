"""Learns which frames a publisher names, and how long its arrays are: what is always the same."""
from typing import Iterator

from shsa_core.model.samples import FormSample, Parts, Usual
from shsa_core.monitoring import settings


class Form:
    """The form of one publisher's messages. `usual`: of its predecessor's, and then its own."""

    def __init__(self, usual: Usual) -> None:
        self._count, self._same, self._usual = 0, dict(usual), usual
        self.unusual = ""

    def samples(self, parts: Parts) -> Iterator[FormSample]:
        """Yield what a message has otherwise than all of the first good ones."""
        if self._count >= settings.AGES:
            for name, part in parts:
                if self._same.get(name, part) != part:
                    yield FormSample(name, part, self._same[name])

    def heard(self, parts: Parts) -> None:
        """Learn from a good message."""
        if self._count >= settings.AGES:
            return
        known, self._count = self._same if self._count else dict(parts), self._count + 1
        self._same = {name: part for name, part in parts if known.get(name) == part}
        if self._count == settings.AGES:
            for name, part in self._same.items():
                if self._usual.get(name, part) != part:
                    before = f"{self._usual[name]!r} before its node was started again"
                    self.unusual = f"{name} is {part!r}, and was {before}"
            self._usual.update(self._same)
