"""The launch files load, for the simulated and the real rover, with and without healing."""
import subprocess
from pathlib import Path
from subprocess import DEVNULL, PIPE
from typing import Dict, List, Sequence, Set

import pytest
import roslaunch

from shsa_rover.conductor import command
from shsa_testing.launches import loaded
from shsa_testing.thorough import LONG

LAUNCH = Path(__file__).resolve().parents[2] / "launch"
DRIVERS = {"amperemeter", "imu", "drivetrain", "voltmeter"}
SIMULATED = DRIVERS | {"motors", "rover_simulator", "soc_estimator", "driver"}
PORTS = {
    "/amperemeter/port": "port",
    "/voltmeter/port": "voltage_port",
    "/drivetrain/port": "base_port",
    "/motors/port": "base_port",
    "/imu/port": "imu_port",
}


def load(*arguments: str, launch: str = "rover.launch") -> roslaunch.ROSLaunchConfig:
    """Return the configuration that `roslaunch shsa_rover LAUNCH ARGUMENTS` would start."""
    return loaded(LAUNCH / launch, *arguments)


def names(config: roslaunch.ROSLaunchConfig) -> Set[str]:
    """Return the names of its nodes."""
    return {node.name for node in config.nodes}


def parameters(config: roslaunch.ROSLaunchConfig) -> Dict[str, object]:
    """Its parameters."""
    return {name: parameter.value for name, parameter in config.params.items()}


def test_the_simulated_rover_has_ports_of_its_own() -> None:
    config = load("healing:=false")
    assert names(config) == SIMULATED
    values = parameters(config)
    for port, simulated in PORTS.items():
        assert values[port] == values[f"/rover_simulator/{simulated}"]
    used = [values[port] for port in PORTS]
    assert len(set(used)) == len(used) - 1 and all(str(port).startswith("/tmp/") for port in used)
    assert parameters(load("healing:=false"))["/amperemeter/port"] != values["/amperemeter/port"]


def test_the_simulated_world_is_chosen_by_arguments() -> None:
    fitted = parameters(load("healing:=false"))
    assert fitted["/rover_simulator/world"] == "as_fitted"
    switches = ("payload", "floor", "slope", "state_of_charge")
    assert not any(f"/rover_simulator/{name}" in fitted for name in switches)
    chosen = parameters(load("world:=drawn", "payload:=5", "floor:=carpet", "slope:=2.5"))
    assert chosen["/rover_simulator/world"] == "drawn"
    values = [chosen[f"/rover_simulator/{name}"] for name in switches[:3]]
    assert values == [5, "carpet", 2.5]


def test_one_argument_makes_it_the_system_of_the_paper() -> None:
    ours, paper = load(), load("paper:=true")
    assert names(paper) == names(ours)
    assert "/soc_estimator/state_of_charge" not in parameters(ours)
    values = parameters(paper)
    assert values["/soc_estimator/state_of_charge"] == 0.8
    assert (values["/rover_simulator/world"], values["/reconfigurator/method"]) == ("paper", "orr")
    (healer,) = [node for node in paper.nodes if node.name == "reconfigurator"]
    assert "--rosrun" in healer.args and "/paper_som.yaml'" in healer.args
    (healer,) = [node for node in ours.nodes if node.name == "reconfigurator"]
    assert "--rosrun" not in healer.args and "/rover_som.yaml'" in healer.args


@pytest.mark.parametrize(
    "given, expected",
    [
        ((), True),
        (("paper:=true",), False),
        (("sim:=false",), False),
        (("checksum:=false",), False),
    ],
)
def test_frames_have_a_checksum_unless_they_are_those_of_the_paper(
    given: Sequence[str], expected: bool
) -> None:
    values = parameters(load(*given, "healing:=false"))
    found = {value for name, value in values.items() if name.endswith("/checksum")}
    assert found == {expected}


