"""The substitute's core: what it computes, when it publishes, and to whom."""
import math
from dataclasses import replace
from typing import Callable, Dict, Iterable, List, Optional, Set, Tuple

from shsa_core.dispatch import Table, table
from shsa_core.errors import ShsaError
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.substitution import events
from shsa_core.substitution.advertising import Advertising
from shsa_core.substitution.bridging import Bridging
from shsa_core.substitution.cut_off import CutOff
from shsa_core.substitution.events import Command, Event, LastMessage, Level, Log, Unusable
from shsa_core.substitution.freshness import Freshness
from shsa_core.substitution.job import Job, Words, words
from shsa_core.substitution.overhearing import Overhearing
from shsa_core.substitution.schedule import Schedule
from shsa_core.substitution.settings import Settings
from shsa_core.substitution.stamps import Stamps
from shsa_core.substitution.yielding import Yielding


class Substitute:
    """Follows its row of the table of substitutions.

    The program, whether it publishes, and whom it stands in for.

    Muted, it goes on computing, so that it can publish at once. Idle, it listens to what it might
    have to compute from, and advertises what it might have to publish.
    """

    def __init__(self, settings: Settings = Settings()) -> None:
        self._settings = settings
        self._now = -math.inf
        self._row = Substitution("", "", (), "", ())
        self._job: Optional[Job] = None
        self._refused: Optional[Words] = None
        self._gave_out = False  # and the reconfigurator was told
        self._schedule = Schedule(None, math.inf)
        self._rests_until = -math.inf
        self._said: List[Command] = []
        self._types: Dict[str, str] = {}
        self._plans: Dict[str, Substitution] = {}
        self._unusable: Dict[Signal, str] = {}
        self._freshness = Freshness()
        self._stamps = Stamps()
        self._composed: Optional[events.Compose] = None
        self._complained = False
        self._advertising = Advertising(settings)
        self._yielding = Yielding(settings)
        self._others = Overhearing()
        self._cut_off = CutOff(self._others)
        self._bridging = Bridging(self._others)
        self._wanted: Optional[float] = None  # when it wanted to wake
        self._overheard: Set[str] = set()
        self._handlers: Table[List[Command]] = table(
            Event,
            {
                events.Started: self._started,
                events.RowChanged: self._row_changed,
                events.RowRemoved: self._row_removed,
                events.LeftAlone: self._left_alone,
                events.PlansChanged: self._plans_changed,
                events.InputArrived: self._input_arrived,
                events.Advertised: self._advertised,
                events.ConsumerJoined: self._consumer_joined,
                events.SubscribersFound: self._subscribers_found,
                events.CallFailed: self._call_failed,
                events.OriginalServes: self._original_serves,
                events.OtherHeard: self._other_heard,
                events.OtherGone: self._other_gone,
                events.OthersStand: self._others_stand,
                events.ReachChanged: self._reach_changed,
                events.Tick: self._tick,
            },
        )

    def handle(self, event: Event) -> List[Command]:
        """The commands that an event calls for.

        What has become due meanwhile is among them, messages first.
        """
        self._now = max(self._now, event.time)
        self._others.watch.look(self._now, self._wanted)
        self._at_its_own(self._cut_off.pass_time)
        commands: List[Command] = self._handlers[type(event)](event)
        commands += self._publish()
        commands += self._yielding.due(self._now)
        commands += self._advertising.due(self._now)
        look = None if self._yielding.yields(self._now) else self._bridging.due(self._now)
        commands += [look] if look is not None else []
        self._said, self._wanted = commands, self.next_deadline()
        return commands

    def next_deadline(self) -> Optional[float]:
        """When the next Tick is wanted; None: not before another event."""
        due = self._due if self._values() is not None else math.inf
        # Nobody is filled in for while consumers are handed over: that ends by itself.
        yields = self._yielding.yields(self._now)
        bridge = math.inf if yields else self._bridging.next(self._now)
        alone = min(self._cut_off.next, bridge)
        soonest = min(due, self._yielding.next(), self._advertising.next(), alone)
        return None if soonest == math.inf else soonest

    @property
    def publishing(self) -> bool:
        """Whether it publishes; it does not where its program is not for what its row names."""
        job = self._job
        publishes = self._cut_off.publishes or self._bridging.on or self._row.gated
        return publishes and job is not None and job.topic in self._row.topics

    @property
    def hurries(self) -> bool:
        """Whether what arrives is waited for.

        Else it may be told later, and of each input the newest alone.
        """
        job = self._job
        if job is None:
            return False
        waits = self._cut_off.listens or self._yielding.yields(self._now)
        return self.publishing or waits or job.period is None

    @property
    def reads_at(self) -> float:
        """When it computes from its inputs next, in s; before that they need not be told to it."""
        return math.inf if self._job is None else self._due

    def validate(self) -> None:
        """Raises ShsaError if what must always hold after an event does not."""
        job, now = self._job, self._now
        yields = self._yielding.yields(now)
        published = [each for each in self._said if isinstance(each, events.Publish)]
        looked = any(isinstance(each, events.LookAtOriginal) for each in self._said)
        held = {
            "muted, it publishes only while it yields": not published or self.publishing or yields,
            "it publishes one message at most": len(published) <= 1,
            "it publishes where it has advertised": all(
                self._advertising.ready(each.outputs[0].topic) for each in published
            ),
            "without a program nothing is due": job is not None or self._due == math.inf,
            "what is due is done, unless an input is stale": self._due > now
            or self._values() is None,
            "it listens to what it computes from": job is None
            or all(self._freshness.listens(signal) for signal in job.inputs),
            "it advertises what it computes": job is None or job.topic in self._advertising.topics,
            "it stands in for an original only while it publishes or yields": not (
                self._yielding.original or self._yielding.served or looked
            )
            or self.publishing
            or yields,
            "it publishes no integral from nobody knows where": not published
            or job is None
            or not job.unstarted,
            "a stamp is the newest of its topic": all(
                each.stamp == self._stamps.latest(each.outputs[0].topic) for each in published
            ),
            "all that is due has been said": (self.next_deadline() or math.inf) > now,
        }
        broken = [what for what, holds in held.items() if not holds]
        if broken:
            raise ShsaError(f"{'; '.join(broken)}: not so at {now:g} after {self._said}")

    # What the row says.

    def _started(self, event: events.Started) -> List[Command]:
        self._stamps.clock(event.time, event.ros_time)
        commands = self._heed(event.row, event.unusable, None)
        if self._refused is not None:
            return [events.GiveUp(command.text) for command in commands if isinstance(command, Log)]
        return commands

    def _row_changed(self, event: events.RowChanged) -> List[Command]:
        self._stamps.clock(event.time, event.ros_time)
        return self._heed(event.row, event.unusable, event.last)

    def _row_removed(self, _: events.RowRemoved) -> List[Command]:
        """Whoever made the table may have started anew, and learns of us later.

        Go on as told last, but fill in for nobody.
        """
        self._at_its_own(self._bridging.forget)
        return [Log(Level.DEBUG, "the table has no row of this node any more")]

    def _left_alone(self, _: events.LeftAlone) -> List[Command]:
        """Who publishes goes on; who only stands by for a reconfigurator has nobody to wait for.

        One that somebody started by hand has no service, and is none of a reconfigurator's.
        """
        stands_by = self._row.idle or self._row.service != ""
        if self.publishing or not stands_by:
            return []
        return [events.GiveUp(events.LEFT_ALONE)]

    def _plans_changed(self, event: events.PlansChanged) -> List[Command]:
        """Be ready for each plan, as long as there is no work."""
        told = {row.service: row for row in event.rows}
        gone = [name for name in self._plans if name not in told] if event.whole else event.removed
        for name in gone:
            self._plans.pop(name, None)
        self._plans.update(told)
        self._unusable.update(event.unusable)
        return self._prepare(self._here(event.rows)) if self._row.idle else []

    def _here(self, plans: Iterable[Substitution]) -> Tuple[Substitution, ...]:
        """The plans that are placed on this computer."""
        return tuple(each for each in plans if each.host == self._row.host)

    def _heed(
        self, row: Substitution, unusable: Unusable, last: Optional[LastMessage]
    ) -> List[Command]:
        before, topic = self.publishing, self._topic
        another_message = row.last_message != self._row.last_message
        computed = before and self._row.quality > 0.0
        self._row = row
        self._unusable.update(unusable)
        here = self._here(self._plans.values())
        commands = self._prepare((row, *here)) if row.idle else self._work(row, computed)
        commands += self._follow_others(row)
        after, stays = self.publishing, self._topic == topic and topic in row.topics
        period = None if self._job is None else self._job.period
        same = stays and row.original == self._yielding.original
        if after and not (before and same):
            self._yielding.stand_in(self._topic, row.original, period, self._now)
        elif not after and not same:
            original = row.original if before and stays else ""
            self._yielding.stand_in(self._topic, original, period, self._now)
        if after and not before:
            self._schedule.begin(self._now)
        if before and not after:
            self._yielding.mute(self._now)
        job = self._job
        if last is not None and job is not None:
            if another_message or not before or job.unstarted:
                job.start(last.values)
                self._complained = False
                self._stamps.begin(job.topic, last.stamp)
        return commands + self._compose(last)

    def _follow_others(self, row: Substitution) -> List[Command]:
        """Listen for others on the topic if that matters, where it is not done yet."""
        job, topic = self._job, self._topic
        self._cut_off.follow(row, topic)
        self._bridging.follow(row, topic, job is not None and not job.integrates)
        listens = self._cut_off.listens or self._bridging.listens
        self._others.listen(topic if listens else "")
        if not listens or topic in self._overheard:
            return []
        self._overheard.add(topic)
        return [events.Overhear(topic, self._types[topic])]

    def _at_its_own(self, change: Callable[[], None]) -> None:
        """Take something that may have it publish, or be still, otherwise than its row says.

        The original cannot be asked whom it serves: all are served, or none.
        """
        before = self.publishing
        change()
        if self.publishing is not before:
            self._yielding.stand_in(self._topic, "", None, self._now)
        if self.publishing and not before:
            self._schedule.begin(self._now)

    def _compose(self, last: Optional[LastMessage]) -> List[Command]:
        """Say what messages start from, if that has changed."""
        job, row = self._job, self._row
        if job is None or self._refused is not None:
            return []
        overheard = self._bridging.on
        message = b"" if last is None or overheard else row.last_message
        errors = (None if each.error is None else each.error.rms for each in job.outputs)
        # No message says that it is certain: an error of 0 is written as one that is not known.
        written = tuple((each.field, error or None) for each, error in zip(job.outputs, errors))
        kind = job.outputs[0].type
        compose = events.Compose(job.topic, kind, written, row.others, message, overheard)
        if compose == self._composed:
            return []
        self._composed = compose
        return [compose]

    @property
    def _topic(self) -> str:
        """The topic of its program; empty if it has none."""
        return "" if self._job is None else self._job.topic

    def _prepare(self, rows: Iterable[Substitution]) -> List[Command]:
        """Have no program, and be ready for one: what cannot be used must not hurt the rest."""
        self._job, self._refused = None, None
        self._schedule = Schedule(None, math.inf)
        commands: List[Command] = []
        for row in rows:
            problems = self._problems(row)
            commands += [
                Log(Level.WARNING, f"does not prepare for {signal.path}: {why}")
                for signal, why in problems.items()
            ]
            usable = tuple(signal for signal in row.inputs if signal not in problems)
            commands += self._listen(usable)
            outputs = tuple(signal for signal in row.outputs if signal not in problems)
            self._types.update({signal.topic: signal.type for signal in outputs})
            commands += self._advertising.prepare(outputs)
        here = self._here(self._plans.values())
        wanted = {topic for row in (self._row, *here) for topic in row.topics}
        self._advertising.leave_all_but(wanted, self._now)
        return commands

    def _work(self, row: Substitution, computed: bool) -> List[Command]:
        """Compute the program of a row; if that is not possible, the old one goes on.

        `computed`: what the old one yields is published, and is not just safe.
        """
        if self._job is not None and self._job.follow(row):
            self._refused = None
            self._reschedule(self._job.period)
            return self._listen(row.inputs)
        if words(row) == self._refused:
            return []
        try:
            for signal, why in self._problems(row).items():
                raise ShsaError(f"{signal.path}: {why}")
            job = Job(row, self._settings)
        except ShsaError as error:
            self._refused = words(row)
            return [Log(Level.ERROR, f"refuses its program: {error}")]
        old, self._job, self._refused = self._job, job, None
        self._gave_out = False
        self._complained = False
        if old is not None and old.topic == job.topic and computed:
            job.start(old.published)  # it goes on where the old one was
        if old is not None and old.topic == job.topic:
            self._reschedule(job.period)
        else:
            self._schedule = Schedule(job.period, self._now)
        commands = self._listen(job.inputs)
        self._types[job.topic] = job.outputs[0].type
        return commands + self._advertising.take(job.outputs[0], self._now)

    def _problems(self, row: Substitution) -> Dict[Signal, str]:
        """The signals of a row that cannot be used here, each with the reason."""
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
        new = self._freshness.listen(inputs)
        return [events.Listen(new)] if new else []

    def _reschedule(self, period: Optional[float]) -> None:
        """Take another period; the phase stays."""
        latest = self._now + (math.inf if period is None else period)
        self._schedule = Schedule(period, min(self._schedule.due, latest))

    # When it publishes.

    def _input_arrived(self, event: events.InputArrived) -> List[Command]:
        self._stamps.clock(event.time, event.ros_time)
        stamp = min(event.stamp or event.ros_time, event.ros_time)
        age = event.ros_time - stamp
        self._freshness.take(event.time, event.topic, event.publisher, event.values, stamp, age)
        job = self._job
        if self._bridging.on:
            self._at_its_own(lambda: self._bridging.feed(self._sources()))
        if job is not None and job.period is None:
            if any(signal.topic == event.topic for signal in job.inputs):
                self._schedule.hasten(self._now)
        return []

    def _consumer_joined(self, event: events.ConsumerJoined) -> List[Command]:
        """It may have waited for long: it hears the newest message at once, and alone.

        Nobody hears it twice.
        """
        job = self._job
        if job is None or job.latest is None or self._values() is None:
            return []
        ours = self.publishing and event.topic == job.topic and self._advertising.ready(job.topic)
        if not ours or event.consumer in self._yielding.served or job.unstarted:
            return []
        return [events.Publish(job.outputs, job.latest, only=event.consumer, stamp=self._stamp())]

    def _values(self) -> Optional[Tuple[float, ...]]:
        """The inputs now; None without a program, and while an input is missing or stale."""
        if self._job is None:
            return None
        return self._freshness.values(self._job.inputs, self._now)

    def _publish(self) -> List[Command]:
        """Evaluate the program if that is due, and publish unless an original may have done so.

        What is due while an input is stale follows as soon as it is not.
        """
        commands = self._evaluate()
        job = self._job
        if self._yielding.release(self._now) and job is not None and self._may_publish(job):
            commands.append(self._message(job))
        return commands

    @property
    def _due(self) -> float:
        """When the program is to be evaluated: once a period if that matters, else now and then."""
        if self._job is None or self._job.remembers or self.hurries:
            return self._schedule.due
        return max(self._schedule.due, self._rests_until)

    def _evaluate(self) -> List[Command]:
        job, values = self._job, self._values()
        if job is None or values is None or self._now < self._due:
            return []
        job.evaluate(values, self._now)
        self._rests_until = self._now + self._settings.rest_s
        self._schedule.done(self._now)
        if job.gave_out and not self._gave_out:
            self._gave_out = True
            return [events.TellNoValue(self._row.service, job.topic)]
        self._gave_out = job.gave_out
        if not self._may_publish(job):
            return []
        complaints = self._complaints(job)
        if job.unstarted or self._yielding.hold(self._now):
            return complaints
        return [*complaints, self._message(job)]

    def _may_publish(self, job: Job) -> bool:
        """Whether it has something to publish, and may."""
        if job.latest is None or not self._advertising.ready(job.topic) or self._values() is None:
            return False
        return self.publishing or self._yielding.yields(self._now)

    def _message(self, job: Job) -> events.Publish:
        assert job.latest is not None
        served = self._yielding.served
        return events.Publish(job.outputs, job.latest, served, stamp=self._stamp())

    def _stamp(self) -> int:
        """The stamp of a message that is made now: its oldest input's."""
        assert self._job is not None
        oldest = self._freshness.oldest(self._job.inputs)
        return self._stamps.of(self._job.topic, oldest, self._now)

    def _complaints(self, job: Job) -> List[Command]:
        """What is said once of a program that integrates from nobody knows where."""
        if self._complained or (self._row.gated and not self._row.publishing):
            return []
        self._complained = True
        said: List[Command] = []
        if job.unstarted:
            fields = ", ".join(job.unstarted)
            text = f"publishes nothing: no last good message says where {fields} of {job.topic} was"
            said.append(Log(Level.ERROR, text))
        if job.hidden_integral:
            text = f"{job.topic} is computed with an integral that has started at 0"
            said.append(Log(Level.WARNING, text))
        return said

    # What is answered.

    def _advertised(self, event: events.Advertised) -> List[Command]:
        return self._advertising.advertised(event.topic, self._now)

    def _subscribers_found(self, event: events.SubscribersFound) -> List[Command]:
        return self._advertising.found(event)

    def _call_failed(self, event: events.CallFailed) -> List[Command]:
        return [Log(Level.WARNING, f"{event.what}: {event.detail}")]

    def _original_serves(self, event: events.OriginalServes) -> List[Command]:
        self._yielding.heard(event)
        return []

    def _other_heard(self, event: events.OtherHeard) -> List[Command]:
        silence = self._others.silence
        if self._others.heard(event):
            self._at_its_own(self._cut_off.heard)
            self._at_its_own(lambda: self._bridging.heard(silence, self._sources()))
        return []

    def _other_gone(self, event: events.OtherGone) -> List[Command]:
        last = self._others.last
        heard = last is not None and (last.topic, last.publisher) == (event.topic, event.publisher)
        if not heard or self._yielding.yields(self._now):
            return []
        return self._bridge(lambda: self._bridging.gone(self._now, self._sources()))

    def _others_stand(self, event: events.OthersStand) -> List[Command]:
        return self._bridge(lambda: self._bridging.stand(event, self._sources()))

    def _bridge(self, change: Callable[[], None]) -> List[Command]:
        """Take something that may begin a bridge: messages start from the original's last one."""
        before, last = self._bridging.on, self._others.last
        self._at_its_own(change)
        if before or not self._bridging.on or last is None or self._composed is None:
            return []
        self._stamps.begin(self._topic, last.stamp)
        self._composed = replace(self._composed, overheard=True, last_message=b"")
        return [self._composed]

    def _sources(self) -> Tuple[str, ...]:
        return () if self._job is None else self._freshness.sources(self._job.inputs)

    def _reach_changed(self, event: events.ReachChanged) -> List[Command]:
        self._at_its_own(lambda: self._cut_off.reach(event.cut_off))
        return []

    def _tick(self, _: events.Tick) -> List[Command]:
        return []
