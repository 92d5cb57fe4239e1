"""Takes a topic over without a reconfigurator: an idle process, by the plan that it prepares for.

The monitor's word is enough where a node is gone and no reconfigurator gives a sign of life. Each
idle process waits longer for that than the one before it, and leaves a topic to whom it hears there
meanwhile: to that one, or to a node that was started again.
"""
import math
from dataclasses import replace
from typing import Dict, Iterable, List, Optional

from shsa_core.model.kinds import Kind
from shsa_core.model.log import Level, Log
from shsa_core.model.substitution import Substitution
from shsa_core.substitution import events


LISTENS = 1.0 / 3.0
"""Of its patience: then it listens whether somebody else takes the topic over."""
DIGITS = "0123456789"


class Alone:
    """Has an idle process take topics over. Times in s. `idle`: its row before that."""

    def __init__(self) -> None:
        self.idle: Optional[Substitution] = None
        self.look = math.inf  # when a look is due
        self._gone: Dict[str, events.FailureHeard] = {}  # by topic
        self._taken: Optional[Substitution] = None

    def failed(self, event: events.FailureHeard, idle: Substitution) -> None:
        """Note it if the node of a topic is gone: the reconfigurator is looked at soon."""
        if event.kind == Kind.NODE_GONE and idle.idle and idle.bridge > 0.0:
            self._gone[event.topic] = event
            self.look = min(self.look, event.time + LISTENS * idle.bridge)

    def hear(self, event: events.OtherHeard) -> None:
        """Leave a topic to somebody else who publishes it."""
        self._gone.pop(event.topic, None)

    def due(
        self, event: events.Tick, idle: Substitution, plans: Iterable[Substitution]
    ) -> List[events.Command]:
        """Take a topic over if a look is due, and the silence of the reconfigurator is too long.

        It has decided about a node if it was heard long after that was gone.
        """
        if event.time < self.look:
            return []
        self.look = math.inf
        heard, patience = event.time - event.unheard, idle.bridge
        here = [each for each in plans if each.code and each.host == idle.host]
        ours = {topic: each for each in here for topic in each.topics}
        gone = [each for each in self._gone.values() if heard < each.time + patience]
        self._gone = {each.topic: each for each in gone if idle.idle and each.topic in ours}
        if not self._gone:
            return []
        listens, takes = heard + LISTENS * patience, heard + patience
        if event.time < takes:
            self.look = listens if event.time < listens else takes
            heed = self._gone if event.time >= listens else ()
            return [events.Overhear(topic, ours[topic].outputs[0].type) for topic in heed]
        topic, first = self._gone.popitem()
        row = replace(ours[topic], node=idle.node, publishing=True, yields=True)
        self.idle, self._taken = idle, replace(row, last_message=first.last_message)
        why = f"its node is gone, and no reconfigurator has answered for {event.unheard:.1f} s"
        said = Log(Level.WARN, f"takes {topic} over by itself: {why}")
        return [events.TakeOver(self._taken), said]

    def leaves(self, other: str) -> bool:
        """Tell that it is idle again as another one is heard; of two idle ones the first stays."""
        own = "" if self.idle is None else self.idle.node
        alike = own.rstrip(DIGITS) == other.rstrip(DIGITS)
        return own != "" and not (alike and (len(own), own) < (len(other), other))

    def counts(self, row: Substitution, works: bool, speaks: bool) -> bool:
        """Tell that a row counts: ours until the table has one, and that unless it is idle.

        A reconfigurator that comes back takes who speaks for idle until it has heard of that.
        """
        if row == self._taken:
            return not works
        if row.idle and speaks and self.idle is not None:
            return False
        self.idle = None
        return True