def test_gates_stand_before_the_needed_services() -> None:
    gates = {f"{name}_gate" for name in ("battery_current", "battery_voltage", "odom")}
    gated = load("gates:=true")
    assert names(gated) == names(load()) | gates | {"accel_gate", "imu_gate"}
    remapped = {node.name: node.remap_args for node in gated.nodes if node.remap_args}
    assert set(remapped) == DRIVERS
    assert all(to == f"{of}/raw" for pairs in remapped.values() for of, to in pairs)
    assert not any(node.remap_args for node in load().nodes)
    (healer,) = [node for node in gated.nodes if node.name == "reconfigurator"]
    assert "/rover_gated_som.yaml'" in healer.args


def test_the_real_rover_has_the_same_nodes_without_the_simulator() -> None:
    config = load("sim:=false", "port:=/dev/ttyAMA0", "healing:=false")
    assert names(config) == SIMULATED - {"rover_simulator"}
    values = parameters(config)
    assert values["/amperemeter/port"] == "/dev/ttyAMA0"
    assert len({values[port] for port in PORTS}) == len(set(PORTS.values()))  # one reader each
    apart = load("sim:=false", "port:=/dev/ttyAMA0", "healing:=false", "raspberry_pi:=false")
    assert parameters(apart)["/voltmeter/port"] == "/dev/ttyAMA0"
    assert all(str(values[port]).startswith("/dev/") for port in PORTS)
    given = [f"{name}:=/dev/{name}" for name in set(PORTS.values())]
    values = parameters(load("sim:=false", *given, "healing:=false"))
    assert {port: values[port] for port in PORTS} == {p: f"/dev/{n}" for p, n in PORTS.items()}


def test_healing_is_there_unless_it_is_switched_off() -> None:
    assert names(load()) == SIMULATED | {"monitor", "reconfigurator"}


@pytest.mark.parametrize("name", ["dry_run", "operator", "restart_as_root", "unsigned_failures"])
def test_what_is_neither_true_nor_false_is_refused(name: str) -> None:
    with pytest.raises(roslaunch.core.RLException, match="no"):
        load(f"{name}:=no")


@pytest.mark.parametrize("more", [(), ("healing:=false",)])
def test_an_argument_that_no_file_takes_is_refused(more: Sequence[str]) -> None:
    command = ["roslaunch", "--nodes", "shsa_rover", "rover.launch", *more]
    if LONG or not more:
        taken = [*command, "method:=orr", "view_port:=1"]
        assert subprocess.run(taken, stdout=DEVNULL).returncode == 0
    refused = subprocess.run([*command, "methd:=orr"], stdout=DEVNULL, stderr=PIPE)
    assert b"did you mean method?" in refused.stderr and refused.returncode


def test_the_rover_takes_the_arguments_of_healing() -> None:
    given = ("hold_off:=7.0", "switches:=1", "dry_run:=true", "som:=/s")
    for launch in ("rover.launch", "rover_distributed.launch"):
        config = load(*given, launch=launch)
        assert parameters(config)["/reconfigurator/hold_off"] == 7.0
        assert parameters(config)["/reconfigurator/switches"] == 1
        (healer,) = [node for node in config.nodes if node.name == "reconfigurator"]
        assert "--dry-run" in healer.args and "--som '/s'" in healer.args


def test_the_view_is_there_if_it_is_asked_for() -> None:
    assert names(load("view:=true")) == SIMULATED | {"monitor", "reconfigurator", "view"}
    assert "view" in machines("view:=true", "healing_host:=mainboard")["mainboard"]


@pytest.mark.parametrize(
    "here, expected",
    [
        ("raspberry_pi", {"amperemeter", "imu"}),
        ("mainboard", {"drivetrain", "motors", "voltmeter", "soc_estimator"}),
        ("notebook", {"driver"}),
    ],
)
def test_each_computer_can_start_its_own_nodes(here: str, expected: Set[str]) -> None:
    others: List[str] = [
        f"{name}:=false" for name in ("raspberry_pi", "mainboard", "notebook") if name != here
    ]
    assert names(load("sim:=false", "port:=/x", "healing:=false", *others)) == expected


