"""The frames and the lengths of arrays in one publisher's messages, as its first good ones had them."""
from typing import Dict, Iterator, Tuple

from shsa_core.model.samples import FormSample, Part
from shsa_core.monitoring import settings

Parts = Tuple[Tuple[str, Part], ...]
Usual = Dict[str, Tuple[Part, Part]]
"""The least and the most of each part."""


class Form:
    """The form of one publisher's messages. `before`: of its predecessor's, and then its own."""

    def __init__(self, before: Usual) -> None:
        self._count, self._before = 0, before
        self._usual: Usual = {}
        self._good: Parts = ()
        self.unusual = ""

    def samples(self, parts: Parts) -> Iterator[FormSample]:
        """Yield what is to be judged of a message."""
        if self._count >= settings.AGES and parts != self._good:
            for name, part in parts:
                if name in self._usual:
                    yield FormSample(name, part, *self._usual[name])

    def heard(self, parts: Parts) -> None:
        """Learn from a good message."""
        self._good = parts
        if self._count >= settings.AGES:
            return
        self._count += 1
        for name, part in parts:
            least, most = self._usual.get(name, (part, part))
            self._usual[name] = min(least, part), max(most, part)  # type: ignore[type-var]
        if self._count == settings.AGES:
            for name, (_, most) in self._usual.items():
                former = self._before.get(name, (most, most))[1]
                if former != most:
                    self.unusual = f"{name} is {most!r}, and was {former!r} before its node was started again"
            self._before.update(self._usual)
