"""What a reconfigurator writes down before it acts, and what the next one takes up of it."""
from dataclasses import replace
from typing import Dict, List

from shsa_core.codegen.generator import Program
from shsa_core.healing import events
from shsa_core.healing.events import Command, Level, Log
from shsa_core.healing.incident import Incident, State
from shsa_core.healing.records import (
    Counters,
    HealingRecord,
    Healthy,
    IdleProcess,
    RestartedNode,
    Stray,
    healthy_key,
)
from shsa_core.healing.upkeep import Upkeep
from shsa_core.model.kinds import QUIET, Kind
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import PublisherHealth, PublisherState


class Succession(Upkeep):
    """Keeps the records, and begins with those of a former reconfigurator.

    Nothing in them is believed that does not fit: a process counts if it is known to run, a program
    if it is a plan of the models as they are now, a health until the monitor tells another.
    """

    def _take_up(self, event: events.Started) -> List[Command]:
        running = dict.fromkeys(event.running)
        found = [self.names.avoid(node) for node in running]
        for node in (node for node, ours in zip(running, found) if ours):
            self._nodes.substitutes.add(node, running)
        for record in event.records:
            if isinstance(record, Counters):
                self._incidents = max(self._incidents, record.incidents)
                self.names.go_on(record.names)
            elif isinstance(record, HealingRecord) and record.substitution is not None:
                row = record.substitution
                self._nodes.substitutes.add(row.node)
                service = self._som.services.get(record.service)
                if service is not None and row.shared:  # before any of them can end the process
                    self._sharing.follow(service, row.node, True)
                self._strays.runs_on(row.node, row.host)
            elif isinstance(record, Stray):
                self._strays.take_up(record)
            elif isinstance(record, IdleProcess) and record.host:
                self._strays.take_up(Stray(record.node, record.host))
            elif isinstance(record, RestartedNode) and record.node in running:
                self._with_us[record.node] = record.with_us
                self._records.put(record)
        healthy = [each for each in event.records if isinstance(each, Healthy)]
        commands = self._recall(event.time, healthy) + self._settle()
        for record in event.records:
            if isinstance(record, IdleProcess) and record.node in running and not record.host:
                self._take_up_idle(record)
        for record in event.records:
            if isinstance(record, HealingRecord):
                commands += self._take_up_healing(event.time, record, running)
        stopped = {each.node for each in commands if isinstance(each, events.StopSubstitute)}
        strays = {each.node for each in event.records if isinstance(each, Stray)}
        ours = {*self.substitutes, *self._with_us, *stopped, *strays}
        for node in running:
            if node not in ours:
                commands.append(Log(Level.WARN, f"Stopping orphaned substitute {node}."))
                commands.append(events.StopSubstitute(node))
        if event.records:
            commands.append(self._told())
        return commands

    def _recall(self, time: float, healthy: List[Healthy]) -> List[Command]:
        commands: List[Command] = []
        state = PublisherState.HEALTHY
        for each in healthy:
            former = self.names.avoid(each.publisher)
            if former and each.publisher not in self._nodes.substitutes:
                continue  # a substitute that has ended
            since = each.since
            row = PublisherHealth(each.topic, each.publisher, state, since, since, since)
            self._nodes.recall(time, (row,))
            self._records.put(each)
            if each.publisher not in self._nodes.substitutes:
                self._unsettle(self._concerned(each.topic, each.publisher))
                commands += self._acquaint(each.publisher, row)
        return commands

    def _take_up_idle(self, record: IdleProcess) -> None:
        if self._pool.deadline is not None:  # it lacks one
            self._nodes.substitutes.add(record.node)
            self._pool.take_up(record.node, record.started, "")
            self._substitutions.set(record.node, Substitution(record.node, "", (), "", ()))

    def _take_up_healing(
        self, time: float, record: HealingRecord, running: Dict[str, None]
    ) -> List[Command]:
        if record.service in self._som.services:
            if record.incident is not None and record.incident.last_good is not None:
                self._nodes.note_good(record.incident.topic, record.incident.faulty_node)
            if record.incident is not None and record.incident.killed is None:
                self._doubt_silent(record.incident)
            row = record.substitution
            if row is not None:
                paths = [tuple(each.path for each in s) for s in (row.inputs, row.outputs)]
                program = Program(paths[0], row.code, paths[1])
                self._calibrations.recall(record.service, program, row.outputs)
            runs = row is not None and row.node in running
            return self._ask(
                record.service, lambda healing, now: healing.take_up(now, record, runs)
            )
        incident = record.incident
        if incident is None:
            return []
        why = f"{record.service} is not in the SOM any more."
        ended = incident.ended is not None
        last = incident if ended else replace(incident, state=State.ENDED, ended=time, detail=why)
        return [events.ShowIncident(last)]

    def _doubt_silent(self, incident: Incident) -> None:
        """Who was silent on another computer may have been cut off, and be back by now."""
        silent = incident.kind in QUIET and incident.kind is not Kind.NODE_GONE
        if silent and self._where.host_of(incident.faulty_node):
            self._nodes.doubt(incident.topic, incident.faulty_node)

    def _told(self) -> Command:
        incidents = sum(healing.incident is not None for healing in self._healings.values())
        working, idle = len(self._concern.substituted), len(self._pool.nodes)
        text = f"{incidents} incidents, {working} substitutes, {idle} idle processes"
        return Log(Level.INFO, f"Taking up what was left behind: {text}.")

    def _note_health(self, topic: str, publisher: str) -> None:
        row = self._nodes.healthy(topic, publisher)
        record = None if row is None else Healthy(topic, publisher, row.since)
        self._records.set(healthy_key(topic, publisher), record)

    def _forget_restarted(self, node: str) -> bool:
        """A node that was started again is gone, or is ended; whether there was one."""
        self._records.set(f"restarted {node}", None)
        return self._with_us.pop(node, None) is not None

    def _write_down(self) -> List[Command]:
        """What has changed in the records."""
        self._records.put(Counters(self._incidents, self.names.next))
        idle = set(self._pool.nodes)
        for node in self._idle_written - idle:
            self._records.set(f"idle {node}", None)
        for node in idle - self._idle_written:
            self._records.put(self._pool.record(node))
        self._idle_written = idle
        records, removed = self._records.change()
        return [events.WriteDown(records, removed)] if records or removed else []
