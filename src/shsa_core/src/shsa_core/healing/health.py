"""The health of the publishers of each topic, as the monitors tell it."""
from collections import defaultdict
from dataclasses import replace
from math import inf
from typing import Collection, DefaultDict, Dict, List, Optional, Set, Tuple

from shsa_core.healing.events import FailureSeen, HealthSeen, ShowSom, WriteDown
from shsa_core.healing.records import Healthy, Record
from shsa_core.model.health import Key, PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind
from shsa_core.model.names import RecentNames
from shsa_core.model.service import Service, ServiceState
from shsa_core.model.som import Som
from shsa_core.planning.settings import START_S
from shsa_core.table import Table

Heard = Tuple[List[Key], List[FailureSeen]]
"""Whom news of a monitor concerns, and the failures that it tells of."""
MISSED = (Kind.SILENT, Kind.NEVER_PUBLISHED)
"""The failures of a node that may wake, or be cut off: nobody says that it is gone."""


class Health:
    """The monitors' tables.

    `rows`: by topic and publisher. `topics`: those of each node. `substitutes`: the names of
    substitutes that run, or did not long ago. `excluded`: when each node that was killed and has
    not been well since was gone, in s. `dying`: the nodes whose kill is under way, each with the
    address of the life that failed; empty: not known. `protected`: why a node is never killed
    unless the SOM says so; `duties`: what a kill costs beyond the SOM.
    `verified`: the nodes whose process is known. `startable`: those that healing can start again,
    as it knows how they were started. `templates`: who has ever published a topic well, and the
    last message of it that was; empty: not known. `consumers`: the nodes outside healing that
    subscribe to each topic. `due`: when `missed` has something to tell.
    `stranded`: who did well when its monitor was lost, or was silent before we started: whoever
    tells next that it does well means now.
    """

    def __init__(self, records: Table[Record, WriteDown]) -> None:
        self._records = records
        self.rows: DefaultDict[str, Dict[str, PublisherHealth]] = defaultdict(dict)
        self.topics: Dict[str, Dict[str, None]] = {}
        self.substitutes = RecentNames()
        self.excluded: Dict[str, float] = {}
        self.dying: Dict[str, str] = {}
        self.protected: Dict[str, str] = {}
        self.duties: Dict[str, Tuple[str, ...]] = {}
        self.verified: Set[str] = set()
        self.startable: Set[str] = set()
        self.templates: Dict[Key, bytes] = {}
        self._lives: Dict[Key, str] = {}  # the address of the process that was well last
        self._successors: Dict[Key, str] = {}  # of the one that was not, after that
        self.consumers: Dict[str, Tuple[str, ...]] = {}
        self.due = inf
        self._told_at: Dict[Key, str] = {}  # the computer whose monitor tells
        self._began: Dict[str, int] = {}  # by computer: when its monitor did
        self._lost: Set[str] = set()  # the computers whose monitors are not heard
        self.stranded: Set[Key] = set()
        self._unheard: Dict[Key, Optional[PublisherHealth]] = {}  # until a new monitor hears them

    def row(self, key: Key) -> Optional[PublisherHealth]:
        """Return the row of a publisher of a topic; None: there is none."""
        return self.rows[key[0]].get(key[1])

    def of_node(self, node: str) -> List[PublisherHealth]:
        """Return the rows of a node, by topic."""
        return [self.rows[topic][node] for topic in sorted(self.topics.get(node, ()))]

    def well(self, topic: str) -> List[str]:
        """Return the publishers of a topic that do well."""
        return [name for name, row in self.rows[topic].items() if row.is_well]

    def healthy(self, key: Key) -> bool:
        """Tell that a publisher of a topic does well."""
        row = self.row(key)
        return row is not None and row.is_well

    def was_good(self, key: Key, warm: float) -> bool:
        """Tell that a topic was good, so that the process that publishes it now is to blame.

        That is asked of it, and of its first successor. Whoever comes after these may warm up, and
        has had its time for that if it was first heard before `warm`.
        """
        row = self.row(key)
        if key not in self.templates or row is None:
            return key in self.templates
        same = self._lives.get(key) == row.uri
        first = same or self._successors.setdefault(key, row.uri) == row.uri
        return first or (row.first_message is not None and row.first_message < warm)

    @property
    def doomed(self) -> Set[str]:
        """The nodes that are being killed, or were and have not been well since."""
        return {*self.excluded, *self.dying}

    def succeeded(self, node: str) -> bool:
        """Tell that a dying node has another life, which has not failed."""
        return any(self._is_next(row) for row in self.of_node(node) if not row.has_failed)

    def fails_anew(self, key: Key, since: float) -> bool:
        """Tell that another life of a dying node has failed on a topic since a moment."""
        row = self.row(key)
        return row is not None and row.has_failed and row.since > since and self._is_next(row)

    def _is_next(self, row: PublisherHealth) -> bool:
        """Tell that a row is of another life than the dying one: monitors agree on its port."""
        ports = {uri.rpartition(":")[2] for uri in (self.dying.get(row.publisher, ""), row.uri)}
        return len(ports - {""}) == 2

    def originals(self, som: Som, service: Service) -> Tuple[PublisherHealth, ...]:
        """Return the rows of the publishers of a service that are no substitutes."""
        return tuple(
            row
            for row in self.rows[service.topic].values()
            if row.publisher
            and row.publisher not in self.substitutes
            and som.service_of(service.topic, row.publisher) is service
        )

    def heed(self, change: HealthSeen) -> Heard:
        """Take over what has changed in a monitor's table; the rows of other monitors stay.

        Who was well when a monitor ended is so until the next one has heard it, or should have.
        """
        self._lost.discard(change.host)
        before = self._began.get(change.host, change.began)
        anew = change.began not in (0, before)  # it is another monitor
        self._began[change.host] = change.began or before
        if anew or (self._unheard and self.due == inf):
            self.due = change.time + START_S
        if anew:
            self._unheard.update(dict.fromkeys(filter(self.healthy, self._told(change.host))))
        rows = self._returned(change.time, self._heard(change))
        gone = list(change.removed)
        if change.whole:
            told = {*(row.key for row in rows), *self._unheard}
            gone = [key for key in self._told(change.host) if key not in told]
        for key in gone:
            self._forget(key)
        concerned, failures = self._take_over(rows, change.host)
        return concerned + gone, failures

    def _take_over(self, rows: List[PublisherHealth], host: str) -> Heard:
        concerned, failures = [row.key for row in rows], []
        for row in rows:
            if self._is_news(row):
                failures.append(self.failure(row))
            self._told_at[row.key] = host
            concerned += self._put(row)
        return concerned, failures

    def note(self, failure: FailureSeen) -> bool:
        """Put a failure that somebody tells, of the life that was heard last.

        False: the table tells of what came then or later.
        """
        key = failure.topic, failure.publisher
        known = self.row(key) or PublisherHealth(*key, PublisherState.FAILED, -inf)
        if known.since >= failure.time:
            return False
        good, first = failure.last_good, known.first_message
        if good is not None and good < (known.since if first is None else first):
            good = known.last_good  # that was its former life
        whose = *key, PublisherState.FAILED, failure.time, first, good
        told = failure.kind, failure.detail, failure.service, b"", known.uri
        self._put(PublisherHealth(*whose, *told))
        return True

    def _is_news(self, row: PublisherHealth) -> bool:
        before = self.row(row.key)
        if before is None or not before.has_failed:
            return row.has_failed
        other = bool(row.service and before.service) and row.service != before.service
        return row.has_failed and (other or row.kind not in (None, before.kind))

    @staticmethod
    def failure(row: PublisherHealth) -> FailureSeen:
        """Return the failure that a row tells of."""
        kind = row.kind or Kind.OTHER
        detail = row.detail or f"the monitor's table says {kind}"
        whom = row.service, row.topic, row.publisher
        return FailureSeen(row.since, *whom, kind, detail, row.last_good, row.last_message)

    def _put(self, row: PublisherHealth) -> List[Key]:
        """Put a row. Returns all that its node publishes if that is well again after a kill."""
        topic, node = row.key
        self.rows[topic][node] = row
        if node:
            self.topics.setdefault(node, {})[topic] = None
        if row.is_well or row.last_good is not None:
            self.templates.setdefault(row.key, b"")
            self._lives[row.key] = row.uri
            self._successors.pop(row.key, None)
        if row.is_well and row.last_message:
            self.templates[row.key] = row.last_message
        if row.kind is Kind.NODE_GONE:
            self.verified.discard(node)
        well = Healthy(topic, node, row.since, self.templates.get(row.key, b""), row.uri)
        self._records.set(well.key, well if row.is_well else None)
        if not row.is_well or row.since <= self.excluded.get(node, row.since):
            return []
        del self.excluded[node]
        return [(topic, node) for topic in self.topics[node]]

    def _forget(self, key: Key) -> None:
        topic, node = key
        self.rows[topic].pop(node, None)
        self._records.set(f"healthy {topic} {node}", None)
        self._told_at.pop(key, None)
        self.stranded.discard(key)
        topics = self.topics.get(node, {})
        topics.pop(topic, None)
        if not topics:
            self.topics.pop(node, None)
            self.verified.discard(node)
        if node in self.substitutes:
            self._lives.pop(key, None)  # its name is not used again
            self._successors.pop(key, None)
            self.templates.pop(key, None)

    # A monitor is lost, or starts anew.

    def missed(self, time: float) -> Optional[HealthSeen]:
        """Return what is so for those whom a new monitor has not heard in time."""
        if time < self.due:
            return None
        told, self._unheard, self.due = self._unheard, {}, inf
        rows = tuple(row for row in told.values() if row is not None)
        return HealthSeen(time, rows, tuple(key for key, row in told.items() if row is None))

    def recall(self, row: PublisherHealth) -> None:
        """Put who did well when a former reconfigurator ended, until a monitor has told of it."""
        self._put(row)
        self._unheard[row.key] = None

    def has_monitor(self, host: str) -> bool:
        """Tell that a monitor of a computer has told of anybody."""
        return host in self._told_at.values()

    def watched(self, topic: str, away: bool) -> bool:
        """Tell that the monitors of a topic are heard, as far as is known.

        `away`: its computer is not heard; then nobody does who has not told of it yet.
        """
        keys = ((topic, publisher) for publisher in self.rows[topic])
        told = {self._told_at[key] for key in keys if key in self._told_at}
        return not told & self._lost if told else not away

    def lose_monitor(self, time: float, host: str, why: str, apart: Collection[str]) -> Heard:
        """Put those as silent that the monitor of a computer has told of, which is lost.

        Not so substitutes that run `apart` from it.
        """
        self._lost.add(host)
        told = [key for key, told_at in self._told_at.items() if told_at == host]
        lost = [key for key in told if self.healthy(key) and key[1] not in apart]
        silent = {"state": PublisherState.FAILED, "since": time, "kind": Kind.SILENT, "detail": why}
        self.stranded.update(lost)
        return self._take_over([replace(self.rows[t][node], **silent) for t, node in lost], host)

    def _told(self, host: str) -> List[Key]:
        """Return whom a monitor tells of; what was only recalled is any's."""
        known = [(topic, each) for topic, publishers in self.rows.items() for each in publishers]
        return [key for key in known if self._told_at.get(key, host) == host]

    def _heard(self, change: HealthSeen) -> List[PublisherHealth]:
        """Return the rows without those of whom a new monitor knows nothing yet."""
        rows = []
        for row in change.rows:
            if row.key in self._unheard and row.state is PublisherState.UNKNOWN:
                self._unheard[row.key] = row
            else:
                self._unheard.pop(row.key, None)
                rows.append(row)
        for key in change.removed:
            self._unheard.pop(key, None)
        return rows

    def _returned(self, time: float, rows: List[PublisherHealth]) -> List[PublisherHealth]:
        """Return the rows in which those are back since now whose monitor was lost."""
        found = []
        for row in rows:
            before = self.row(row.key)
            later = before is not None and row.since > before.since
            if row.key in self.stranded and row.is_well and not later:
                row = replace(row, since=time)
            found.append(row)
        self.stranded.difference_update(row.key for row in rows)
        return found


