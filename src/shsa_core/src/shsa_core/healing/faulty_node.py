"""The node that an incident blames: killed, gone or kept, and whether it may still be heard."""
from typing import List

from shsa_core.healing.incident import Incident
from shsa_core.healing.kills import KillNode
from shsa_core.healing.records import Blame, Fate
from shsa_core.healing.snapshot import Request, Snapshot
from shsa_core.model.kinds import BY_LINK, QUIET, Contain, Kind, Policy
from shsa_core.model.service import Service


class FaultyNode:
    """What is decided about a faulty node, and what it may do meanwhile.

    `decision` says it in words. `heard`: it may publish, so that nobody else should. `excuse`: what
    else may be the cause, as its own computer tells; empty: nothing is known.
    """

    def __init__(self) -> None:
        self.name = ""
        self.kind = Kind.OTHER
        self.decision = ""
        self.heard = False
        self.excuse = ""
        self._asked = False  # its own computer is, before it is killed
        self._fate = Fate.NONE

    @property
    def kept(self) -> bool:
        """Whether it is not killed, for the time being."""
        return self._fate is Fate.KEPT

    @property
    def waits(self) -> bool:
        """Whether its kill waits until it is taken over."""
        return self._fate is Fate.WAITS

    @property
    def babbles(self) -> bool:
        """Whether it is kept although consumers hear what is wrong of it."""
        return self.kept and self.heard

    def failed(self, name: str, kind: Kind) -> None:
        """It failed, perhaps once more: it is to be judged."""
        self.name, self.kind = name, kind
        self._fate = Fate.OPEN
        self.heard = kind is not Kind.NODE_GONE
        self.excuse = ""

    def judge(
        self, now: Snapshot, replaced: bool, restarted: bool, taken_over: bool
    ) -> List[Request]:
        """Kill it, or keep it.

        `replaced`: something could take its topic over; `taken_over`: that publishes it already. A
        silent node is not killed before: what its substitute reads may be as silent as it is.
        """
        if self._fate in (Fate.NONE, Fate.KILLED):
            return []
        again, gone = self.kept, self.kind is Kind.NODE_GONE
        verdict = now.verdict(self.name, self.kind, replaced, restarted)
        self.decision = verdict.why
        if verdict.kill and not (taken_over or restarted or self._forced(now)):
            self.decision = f"{self.name} is killed as soon as its substitute publishes"
            self._fate, self.heard = Fate.WAITS, False
            return []
        self._fate = Fate.KILLED if verdict.kill else Fate.KEPT
        self._asked = False
        if verdict.kill:
            kill = self.kill(now.service)
            self._asked = kill.period > 0.0 and now.far and self.name == now.service.node
            if self._asked:
                self.decision = f"{self.name} is killed if it fails on its own computer as well"
            if kill.only_here and now.parted:
                self.heard = False  # its kill may wait for its computer, and nobody hears it
            return [kill]
        self.heard = self.kind not in QUIET and not now.service.gated
        if gone and not again and now.service.policy is not Policy.ADVISE:
            return [KillNode(self.name, False, True, now.service.topic)]
        return []

    def kill(self, service: Service) -> KillNode:
        """Its kill; if it is not forced, by the word of its own computer alone."""
        gone, forced = self.kind is Kind.NODE_GONE, service.contain is Contain.NODE
        silent = self.kind in QUIET and not gone and not forced
        period = service.period if self.kind in BY_LINK and not forced else None
        topic = service.topic
        return KillNode(self.name, not gone, topic=topic, only_here=silent, period=period or 0.0)

    def _forced(self, now: Snapshot) -> bool:
        """Whether its kill does not wait for anything: only one that is silent can wait."""
        silent = self.kind in QUIET and self.kind is not Kind.NODE_GONE
        return not silent or now.service.contain is Contain.NODE

    def record(self) -> Blame:
        """What is to be known of it after a death."""
        return Blame(self.kind, self._fate, self.heard)

    def take_up(self, incident: Incident, blame: Blame) -> None:
        """Go on as was decided; who was to be killed and is not gone is judged again."""
        self.name, self.decision, self.kind = incident.faulty_node, incident.decision, blame.kind
        self._fate, self.heard = blame.fate, blame.heard
        if incident.killed is not None:
            self._fate = Fate.NONE
        elif self._fate in (Fate.NONE, Fate.KILLED):
            self._fate = Fate.OPEN

    def spared(self) -> None:
        """Its connection was lost, but it still runs: it is as good as silent."""
        self.kind = Kind.SILENT

    def sends(self, seen: str, cause: str) -> None:
        """It may do well, and is as good as silent here."""
        self.decision = f"{self.name} is not killed: {seen}, {cause}"
        self._fate, self.heard, self.excuse = Fate.NONE, False, cause

    def gone(self, certain: bool = False) -> None:
        """It is gone, or cannot be reached to make sure."""
        if self.kept or (certain and self._asked):
            self.decision = f"{self.name} is gone"
        self._fate, self.heard = Fate.NONE, False
