"""Finds what is wrong around a robot and its healing by what was seen of it, with remedies.

And what becomes of each node that fails, as healing decides.
"""
from typing import Callable, Dict, Iterator, List, Mapping, NamedTuple, Sequence, Tuple

from shsa_core.errors import listed
from shsa_core.healing.containment import Charge, decide
from shsa_core.healing.incident import Incident
from shsa_core.model.names import Names, full_name
from shsa_core.model.kinds import Kind, Policy
from shsa_core.model.service import Service
from shsa_core.model.som import Som

TABLE = "shsa/som_state"


class Finding(NamedTuple):
    """Something that is wrong, and its remedy."""

    what: str
    remedy: str


class Seen(NamedTuple):
    """A robot as it was found.

    `publishers` and `subscribers`: nodes by topic. `masters`: the nodes' programs by the address
    that they have of our master. `users`: the user of each node of the SOM whose process is here;
    `user`: that of healing, empty if it does not run. `clocks`: what healing tells of computers
    whose clock is off, and of values that are `unusual`. `incidents`: of the last hour. `types`:
    why a type cannot be used here. `duties`: what nodes of the SOM do beyond it. `log`: why the
    incident log cannot be read; empty: it can.
    """

    som: Som
    namespace: str
    publishers: Mapping[str, Sequence[str]]
    subscribers: Mapping[str, Sequence[str]]
    secret: str = ""
    masters: Mapping[str, Sequence[str]] = {}
    users: Mapping[str, str] = {}
    user: str = ""
    use_sim_time: bool = False
    clocks: Sequence[str] = ()
    unusual: Sequence[str] = ()
    incidents: Sequence[Incident] = ()
    types: Sequence[str] = ()
    duties: Mapping[str, Sequence[str]] = {}
    log: str = ""


def findings(seen: Seen) -> List[Finding]:
    """Return all that is wrong."""
    return [found for check in CHECKS for found in check(seen)]


def fates(seen: Seen) -> List[str]:
    """Return what becomes of each node here that publishes something wrong, and why."""
    told: Dict[str, None] = {}
    for service in seen.som:
        if service.node in seen.publishers.get(service.topic, ()):
            fate = fate_of(service, seen.duties.get(service.node, ()))
            told[f"if {service.node} fails it {fate}"] = None
    return list(told)


def fate_of(service: Service, duties: Sequence[str]) -> str:
    """Return what becomes of the node of a service if it publishes something wrong, and why."""
    node, wrong, restarts = service.node, Kind.OUT_OF_RANGE, service.policy.restarts
    charge = Charge(
        *(node, service.topic, wrong, service.contain, restarts),
        replaced=True,
        duties=tuple(duties),
        gated=service.gated,
    )
    verdict = decide(charge)
    fate = verdict.why[len(node) + 1 :]
    if service.policy is Policy.ADVISE:
        fate = f"is kept: the policy of {service.topic} is to advise"
    elif verdict.kill and duties:
        fate += f". That costs: it {' and '.join(duties)}"
    elif verdict.kill and charge.contain is None and not restarts:
        fate = "is killed if something replaces it, unless it is only silent"
    return fate


def _secret(seen: Seen) -> Iterator[Finding]:
    if seen.secret:
        remedy = "run healing and its tools as one user; what they share is made at the first start"
        yield Finding(seen.secret, remedy)


def _log(seen: Seen) -> Iterator[Finding]:
    if seen.log:
        remedy = "name the incident log of this robot with --log, as the user that runs healing"
        yield Finding(f"the incident log {seen.log}", remedy)


def _masters(seen: Seen) -> Iterator[Finding]:
    if len(seen.masters) > 1:
        named = "; ".join(f"{uri}: {listed(sorted(who))}" for uri, who in seen.masters.items())
        remedy = "set one ROS_MASTER_URI everywhere: one that all computers can resolve"
        yield Finding(f"the master has {len(seen.masters)} names: {named}", remedy)


def _users(seen: Seen) -> Iterator[Finding]:
    if seen.user == "root":
        remedy = "run healing as the user that runs the nodes"
        yield Finding("healing runs as root: it starts no node again", remedy)
    for node, user in seen.users.items():
        if seen.user and user != seen.user:
            what = f"{node} runs as {user}: healing, as {seen.user}, can neither end nor start it"
            yield Finding(what, f"run both as one user, or say `contain: none` for {node}")


def _clocks(seen: Seen) -> Iterator[Finding]:
    for text in seen.clocks:
        yield Finding(text, "synchronize the computers' clocks, as chrony does")
    if seen.use_sim_time and not seen.publishers.get("/clock"):
        remedy = "start what publishes /clock, or `rosparam set /use_sim_time false` and start anew"
        yield Finding("/use_sim_time is true, and nobody publishes /clock: time stands", remedy)


def _ranges(seen: Seen) -> Iterator[Finding]:
    left: Dict[str, List[Incident]] = {}
    for incident in seen.incidents:
        if incident.kind is Kind.OUT_OF_RANGE:
            left.setdefault(incident.service, []).append(incident)
    for service, incidents in left.items():
        times = "once" if len(incidents) == 1 else f"{len(incidents)} times"
        what = f"{service} left its range {times} in the last hour: {incidents[-1].evidence}"
        yield Finding(what, "if the robot was well, widen `range` to what the datasheet says")
    for text in seen.unusual:
        yield Finding(text, "if the robot is well, widen `usual`, as `shsa init --again` does")


def _unheard(seen: Seen) -> Iterator[Finding]:
    consumers, needed = Names(seen.namespace).consumers, seen.som.needed()
    unheard = [s.heard for s in needed if not consumers(seen.subscribers.get(s.heard, ()))]
    if unheard:
        what = f"needed, and nobody subscribes to {listed(sorted({*unheard}))}"
        yield Finding(what, "start their consumers, or say `needed: false`")


def _silent(seen: Seen) -> Iterator[Finding]:
    for service in seen.som:
        if service.node not in seen.publishers.get(service.topic, ()):
            there = listed(seen.publishers.get(service.topic, ())) or "nobody"
            what = f"{service.name}: {service.node} does not publish {service.topic}, but {there}"
            yield Finding(what, "start the node, or correct `node` and `topic` in the SOM")


def _types(seen: Seen) -> Iterator[Finding]:
    for text in seen.types:
        yield Finding(text, "build the package of the type, source it, and start healing anew")


def _healers(seen: Seen) -> Iterator[Finding]:
    tables = {t: nodes for t, nodes in seen.publishers.items() if t.endswith("/" + TABLE)}
    own = full_name(TABLE, seen.namespace)
    for topic, nodes in tables.items():
        if len(nodes) > 1:
            yield Finding(f"{listed(nodes)} heal at the same time", "end all but one")
        elif topic != own and len(tables) > 1:
            what = f"{listed(nodes)} heals beside us on the same master"
            yield Finding(what, "make sure that no topic is in two SOMs")


CHECKS: Tuple[Callable[[Seen], Iterator[Finding]], ...] = (
    *(_secret, _masters, _users, _clocks, _healers, _types),
    *(_silent, _unheard, _log, _ranges),
)
