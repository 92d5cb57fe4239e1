"""Decides whether a substitute publishes, and to whom: one table."""
from functools import lru_cache
from typing import Optional, Tuple

from shsa_core.model.kinds import Word


class Order(Word):
    """An order of its row."""

    NOTHING = "nothing"  # of what its program computes
    MUTE = "mute"
    BRIDGE = "bridge"  # be muted, and fill in for an original that is late
    PUBLISH = "publish"
    ALWAYS = "always"  # a gate chooses what consumers hear


class Heard(Word):
    """The other publishers of its topic, as they are heard."""

    NOBODY = "nobody"
    ANOTHER = "another"
    RIVAL = "rival"  # heard beside a substitute that is spare then: cut off, or told to yield
    SILENCE = "silence"  # for longer than the deadline of the topic


class Original(Word):
    """The node that it stands in for, as far as it is known."""

    SPEAKS = "speaks"  # or nobody has looked at it yet
    HANGS = "hangs"  # it is late, and its connection stands
    ENDED = "ended"  # it is late or gone, and its connection has ended a moment ago
    LOST = "lost"  # it is the reconfigurator's to judge
    BACK = "back"  # it takes over its consumers one after the other

    @property
    def late(self) -> bool:
        """Return if it is filled in for, where the row says so."""
        return self in (Original.HANGS, Original.ENDED)


class Voice(Word):
    """The way in which a substitute publishes."""

    MUTED = "muted"
    FILLS_IN = "fills in"  # from the original's last message on
    HANDS_OVER = "hands over"  # to the consumers whom the original does not serve yet
    PUBLISHES = "publishes"

    @property
    def publishes(self) -> bool:
        """Return if the whole topic is its own."""
        return self in (Voice.FILLS_IN, Voice.PUBLISHES)


ANY = None
Rule = Tuple[Optional[Order], Optional[Heard], Optional[bool], Optional[Original], Voice]
# fmt: off
RULES: Tuple[Rule, ...] = (
    # row says      heard          cut off  original        voice
    (Order.NOTHING, ANY,           ANY,     ANY,            Voice.MUTED),
    (Order.ALWAYS,  ANY,           ANY,     ANY,            Voice.PUBLISHES),
    (Order.PUBLISH, Heard.RIVAL,   ANY,     ANY,            Voice.MUTED),
    (Order.PUBLISH, ANY,           ANY,     ANY,            Voice.PUBLISHES),
    (ANY,           Heard.SILENCE, True,    ANY,            Voice.PUBLISHES),
    (Order.BRIDGE,  ANY,           ANY,     Original.HANGS, Voice.FILLS_IN),
    (Order.BRIDGE,  ANY,           ANY,     Original.ENDED, Voice.FILLS_IN),
    (ANY,           ANY,           ANY,     Original.BACK,  Voice.HANDS_OVER),
    (ANY,           ANY,           ANY,     ANY,            Voice.MUTED),
)
# fmt: on
"""The first rule that fits counts.

Cut off from the reconfigurator, each side of the cut has one publisher: a muted substitute speaks
once nobody else does, and is still again as soon as somebody does.
"""


@lru_cache(maxsize=None)
def decide(order: Order, heard: Heard, cut_off: bool, original: Original) -> Voice:
    """Return how a substitute speaks.

    `cut_off`: its computer cannot reach the reconfigurator, and the SOM says to heal there.
    """
    case = order, heard, cut_off, original
    for *wanted, voice in RULES:
        if all(want is ANY or want is seen for want, seen in zip(wanted, case)):
            return voice
    raise AssertionError("the last rule fits all")