class Availability:
    """The running SOM, kept up service by service.

    `services`: those that are available, each with the node that publishes it; `unavailable`: the
    names of the others. `states`: a row for each, as it is shown.
    """

    def __init__(self, health: Health) -> None:
        self.services: Dict[str, Service] = {}
        self.unavailable: Set[str] = set()
        self.states: Table[ServiceState, ShowSom] = Table(ShowSom)
        self._health = health

    def look(self, som: Som, name: str, why: str) -> Tuple[Optional[Service], Optional[Service]]:
        """Look at a service again: return it as it is available no more, and as it is now.

        `why` it is not available whoever is well, empty: it may be.
        """
        before, service = self.services.pop(name, None), som.services.get(name)
        self.unavailable.discard(name)
        state = None if service is None else self.state(som, service, why)
        self.states.set(name, state)
        now = None
        if state is not None and state.available:
            found = replace(state.service, node=state.node)
            now = self.services[name] = before if before and before == found else found
        elif state is not None:
            self.unavailable.add(name)
        return (None, None) if now is before else (before, now)

    def state(self, som: Som, service: Service, why: str) -> ServiceState:
        """Return how a service stands."""
        health = self._health
        rows = [
            row for row in health.originals(som, service) if row.publisher not in health.excluded
        ]
        well = tuple(row.publisher for row in rows if row.is_well)
        consumers = health.consumers.get(service.heard, ())
        if why or not well:
            why = why or next((row.detail for row in rows if row.detail), "not published")
            return ServiceState(service, service.node, False, why, well, consumers=consumers)
        verified = tuple(node for node in well if node in health.verified)
        return ServiceState(service, well[0], True, "", well, verified, consumers)
