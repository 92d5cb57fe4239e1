"""Small ontologies and SOMs of all kinds, for random robots."""
from typing import Any, Sequence

from hypothesis import strategies as st

from core_robot import function
from shsa_core.healing.settings import Settings
from shsa_core.model.cost import Host
from shsa_core.model.service import LastResort, Placement, Provision, Service
from shsa_core.model.kinds import Contain, OnPartition, Policy, Standby
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.som import Som

FUNCTIONS = [
    function("ab", "a", "b + 1", 0.9),
    function("ac", "a", "2 * c", 0.5),
    function("ba", "b", "a - 1", 0.9),
    function("bd", "b", "lowpass(d, 0.1)", 0.6),
    function("cd", "c", "d", 0.8),
    function("dab", "d", "a + b", 0.7),
]
NAMES = "abcd"
NODES = ("/m", "/n", "/o")
TOPICS = (*("/" + name for name in NAMES), "/shared", "/unknown")
LAST_RESORTS = (
    LastResort(),
    LastResort(values=tuple((name, 0.0) for name in NAMES)),
    LastResort(command=("stop",)),
)
SETTINGS = (
    Settings(pool=1),
    Settings(pool=0, switches=1, restarts=0, method="orr"),
    Settings(switches=0, node_restarts=1, restart_timeout=1.0, hold_off=0.5),
)


@st.composite
def services(draw: Any, name: str, hosts: Sequence[str] = ()) -> Service:
    """A service of the property of its name, on one of some computers."""
    chosen = st.lists(st.sampled_from(hosts or ("",)), max_size=2, unique=True)
    places = (draw(chosen), draw(chosen)) if hosts else ((), ())
    return Service(
        name=name,
        topic=draw(st.sampled_from(("/" + name, "/" + name, "/shared"))),
        type="pkg/Type",
        node=draw(st.sampled_from(NODES)),
        period=draw(st.sampled_from((0.02, 0.1, None))),
        provides=(Provision(name, name, quality=draw(st.sampled_from((1.0, 0.5)))),),
        needed=draw(st.sampled_from((True, True, False, None))),
        standby=draw(st.sampled_from(list(Standby))),
        policy=draw(st.sampled_from([*Policy, *([Policy.SUBSTITUTE] * 8 if hosts else [])])),
        last_resort=draw(st.sampled_from(LAST_RESORTS)),
        contain=draw(st.sampled_from((None, None, *Contain))),
        host=draw(st.sampled_from(("", *hosts))),
        placement=Placement(tuple(places[0]), tuple(places[1])),
        on_partition=draw(st.sampled_from(list(OnPartition))) if hosts else OnPartition.HEAL,
    )


@st.composite
def soms(draw: Any, hosts: Sequence[str] = ()) -> Som:
    """A SOM whose pairs of topic and node differ, with some computers."""
    least = len(NAMES) if hosts else 1
    names = draw(st.lists(st.sampled_from(NAMES), min_size=least, unique=True))
    found = [draw(services(name, hosts)) for name in names]
    cores = st.sampled_from((None, 0.1, 4.0))
    return Som(
        {(each.topic, each.node): each for each in found}.values(),
        [Host(host, draw(cores)) for host in hosts],
    )


@st.composite
def ontologies(draw: Any, least: int = 2) -> Ontology:
    """Some of the functions."""
    functions = draw(st.lists(st.sampled_from(FUNCTIONS), min_size=least, unique_by=id))
    return Ontology({name: Property(name) for name in NAMES}, {}, functions)
