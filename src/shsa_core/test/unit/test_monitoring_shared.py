"""Several services on one topic: each is judged by its own."""
from dataclasses import replace
from typing import Any, List

from monitor_bench import (
    PERIOD,
    Bench,
    message_checks,
    provision,
    row,
    service,
    table,
    with_value_checks,
)

from shsa_core.healing.events import HealthSeen, WriteDown
from shsa_core.healing.health import Health
from shsa_core.model.checks import Jump, UnknownPublisher
from shsa_core.monitoring.events import SubstitutionsChanged
from shsa_core.table import Table


def two_drivers(**left: Any) -> Bench:
    """Two services on one topic: the arm at 50 Hz, the wheels at 10 Hz and with a narrow range."""
    narrow = provision(property="wheel", range=(0.0, 2.0))
    return Bench(
        service(name="arm", topic="/joint_states", node="/arm_driver", **left),
        service(narrow, name="wheels", topic="/joint_states", node="/wheel_driver", period=0.1),
    )


def both(bench: Bench, seconds: float, arm: float = 1.0, wheel: float = 1.0) -> None:
    """Both drivers publish, each at its period."""
    for step in range(round(seconds / PERIOD)):
        bench.stream(1, "/arm_driver", arm, "/joint_states")
        if step % 5 == 0:
            bench.message(wheel, "/wheel_driver", "/joint_states")


def told(bench: Bench) -> List[str]:
    return [f"{f.service} {f.publisher} {f.kind}" for f in bench.failures]


def test_two_services_on_one_topic_are_judged_by_their_own_values_and_rates() -> None:
    bench = two_drivers()
    both(bench, 5.0, arm=30.0)
    assert told(bench) == []
    both(bench, 1.0, arm=30.0, wheel=3.0)
    assert told(bench) == ["wheels /wheel_driver out_of_range"]


def test_two_services_on_one_topic_are_silent_by_their_own_deadlines() -> None:
    bench = two_drivers()
    both(bench, 1.0)
    bench.wait(0.2)
    assert told(bench) == ["arm /arm_driver silent"]
    bench.wait(0.4)
    assert told(bench) == ["arm /arm_driver silent", "wheels /wheel_driver silent"]


def test_whoever_never_had_its_rate_is_not_blamed_beside_a_substitute_of_another() -> None:
    bench = two_drivers()
    for service_, expected in (("arm", []), ("wheels", ["wheels /wheel_driver rate_low"])):
        name = f"/substitute_{service_}"
        bench.connect(name, "/joint_states")
        rows = (row(name, True, "/joint_states", service=service_),)
        bench.send(SubstitutionsChanged(bench.now, rows))
        for _ in range(60):
            bench.wait(0.3)
            bench.message(1.0, "/wheel_driver", "/joint_states")
            bench.message(1.0, name, "/joint_states")
        low = [text for text in told(bench) if "wheel_driver" in text]
        assert low == expected


def test_a_service_that_never_came_up_is_missed_beside_another_one_on_its_topic() -> None:
    bench = two_drivers()
    bench.stream(800, "/arm_driver", topic="/joint_states")
    assert told(bench) == ["wheels  never_published"]
    assert bench.state("", "/joint_states") == "failed"
    bench.stream(1, "/arm_driver", topic="/joint_states")
    assert bench.state("", "/joint_states") == "failed"
    bench.connect("/wheel_driver", "/joint_states")
    assert bench.state("", "/joint_states") is None


def test_each_service_that_nobody_ever_publishes_for_has_the_row_once() -> None:
    bench = two_drivers()
    bench.wait(16.0)
    assert sorted(told(bench)) == ["arm  never_published", "wheels  never_published"]
    failed = [row for change in bench.changes for row in change.rows if row.kind is not None]
    assert sorted(row.service for row in failed) == ["arm", "wheels"]
    heard, seen = Health(Table(WriteDown)), []
    for each in bench.changes:
        _, failures = heard.heed(HealthSeen(each.time, each.rows, each.removed))
        seen += [failure.service for failure in failures]
    assert sorted(seen) == ["arm", "wheels"]


