"""The substitute's core: what it computes, when it publishes, and to whom."""
import math
from dataclasses import replace
from typing import Dict, Iterable, List, Optional, Tuple

from shsa_core.dispatch import Table, table
from shsa_core.errors import ShsaError
from shsa_core.model.log import Level
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.substitution import events
from shsa_core.substitution.advertising import Advertising
from shsa_core.substitution.alone import Alone
from shsa_core.substitution.events import Command, Event, LastMessage, Log
from shsa_core.substitution.handover import Handover
from shsa_core.substitution.job import Job, Stamps, words
from shsa_core.substitution.others import OtherPublishers
from shsa_core.substitution.readings import Readings
from shsa_core.substitution.voice import Heard, Order, Original, Voice, decide


class Substitute:
    """Follows its row of the table of substitutions.

    Muted, it goes on computing, so that it can publish at once. Idle, it listens to what it might
    have to compute from, and advertises what it might have to publish. `next_deadline`: when the
    next Tick is wanted; inf: not before another event.
    """

    def __init__(self) -> None:
        self._now = -math.inf
        self.row = Substitution("", "", (), "", ())
        self._job: Optional[Job] = None
        self._refused: Optional[Tuple[object, ...]] = None
        self._readings = Readings()
        self._stamps = Stamps()
        self._advertising = Advertising()
        self._voice, self._spoken = Voice.MUTED, ""  # and the topic on which it spoke last
        self._handover = Handover()
        self._others = others = OtherPublishers(self._sources)
        self._alone = Alone()
        self._composed: Optional[events.Compose] = None
        self._types: Dict[str, str] = {}
        self._plans: Dict[str, Substitution] = {}
        self._unusable: Dict[Signal, str] = {}
        self.next_deadline = math.inf
        self._handlers: Table[Optional[List[Command]]] = table(
            Event,
            {
                events.RowChanged: self._row_changed,
                # Whoever made the table may have started anew: it goes on as it was told last.
                events.RowRemoved: lambda e: others.forget(),
                events.PlansChanged: self._plans_changed,
                events.InputArrived: self._input_arrived,
                events.Advertised: lambda e: self._advertising.advertised(e.topic, self._now),
                events.ConsumerJoined: self._consumer_joined,
                events.OriginalServes: self._handover.answer,
                events.OtherHeard: self._other_heard,
                events.OtherGone: lambda e: None if self._hands_over else others.gone(e),
                events.OthersStand: others.answer,
                events.ReachChanged: self._reach_changed,
                events.FailureHeard: lambda e: self._alone.failed(e, self.row),
                events.Tick: lambda e: self._alone.due(e, self.row, self._plans.values()),
            },
        )

    def handle(self, event: Event) -> List[Command]:
        """Return the commands that an event, and what is due by then, call for: messages first."""
        self._now = now = max(self._now, event.time)
        self._others.pass_time(now, self.next_deadline)
        commands = self._handlers[type(event)](event) or []
        commands += self._speak()
        commands += self._publish()
        commands += self._handover.due(now)
        commands += self._advertising.due(now)
        commands += [] if self._hands_over else self._others.due(now)
        self.next_deadline = self._next_deadline()
        return commands

    def _next_deadline(self) -> float:
        due = self.reads_at if self._values() is not None else math.inf
        # Nobody is filled in for while consumers are handed over: that ends by itself.
        others = self._others.next(self._now, not self._hands_over)
        return min(due, self._handover.next(), self._advertising.next(), others, self._alone.look)

    @property
    def topics(self) -> Tuple[str, ...]:
        """Return the topics that it has advertised."""
        return self._advertising.topics

    @property
    def publishing(self) -> bool:
        """Return if all consumers are its own."""
        return self._voice.publishes

    @property
    def hurries(self) -> bool:
        """Return if what arrives is waited for; else of each input the newest may be told later."""
        waits = self._others.heals or self._voice is not Voice.MUTED
        return self._job is not None and (waits or self._job.period is None)

    @property
    def reads_at(self) -> float:
        """Return when it computes from its inputs next, in s; before they need not be told it."""
        return math.inf if self._job is None else self._job.due(self.hurries)

    # Its row.

    def _row_changed(self, event: events.RowChanged) -> List[Command]:
        """Follow the row; give up where it cannot do what it was started for."""
        speaks = self.publishing and self._values() is not None
        if not self._alone.counts(event.row, self._job is not None, speaks):
            return []
        first = not self.row.node
        self._stamps.clock(event.time, event.ros_time)
        self._unusable.update(event.unusable)
        commands = self._follow(event.row, event.last)
        if first and self._refused is not None:
            return [events.GiveUp(command.text) for command in commands if isinstance(command, Log)]
        return commands

    def _reach_changed(self, event: events.ReachChanged) -> List[Command]:
        """Go on publishing; alone, end if it stands by, unless somebody started it by hand."""
        self._others.part(event.cut_off)
        ends = event.alone and not self.publishing and (self.row.idle or self.row.service != "")
        return [events.GiveUp(events.LEFT_ALONE)] if ends else []

    def _follow(self, row: Substitution, last: Optional[LastMessage]) -> List[Command]:
        publishes, others = self.publishing, self._others
        computed = publishes and self.row.quality > 0.0
        another_message = row.last_message != self.row.last_message
        self.row = row
        plans = self._plans.values()
        commands = self._prepare((row, *plans)) if row.idle else self._work(row, computed)
        job = self._job
        before = others.topic, others.provider
        others.follow(row, "" if job is None else job.topic, job is not None and not job.integrates)
        if others.topic and (others.topic, others.provider) != before:
            kind = self._types[others.topic]
            commands.append(events.Overhear(others.topic, kind, others.provider))
        self._take_up_voice(by_row=True)
        if last is not None and job is not None:
            if another_message or not publishes or job.unstarted:
                job.start(last.values, self._stamps.time(last.stamp))
                self._stamps.begin(job.topic, last.stamp)
        return commands + self._compose(last)

    def _work(self, row: Substitution, computed: bool) -> List[Command]:
        """Compute the program of a row; if that is not possible, the old one goes on.

        `computed`: what the old one yields is published, and is not just safe.
        """
        if self._job is not None and self._job.follow(row, self._now):
            self._refused = None
            return self._listen(row.inputs)
        if words(row) == self._refused:
            return []
        try:
            for signal, why in self._problems(row).items():
                raise ShsaError(f"{signal.path}: {why}")
            job = Job(row, self._now)
        except ShsaError as error:
            self._refused = words(row)
            return [Log(Level.ERROR, f"refuses its program: {error}")]
        if self._job is not None and self._job.topic == job.topic:
            job.succeed(self._job, computed, self._now)
        self._job, self._refused = job, None
        self._types[job.topic] = job.outputs[0].type
        return self._listen(job.inputs) + self._advertising.hurry(job.outputs[0], self._now)

    def _compose(self, last: Optional[LastMessage]) -> List[Command]:
        job, row = self._job, self.row
        if job is None or self._refused is not None:
            return []
        overheard = self._voice is Voice.FILLS_IN
        message = row.template if last is None else row.last_message
        kind = job.outputs[0].type
        compose = events.Compose(job.topic, kind, job.written, row.others, message, overheard)
        before, self._composed = self._composed, compose
        return [] if compose == before else [compose]

    # Ready for any of several programs.

    def _plans_changed(self, event: events.PlansChanged) -> List[Command]:
        told = {row.service: row for row in event.rows}
        gone = [name for name in self._plans if name not in told] if event.whole else event.removed
        for name in gone:
            self._plans.pop(name, None)
        self._plans.update(told)
        self._unusable.update(event.unusable)
        return self._prepare(event.rows) if self.row.idle else []

    def _prepare(self, rows: Iterable[Substitution]) -> List[Command]:
        """Have no program, and be ready for each that is placed here, as far as it can be used."""
        self._job, self._refused = None, None
        here = self.row.host
        commands: List[Command] = []
        for row in (each for each in rows if each.host == here):
            problems = self._problems(row)
            commands += [
                Log(Level.WARN, f"does not prepare for {signal.path}: {why}")
                for signal, why in problems.items()
            ]
            commands += self._listen(tuple(each for each in row.inputs if each not in problems))
            outputs = tuple(signal for signal in row.outputs if signal not in problems)
            self._types.update({signal.topic: signal.type for signal in outputs})
            commands += self._advertising.prepare(outputs)
        wanted = set(self.row.topics)
        wanted.update(*(plan.topics for plan in self._plans.values() if plan.host == here))
        self._advertising.leave_all_but(wanted, self._now)
        return commands

    def _problems(self, row: Substitution) -> Dict[Signal, str]:
        problems: Dict[Signal, str] = {}
        for signal in (*row.inputs, *row.outputs):
            known = self._types.get(signal.topic, signal.type)
            if signal in self._unusable:
                problems[signal] = self._unusable[signal]
            elif known != signal.type:
                problems[signal] = f"it is a {known} to this process, and cannot be a {signal.type}"
        return problems

    def _listen(self, inputs: Tuple[Signal, ...]) -> List[Command]:
        self._types.update({signal.topic: signal.type for signal in inputs})
        return [events.Listen(each) for each in self._readings.listen(inputs)]

    # Its voice.

    def _speak(self) -> List[Command]:
        """Take up the voice that is right now: who fills in starts from what was heard last."""
        idle, others = self._alone.idle, self._others
        if idle is not None and self._job is not None and others.heard is Heard.RIVAL:
            if self._alone.leaves(others.last.publisher):
                self._alone.idle = None
                return self._follow(idle, None)
        if not self._take_up_voice() or self._composed is None:
            return []
        self._composed = replace(self._composed, overheard=True)
        return [self._composed]

    def _take_up_voice(self, by_row: bool = False) -> bool:
        """Take up the voice that the table gives; return if it begins to fill in.

        `by_row`: the row has changed, which names the original. What a substitute begins or ends
        by itself it does for nobody who could be asked whom it serves.
        """
        now, job, before = self._now, self._job, self._voice
        topic = "" if job is None else job.topic
        self._voice = after = self._decide(topic)
        begins = after.publishes and not before.publishes
        ends = before.publishes and not after.publishes
        if by_row or begins or ends:
            stays = topic == self._spoken and topic in self.row.topics
            original = self.row.original if by_row else ""
            if begins or not (stays and original == self._handover.original):
                named = after.publishes or (ends and stays)
                period = None if job is None else job.period
                self._handover.stand_in(topic, original if named else "", period, now)
            if ends:
                self._handover.mute(now)
            self._voice = self._decide(topic)  # it may hand over now
        if begins and job is not None:
            job.schedule.begin(now)
            self._stamps.begin(self._others.last.topic, self._others.last.stamp)
        self._spoken = topic
        return after is Voice.FILLS_IN and before is not Voice.FILLS_IN

    def _decide(self, topic: str) -> Voice:
        row, others = self.row, self._others
        original = Original.BACK if self._hands_over else others.original
        order = Order.BRIDGE if others.bridge else Order.MUTE
        order = Order.PUBLISH if row.publishing else order
        order = Order.ALWAYS if row.gated else order
        order = order if topic in row.topics else Order.NOTHING
        return decide(order, others.heard, others.cut_off, original)

    @property
    def _hands_over(self) -> bool:
        """Return if it is muted, and serves whom its original does not serve yet."""
        return self._handover.under_way(self._now)

    def _sources(self) -> Tuple[str, ...]:
        return () if self._job is None else self._readings.sources(self._job.inputs)

    def _other_heard(self, event: events.OtherHeard) -> None:
        self._alone.hear(event)
        self._others.hear(event)

    # What it publishes.

    def _input_arrived(self, event: events.InputArrived) -> None:
        self._stamps.clock(event.time, event.ros_time)
        self._readings.take(event)
        self._others.compare()
        job = self._job
        if job is not None and job.period is None:
            if any(signal.topic == event.topic for signal in job.inputs):
                job.schedule.begin(self._now)

    def _values(self) -> Optional[Tuple[float, ...]]:
        """Return the inputs now; None without a program, and while one is missing or stale."""
        return None if self._job is None else self._readings.values(self._job.inputs, self._now)

    def _publish(self) -> List[Command]:
        """Evaluate the program if that is due, and publish unless an original may have done so.

        What is due while an input is stale follows as soon as it is not.
        """
        job, values = self._job, self._values()
        commands: List[Command] = []
        if job is None or values is None:
            self._handover.release(self._now)
            return []
        goes = False
        if self._now >= self.reads_at:
            at = self._readings.times(job.inputs, self._now) if job.timed else ()
            if job.evaluate(values, self._now, at):
                commands += [events.TellNoValue(self.row.service, job.topic)]
            elif self._may_publish(job):
                if not self.row.gated or self.row.publishing:
                    commands += job.complain()
                goes = not job.unstarted and not self._handover.hold(self._now)
        if self._handover.release(self._now):
            goes = self._may_publish(job) and not job.unstarted
        return commands + ([self._message(job)] if goes else [])

    def _may_publish(self, job: Job) -> bool:
        ready = job.latest is not None and self._advertising.ready(job.topic)
        return ready and self._voice is not Voice.MUTED

    def _message(self, job: Job, only: str = "") -> events.Publish:
        """Return a message for all whom the original does not serve, or for one consumer."""
        assert job.latest is not None
        oldest = self._readings.oldest(job.inputs)
        stamp = self._stamps.of(job.topic, oldest, self._now)
        served = frozenset() if only else self._handover.served
        return events.Publish(job.outputs, job.latest, served, only, stamp)

    def _consumer_joined(self, event: events.ConsumerJoined) -> List[Command]:
        """Publish to it at once, and alone: it may have waited for long."""
        job = self._job
        if job is None or event.topic != job.topic or self._values() is None:
            return []
        hears_another = not self.publishing or event.consumer in self._handover.served
        if hears_another or not self._may_publish(job) or job.unstarted:
            return []
        return [self._message(job, event.consumer)]
