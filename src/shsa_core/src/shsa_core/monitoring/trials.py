"""The services that are on probation: which numbers count, and for how long."""
from typing import Callable, List, Optional, Sequence

from shsa_core.model.service import Deadlines, Service
from shsa_core.monitoring.board import HEALTHY, UNKNOWN, Board, Trial
from shsa_core.monitoring.events import ChangeAdopted, ChangeRefused, Message
from shsa_core.monitoring.evidence import Finding
from shsa_core.monitoring.probation import Probation, as_judged, changes, only_loosens
from shsa_core.monitoring.publishers import Publisher, WatchedService, WatchedTopic
from shsa_core.watch import Watch


class Trials:
    """Puts changed services on probation, and adopts or refuses their new numbers.

    `watch(topic, time)` is called when other numbers count.
    """

    def __init__(
        self, board: Board, deadlines: Deadlines, watch: Callable[[WatchedTopic, float], None]
    ) -> None:
        self._board, self._deadlines, self._watch = board, deadlines, watch

    def begin(self, topic: WatchedTopic, services: Sequence[Service], time: float) -> None:
        """A topic has changed services.

        What a healthy publisher is judged by counts on, until it has shown to be good by the new;
        what only allows more counts at once.
        """
        topic.probations = {}
        for service in services:
            watched = topic.services.get(service.name)
            if watched is None or watched.service.node != service.node:
                continue
            if not any(each.watched is watched for each in topic.healthy()):
                continue
            kept = as_judged(service, watched.service)
            allowed = watched.would_allow(service, self._deadlines)
            looser = allowed >= watched.allowed and only_loosens(service, kept)
            if kept != service and not looser:
                probation = Probation(service, kept, allowed, time)
                topic.probations[service.name] = probation
                due = Trial(topic.name, service.name)
                self._board.agenda.bring_forward(due, time + probation.allowed)

    @staticmethod
    def counting(topic: WatchedTopic, services: Sequence[Service]) -> List[Service]:
        """The services of a topic, with the numbers that count."""
        on = topic.probations
        return [on[each.name].kept if each.name in on else each for each in services]

    @staticmethod
    def of(topic: WatchedTopic, watched: Optional[WatchedService]) -> Optional[Probation]:
        """The probation that the service of a publisher is on."""
        found = topic.probations.get(watched.service.name) if watched else None
        return None if found is None or found.refused else found

    def weigh(
        self,
        topic: WatchedTopic,
        publisher: Publisher,
        probation: Probation,
        event: Message,
        good: bool,
    ) -> bool:
        """Weigh a message by the new numbers as well; whether it is good.

        A node that starts anew and conforms to them alone decides for them.
        """
        if publisher.state is UNKNOWN and not good and probation.accepts(event):
            self._adopt(topic, probation, event.time)
            return True
        if publisher.state is HEALTHY and good:
            finding = probation.weigh(publisher, event)
            if finding is not None:
                self._refuse(publisher, probation, finding, event.time)
            elif probation.has_passed(publisher):
                self._adopt(topic, probation, event.time)
        return good

    def look(self, due: Trial, watch: Watch) -> None:
        """Refuse a change by which a healthy publisher is silent."""
        topic = self._board.topics.get(due.topic)
        watched = topic.services.get(due.service) if topic else None
        probation = self.of(topic, watched) if topic else None
        if topic is None or probation is None:
            return
        allowed = probation.allowed
        for publisher in topic.healthy():
            if publisher.watched is not watched:
                continue
            last = max(probation.began, publisher.last_message or probation.began)
            if watch.has_passed(last, allowed):
                finding = probation.silence(watch.now - last)
                self._refuse(publisher, probation, finding, watch.now)
                return
            self._board.agenda.bring_forward(due, watch.when(last, allowed))

    def _adopt(self, topic: WatchedTopic, probation: Probation, time: float) -> None:
        service = probation.service
        del topic.probations[service.name]
        self._watch(topic, time)
        text = f"{_place(service)}: {changes(service, probation.kept)}"
        self._board.decide(ChangeAdopted(time, service.name, text))

    def _refuse(
        self, publisher: Publisher, probation: Probation, finding: Finding, time: float
    ) -> None:
        probation.refused = True
        what = f"{_place(probation.service)}: {changes(probation.service, probation.kept)}"
        why = f"{publisher.name} is healthy, and would fail at once"
        text = f"{what}: {why}: {finding.kind}: {finding.detail}"
        self._board.decide(ChangeRefused(time, probation.kept, text))


def _place(service: Service) -> str:
    """Where a service stands: file and line, or parameter."""
    return service.where or service.name