def test_a_stranger_on_a_shared_topic_is_judged_by_nobodys_values() -> None:
    bench = two_drivers()
    bench.message(1e9, "/stranger", "/joint_states")
    bench.stream(100, "/stranger", 1e9, "/joint_states")
    assert told(bench) == [] and bench.state("/stranger", "/joint_states") == "healthy"
    bench.wait(1.0)
    bench.disconnect("/stranger", "/joint_states")
    assert told(bench) == [] and bench.state("", "/joint_states") == "unknown"


def test_a_stranger_on_a_shared_topic_that_intrudes_fails_and_may_be_named_later() -> None:
    once = message_checks(UnknownPublisher(0.5))
    bench = two_drivers(checks=once)
    bench.stream(60, "/arm_driver", topic="/joint_states")
    for _ in range(60):
        bench.stream(1, "/arm_driver", topic="/joint_states")
        bench.message(node="/stranger", topic="/joint_states")
    assert told(bench) == [" /stranger unknown_publisher"]
    bench.disconnect("/arm_driver", "/joint_states")
    bench.disconnect("/wheel_driver", "/joint_states")
    substitute = row("/stranger", True, "/joint_states", service="arm")
    bench.send(SubstitutionsChanged(bench.now, (substitute,)))
    bench.stream(6, "/stranger", topic="/joint_states")
    assert bench.state("/stranger", "/joint_states") == "healthy"


def test_a_stranger_whom_no_service_knows_recovers_by_the_usual_count() -> None:
    bench = two_drivers()
    bench.stream(60, "/arm_driver", topic="/joint_states")
    for _ in range(60):
        bench.stream(1, "/arm_driver", topic="/joint_states")
        bench.message(node="/idle", topic="/joint_states")
    assert told(bench)[0] == " /idle unknown_publisher"
    bench.send(SubstitutionsChanged(bench.now, (row("/idle", False, "/elsewhere", service=""),)))
    for _ in range(5):
        bench.message(node="/idle", topic="/joint_states")
    assert bench.state("/idle", "/joint_states") == "healthy"


def test_one_of_two_services_leaves_a_topic() -> None:
    bench = two_drivers()
    bench.wait(16.0)
    assert len(bench.failures) == 2
    bench.watch(service(name="arm", topic="/joint_states", node="/arm_driver"))
    assert [(each.publisher, each.state) for each in table(bench.core)] == [("", "unknown")]
    bench.connect("/stranger", "/joint_states")
    named = bench.core.service_of("/joint_states", "/stranger")
    assert named is not None and named.name == "arm"


def test_who_is_given_to_another_service_is_judged_anew_and_by_that_one() -> None:
    jumps = with_value_checks(Jump(5.0))
    arm = service(jumps, name="arm", topic="/joint_states", node="/driver")
    wheels = service(jumps, name="wheels", topic="/joint_states", node="/old_driver", period=0.1)
    bench = Bench(arm, wheels)
    bench.stream(60, "/driver", 1.0, "/joint_states")
    bench.stream(2, "/driver", 99.0, "/joint_states")
    wide = with_value_checks(Jump(5.0), range=(-5.0, 80.0))
    bench.watch(replace(arm, node="/arm_driver"), replace(wheels, node="/driver", provides=(wide,)))
    bench.stream(1, "/driver", 99.0, "/joint_states", 0.1)
    bench.stream(20, "/driver", 70.0, "/joint_states", 0.1)
    assert told(bench) == [] and bench.told == []
    bench.stream(3, "/driver", 99.0, "/joint_states", 0.1)
    assert told(bench) == ["wheels /driver out_of_range"]


def test_a_substitute_on_a_shared_topic_is_judged_as_the_service_that_it_replaces() -> None:
    bench = two_drivers()
    both(bench, 1.0)
    bench.connect("/substitute_1", "/joint_states")
    assert bench.core.service_of("/joint_states", "/substitute_1") is None
    taking_over = row("/substitute_1", True, "/joint_states", service="wheels")
    bench.send(SubstitutionsChanged(bench.now, (taking_over,)))
    for _ in range(5):
        bench.message(3.0, "/substitute_1", "/joint_states")
    assert told(bench) == ["wheels /substitute_1 out_of_range"]
