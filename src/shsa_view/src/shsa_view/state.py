"""The document that the page shows, built of facts as they come, and the changes in it.

docs/howto/see_what_happens.md describes the document. Time comes in: `now` in s of ROS time.
"""
from collections import deque
from typing import Deque, Dict, Iterable, List, Optional, Set, Tuple

from shsa_core import dispatch
from shsa_core.errors import listed
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_view import facts
from shsa_view.graph import elements
from shsa_view.history import History
from shsa_view.incidents import Incidents
from shsa_view.judgement import LETTERS, Condition, Judgement, judge, of_robot
from shsa_view.remedies import remedies, why
from shsa_view.rows import Document, place_of, service_row, values_of
from shsa_view.witnesses import WitnessTable

VERSION = 1
STRIP_S = 60
"""So many seconds are told of each service."""
MONITOR, RECONFIGURATOR, MASTER = "monitor", "reconfigurator", "master"
UNKNOWN, ALIVE = "unknown", "alive"
IN_MAINTENANCE = "maintenance: nothing is killed or started"

_UNHEARD = Judgement(Condition.UNKNOWN, "nothing was heard of it yet", None)


class State:
    """Heeds facts, and tells the whole document, or what has changed since that was asked last."""

    def __init__(self, namespace: str = "/", actions: bool = False) -> None:
        self._namespace, self._actions = namespace, actions
        self.ontology, self.som = Ontology({}, {}, ()), Som()
        self._health: Dict[str, Dict[Tuple[str, str], facts.Publisher]] = {}
        self._on_topic: Dict[str, Dict[Tuple[str, str], facts.Publisher]] = {}
        self._running: Dict[str, facts.Running] = {}
        self._substitutes: Dict[str, facts.Substitute] = {}
        self._figures: Dict[str, facts.Figures] = {}
        self._duties: Dict[str, str] = {}
        self._commands: Dict[str, str] = {}
        self._witnesses = WitnessTable(self.ontology, self.som)
        self.history = History()
        self._healers: Dict[str, facts.Healer] = {}
        self._hosts: Dict[str, facts.HostTold] = {}
        self._maintained = False
        self._trust = facts.TrustTold("unchecked", "nothing was heard yet")
        self._incidents = Incidents()
        self._strips: Dict[str, Deque[str]] = {}
        self._judged: Dict[str, Judgement] = {}
        self._rows: Dict[str, Document] = {}
        self._dirty: Set[str] = set()
        self._told: Document = {}
        self._handlers: dispatch.Table[None] = dispatch.table(
            facts.Fact,
            {
                facts.HealthTold: self._health_told,
                facts.ServicesTold: self._services_told,
                facts.SubstitutesTold: self._substitutes_told,
                facts.IncidentTold: self._incident_told,
                facts.FiguresTold: self._figures_told,
                facts.DutiesTold: self._duties_told,
                facts.CommandsTold: self._commands_told,
                facts.Healer: self._healer,
                facts.MaintenanceTold: self._maintenance_told,
                facts.HostTold: self._host,
                facts.TrustTold: self._trusted,
                facts.ModelsRead: self._models_read,
            },
        )

    def handle(self, fact: facts.Fact) -> None:
        """Heed a fact."""
        self._handlers[type(fact)](fact)

    def second(self, now: float) -> None:
        """Add a letter to the strips and a sample to the history: a second has passed."""
        self._settle()
        known = self._newest()
        for name, row in self._rows.items():
            strip = self._strips.setdefault(name, deque(maxlen=STRIP_S))
            strip.append(LETTERS[row["state"]])
            letters = "".join(strip)
            if letters != row["strip"]:
                self._rows[name] = {**row, "strip": letters}
            witnesses = self._witnesses.values(tuple(row["properties"]), known)
            self.history.second(now, name, row, witnesses)
        self.history.cut(now, self._incidents.known())

    def knows(self, service: str) -> bool:
        """Return true if a service is shown, or was."""
        self._settle()
        return service in self._rows or self.history.knows(service)

    def timeline(self, now: float) -> Document:
        """Return what the services and the incidents of the last hour were."""
        return self.history.timeline(now, self._incidents.newest_first())

    def _newest(self) -> Dict[str, float]:
        """Return the newest value of each property, of a service that is well."""
        return {
            name: prop["value"]
            for row in self._rows.values()
            if row["state"] == Condition.WELL.value
            for name, prop in row["properties"].items()
            if prop["value"] is not None
        }

    def document(self, now: float) -> Document:
        """Return all that is shown."""
        self._settle()
        head = {"version": VERSION, "now": now, "namespace": self._namespace}
        services, incidents = self._rows.copy(), self._incidents.newest_first()
        return {
            **head,
            "actions": self._actions,
            **self._parts(),
            "services": services,
            "incidents": incidents,
        }

    def changes(self, now: float) -> Optional[Document]:
        """Return what has changed since the last call; None: nothing has."""
        self._settle()
        told: Document = {}
        parts = self._parts()
        told.update({key: part for key, part in parts.items() if self._told.get(key) != part})
        self._told.update(parts)
        known = self._told.setdefault("services", {})
        services: Dict[str, Optional[Document]] = {
            name: row for name, row in self._rows.items() if known.get(name) is not row
        }
        services.update({name: None for name in known if name not in self._rows})
        if services:
            told["services"] = services
        self._told["services"] = dict(self._rows)
        incidents = self._incidents.take_changed()
        if incidents:
            told["incidents"] = incidents
        return {"now": now, **told} if told else None

    def _parts(self) -> Document:
        """Return the parts that are small and told as a whole."""
        needed: Dict[str, Condition] = {}
        others: Dict[str, Condition] = {}
        for name, row in self._rows.items():
            condition = self._judged.get(name, _UNHEARD).condition
            (needed if row["needed"] else others)[name] = condition
        heard = all(self._healer_state(who) == ALIVE for who in (MONITOR, RECONFIGURATOR))
        robot = of_robot(needed, others, heard)
        weakened = sorted(name for name, row in self._rows.items() if row["weakened"])
        if weakened:
            robot["text"] += f" Watched less than the SOM file says: {listed(weakened)}."
        return {
            "robot": robot,
            "healing": self._healing(),
            "trust": {"state": self._trust.state, "text": self._trust.text},
            "substitutes": {
                row.key: _substitute(row)
                for row in self._substitutes.values()
                if row.node and row.service
            },
            "hosts": {
                name: {"state": row.state, "text": row.text} for name, row in self._hosts.items()
            },
        }

    def _healing(self) -> Document:
        states = {who: self._healer_state(who) for who in (MONITOR, RECONFIGURATOR, MASTER)}
        texts = [each.text for each in self._healers.values() if each.text]
        texts += [IN_MAINTENANCE] if self._maintained else []
        return {**states, "text": "; ".join(texts)}

    def _healer_state(self, who: str) -> str:
        known = self._healers.get(who)
        return known.state if known is not None else UNKNOWN

    def _settle(self) -> None:
        """Make the rows anew that something was told of."""
        dirty, self._dirty = self._dirty, set()
        for name in dirty:
            self._make(name)

    def _make(self, name: str) -> None:
        service, running = self.som.services.get(name), self._running.get(name)
        if service is None and running is None:
            self._rows.pop(name, None)
            self._strips.pop(name, None)
            self._judged.pop(name, None)
            return
        topic, node = place_of(service, running)
        named = [row for row in self._substitutes.values() if row.service == name]
        key, incident = self._incidents.open_of(name) or (None, None)
        alone = len(self.som.of_topic(topic)) < 2
        judged = judge(node, alone, self._publishers(topic), named, incident)
        self._judged[name] = judged
        active = next((row for row in named if row.publishing), None)
        row: Document = {
            **service_row(service, running, judged, self._duties.get(name)),
            "incident": incident.id if incident else None,
            "incident_key": key,
            "why": why(judged, incident),
            "remedies": remedies(
                service, judged, incident, self._commands.get(node, ""), self._namespace
            ),
            "strip": "".join(self._strips.get(name, ())),
            **values_of(self.ontology, service, active, self._figures.get(name), judged),
            "derivation": (
                elements(
                    self.ontology, self.som, service.properties, active.relations, active.inputs
                )
                if service is not None and active is not None
                else []
            ),
        }
        if self._rows.get(name) != row:
            self._rows[name] = row

    def _publishers(self, topic: str) -> List[facts.Publisher]:
        return [
            row
            for (monitor, _), row in self._on_topic.get(topic, {}).items()
            if self._healer_state(_monitor(monitor)) != "lost"
        ]

    def _health_told(self, told: facts.HealthTold) -> None:
        table = self._health.setdefault(told.monitor, {})
        gone = [*table] if told.whole else [key for key in told.removed if key in table]
        for key in gone:
            del table[key]
            self._on_topic.get(key[0], {}).pop((told.monitor, key[1]), None)
        for row in told.rows:
            table[row.topic, row.publisher] = row
            self._on_topic.setdefault(row.topic, {})[told.monitor, row.publisher] = row
        self._touch_topics({*(topic for topic, _ in gone), *(row.topic for row in told.rows)})

    def _services_told(self, told: facts.ServicesTold) -> None:
        gone = {*self._running} if told.whole else {*told.removed}
        for name in gone:
            self._running.pop(name, None)
        self._running.update({row.service: row for row in told.rows})
        self._touch({*gone, *(row.service for row in told.rows)})

    def _substitutes_told(self, told: facts.SubstitutesTold) -> None:
        gone = {*self._substitutes} if told.whole else {*told.removed}
        concerned = {row.service for key, row in self._substitutes.items() if key in gone}
        for row in told.rows:
            before = self._substitutes.get(row.key)
            concerned |= {row.service, before.service if before else ""}
        for key in gone:
            self._substitutes.pop(key, None)
        self._substitutes.update({row.key: row for row in told.rows})
        self._touch(concerned - {""})

    def _incident_told(self, told: facts.IncidentTold) -> None:
        self._incidents.add(told.incident, told.logged)
        self._touch({told.incident.service})

    def _figures_told(self, told: facts.FiguresTold) -> None:
        for row in told.rows:
            known = row.service in self.som.services or row.service in self._running
            if known and self._figures.get(row.service) != row:
                self._figures[row.service] = row
                self._touch({row.service})

    def _duties_told(self, told: facts.DutiesTold) -> None:
        if self._duties.get(told.service) != told.duties:
            self._duties[told.service] = told.duties
            self._touch({told.service})

    def _commands_told(self, told: facts.CommandsTold) -> None:
        self._commands.update(told.commands)

    def _healer(self, told: facts.Healer) -> None:
        before = self._healers.get(told.name)
        self._healers[told.name] = told
        if told.name == RECONFIGURATOR and not told.connected:
            self._touch(self._incidents.leave_open())
        if before is None or before.state != told.state:
            self._touch(self._rows)

    def _maintenance_told(self, told: facts.MaintenanceTold) -> None:
        self._maintained = told.on

    def _host(self, told: facts.HostTold) -> None:
        self._hosts[told.name] = told

    def _trusted(self, told: facts.TrustTold) -> None:
        self._trust = told

    def _models_read(self, read: facts.ModelsRead) -> None:
        self.ontology, self.som = read.ontology, read.som
        self._witnesses = WitnessTable(self.ontology, self.som)
        self._touch({*self._rows, *read.som.services})

    def _touch_topics(self, topics: Iterable[str]) -> None:
        for topic in topics:
            self._touch(service.name for service in self.som.of_topic(topic))

    def _touch(self, services: Iterable[str]) -> None:
        self._dirty.update(services)


def _monitor(host: str) -> str:
    """Return the name of the monitor of a computer; empty: that of all others."""
    return f"{MONITOR}_{host}" if host else MONITOR


def _substitute(row: facts.Substitute) -> Document:
    return {
        "service": row.service,
        "publishing": row.publishing,
        "inputs": list(row.inputs),
        "outputs": list(row.outputs),
        "relations": list(row.relations),
        "code": row.code,
        "quality": row.quality,
        "host": row.host,
    }
