"""Several monitors share a robot: each computer's watches its own services."""
from typing import List, Tuple

from shsa_core.healing.events import HealthSeen, WriteDown
from shsa_core.healing.health import Health
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.cost import Host
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.planning.settings import START_S
from shsa_core.table import Table

PI, BOARD = "pi", "board"


def service(name: str, host: str, topic: str = "") -> Service:
    provides = (Provision(name, "data"),)
    topic, node = topic or f"/{name}", f"/{name}_node"
    return Service(name, topic, "std_msgs/Float64", node, 0.1, provides, host=host)


SOM = Som(
    [
        service("current", PI),
        service("speed", BOARD),
        service("steering", ""),
        service("left", PI, "/joints"),
        service("right", BOARD, "/joints"),
    ],
    [Host(PI), Host(BOARD)],
)


def row(topic: str, time: float = 1.0) -> PublisherHealth:
    return PublisherHealth(topic, f"{topic}_node", PublisherState.HEALTHY, time, time, time)


def told(host: str, *topics: str, anew: bool = False, time: float = 1.0) -> HealthSeen:
    rows = tuple(row(topic, time) for topic in topics)
    return HealthSeen(time, rows, whole=True, began=1 + anew, host=host)


def healthy(health: Health, *topics: str) -> List[str]:
    return [topic for topic in topics if health.healthy((topic, f"{topic}_node"))]


def names(som: Som) -> Tuple[str, ...]:
    return tuple(each.name for each in som)


def test_each_service_is_watched_by_one_monitor() -> None:
    assert names(SOM.at([BOARD])) == ("speed",)
    assert names(SOM.at([BOARD], beside=True)) == ("current", "steering", "left", "right")
    assert names(SOM.at([PI, BOARD], beside=True)) == ("steering",)
    assert SOM.at([], beside=True) == SOM


def test_one_monitor_hears_all_publishers_of_a_topic() -> None:
    assert names(SOM.at([PI])) == ("current", "left", "right")


def test_the_hosts_stay() -> None:
    assert SOM.at([PI]).hosts == SOM.hosts


def test_the_whole_table_of_one_monitor_leaves_the_rows_of_the_others() -> None:
    health = Health(Table(WriteDown))
    health.heed(told("", "/steering"))
    health.heed(told(PI, "/current", "/left"))
    assert health.heed(told(PI, "/current"))[0] == [
        ("/current", "/current_node"),
        ("/left", "/left_node"),
    ]
    assert healthy(health, "/steering", "/current", "/left") == ["/steering", "/current"]
    health.heed(told(""))
    assert healthy(health, "/steering", "/current") == ["/current"]


def test_a_monitor_that_starts_anew_puts_nobody_in_doubt_whom_another_one_watches() -> None:
    health = Health(Table(WriteDown))
    health.heed(told("", "/steering"))
    health.heed(told(PI, "/current"))
    health.heed(told(PI, anew=True, time=2.0))
    assert healthy(health, "/steering", "/current") == ["/steering", "/current"]
    missed = health.missed(2.0 + START_S)
    assert missed is not None and missed.removed == (("/current", "/current_node"),)
    health.heed(missed)
    assert healthy(health, "/steering", "/current") == ["/steering"]


def test_what_a_former_reconfigurator_knew_is_taken_over_by_whoever_tells_of_it() -> None:
    health = Health(Table(WriteDown))
    for topic in ("/current", "/steering"):
        health.recall(row(topic))
    health.heed(told(PI, "/current"))
    health.heed(told("", "/steering"))
    assert health.missed(2.0 * START_S).removed == ()  # type: ignore[union-attr]
    assert healthy(health, "/steering", "/current") == ["/steering", "/current"]