def test_keys_drive_instead_of_the_script() -> None:
    assert "teleop" in names(load("drive:=false", "healing:=false"))
    assert "driver" not in names(load("drive:=false", "healing:=false"))


def test_messages_can_fail_where_that_is_asked_for() -> None:
    prefixes = {node.name: node.launch_prefix for node in load("injectable:=true").nodes}
    failing = {name for name, prefix in prefixes.items() if prefix}
    assert failing == DRIVERS | {"driver"}
    assert prefixes["imu"] == "rosrun shsa_injection injectable"
    assert not any(node.launch_prefix for node in load().nodes)


def machines(*arguments: str) -> Dict[str, Set[str]]:
    """Return the nodes of rover_distributed.launch by the machine that each runs on."""
    found: Dict[str, Set[str]] = {}
    for node in load(*arguments, launch="rover_distributed.launch").nodes:
        found.setdefault(str(node.machine_name), set()).add(node.name)
    return found


GROUPS = {
    "raspberry_pi": {"amperemeter", "imu"},
    "mainboard": {"drivetrain", "motors", "voltmeter", "soc_estimator", "rover_simulator"},
    "notebook": {"driver"},
}


def test_groups_run_on_their_computers_and_agents_where_healing_does_not() -> None:
    healing = {"monitor", "reconfigurator"}
    beside = {name: nodes | {f"agent_{name}"} for name, nodes in GROUPS.items()}
    assert machines() == {**beside, "notebook": GROUPS["notebook"] | healing}
    moved = machines("healing_host:=mainboard")
    assert moved == {**beside, "mainboard": GROUPS["mainboard"] | healing}
    assert machines("healing:=false") == GROUPS


def test_a_place_of_healing_that_is_none_is_an_error() -> None:
    with pytest.raises(roslaunch.core.RLException, match="nowhere_address"):
        machines("healing_host:=nowhere")


def test_computers_are_reached_as_the_arguments_say() -> None:
    config = load(
        *("mainboard_address:=10.0.0.3", "mainboard_user:=rover", "env_loader:=/opt/environment"),
        launch="rover_distributed.launch",
    )
    machine = config.machines["mainboard"]
    assert (machine.address, machine.user) == ("10.0.0.3", "rover")
    assert config.machines["raspberry_pi"].address == "raspberry_pi"
    assert {each.env_loader for name, each in config.machines.items() if name} == {
        "/opt/environment"
    }


def test_the_distributed_rover_has_the_parameters_of_the_rover() -> None:
    ports = ("port:=/dev/ttyAMA0", "voltage_port:=/dev/ttyAMA0")
    arguments = (*ports, "sim:=false", "injectable:=true")
    distributed = load(*arguments, launch="rover_distributed.launch")
    assert parameters(distributed) == parameters(load(*arguments))
    nodes = [node for node in distributed.nodes if not node.name.startswith("agent")]
    prefixes = {node.name: node.launch_prefix for node in nodes}
    assert prefixes == {node.name: node.launch_prefix for node in load(*arguments).nodes}


def test_the_demonstration_runs_on_three_computers_as_well() -> None:
    arguments = ("results:=/x", "rover:=rover_distributed.launch", "restarted_on:=pi@raspberry_pi")
    nodes = {node.name: node for node in load(*arguments, launch="demo.launch").nodes}
    assert GROUPS["raspberry_pi"] < set(nodes)
    assert nodes["amperemeter"].machine_name == "raspberry_pi"
    # It ends roslaunch, which is here; the recording is wanted here as well.
    assert {nodes["conductor"].machine_name, nodes["recorder"].machine_name} <= {None, "notebook"}
    assert nodes["conductor"].args == "--on 'pi@raspberry_pi'"
    assert command("pi@raspberry_pi")[-5:] == (
        *("pi@raspberry_pi", "~/.ros/shsa_env"),
        *("rosrun", "shsa_rover", "amperemeter"),
    )
    assert command("") == ("rosrun", "shsa_rover", "amperemeter")
