"""The robot's computers in a SOM: read strictly, written again, and where services name them."""
import pathlib
from typing import Any, Dict

import pytest
from som_trees import GOOD, SERVICE, changed, som_of, write

from shsa_core.errors import ModelError
from shsa_core.files.som_file import (
    FROM_FILE_ALONE,
    load_som,
    merge_parameters,
    read_som,
    som_parameters,
)
from shsa_core.model.cost import Host
from shsa_core.model.service import Placement
from shsa_core.model.kinds import OnPartition

HOSTS: Dict[str, Any] = {"raspberry_pi": {"cores": 4, "link": 1e7}, "mainboard": {}}
HOSTED = """\
hosts:
  raspberry_pi: {cores: 4, link: 1.0e+7}  # the small one
  mainboard: {}
  notebook: {cores: 8}
""" + GOOD.replace(
    "    node: /amperemeter\n",
    "    node: /amperemeter\n    host: raspberry_pi\n    on_partition: wait\n"
    "    placement: {prefer: [mainboard, raspberry_pi], forbid: [notebook]}\n",
)


def hosted(key: str, value: Any, **hosts: Any) -> Dict[str, Any]:
    return {**changed(key, value), "hosts": {**HOSTS, **hosts}}


def test_hosts_and_what_services_say_of_them(tmp_path: pathlib.Path) -> None:
    som = read_som(write(tmp_path, HOSTED))
    assert list(som.hosts.values()) == [
        Host("raspberry_pi", 4.0, 1e7),
        Host("mainboard"),
        Host("notebook", 8.0),
    ]
    current, odometry, _ = som
    assert (current.host, current.on_partition) == ("raspberry_pi", OnPartition.WAIT)
    assert current.placement == Placement(("mainboard", "raspberry_pi"), ("notebook",))
    usual = (odometry.host, odometry.placement, odometry.on_partition)
    assert usual == ("", Placement(), OnPartition.HEAL)


def test_they_are_written_again(tmp_path: pathlib.Path) -> None:
    path = write(tmp_path, HOSTED)
    som = read_som(path)
    assert som_of(som_parameters(som)) == som
    without = read_som(write(tmp_path, GOOD))
    assert "hosts" not in som_parameters(without)
    assert not {"host", "placement", "on_partition"} & set(str(som_parameters(without)).split("'"))


@pytest.mark.parametrize(
    "tree, where, what",
    [
        (hosted("host", "pi"), "services/v/host", "none of the hosts: mainboard, raspberry_pi"),
        (hosted("host", ""), "services/v/host", "host names '', which is none of the hosts"),
        (hosted("host", []), "services/v/host", "host must be a text, not a list"),
        (changed("host", "pi"), "services/v/host", "none of the hosts: there are none"),
        (hosted("placement", "mainboard"), "services/v/placement", "must be a mapping"),
        (hosted("placement", {"like": []}), "services/v/placement/like", "has no key 'like'"),
        (hosted("placement", {"prefer": "x"}), "placement/prefer", "prefer must be a list"),
        (
            hosted("placement", {"prefer": ["x"]}),
            "services/v/placement",
            "names 'x', which is none",
        ),
        (hosted("placement", {"forbid": [3]}), "services/v/placement", "names '3', which is none"),
        (
            hosted("placement", {"prefer": ["mainboard"], "forbid": ["mainboard"]}),
            "services/v/placement",
            "mainboard is both preferred and forbidden",
        ),
        (
            hosted("placement", {"forbid": ["mainboard", "raspberry_pi"]}),
            "services/v/placement",
            "it forbids every host",
        ),
        (hosted("on_partition", "stop"), "services/v/on_partition", "must be one of heal, wait"),
        (hosted("period", 1, pi={"cores": 0}), "hosts/pi/cores", "cores must be above 0, not 0"),
        (hosted("period", 1, pi={"link": "fast"}), "hosts/pi/link", "link must be above 0"),
        (hosted("period", 1, pi={"core": 1}), "hosts/pi/core", "did you mean cores?"),
        (hosted("period", 1, pi=None), "hosts/pi", "the host pi must be a mapping"),
        (
            hosted("period", 1, **{"a-b": {}}),
            "hosts/a-b",
            "must be written like raspberry_pi, not 'a-b'",
        ),
        (hosted("period", 1, v={}), "hosts/v", "v is a service as well"),
        ({**changed("period", 1), "hosts": []}, "hosts", "hosts must be a mapping"),
    ],
)
def test_what_is_wrong_is_named(tree: Any, where: str, what: str) -> None:
    with pytest.raises(ModelError) as caught:
        som_of(tree)
    assert caught.value.where.startswith("shsa/som/") and caught.value.where.endswith(where)
    assert what in caught.value.what


def test_what_is_wrong_in_a_file_names_the_line_and_costs_no_other(tmp_path: pathlib.Path) -> None:
    wrong = HOSTED.replace("host: raspberry_pi", "host: pi").replace("cores: 4", "cores: four")
    path = write(tmp_path, wrong)
    som, errors = load_som(path)
    assert list(som.services) == ["odometry", "imu"] and list(som.hosts) == [
        "mainboard",
        "notebook",
    ]
    assert [error.where for error in errors] == [f"{path}:2", f"{path}:10"]


def test_hosts_come_from_the_file_alone() -> None:
    som = som_of(hosted("host", "mainboard"))
    tree: Any = som_parameters(som)
    assert merge_parameters(som, tree) == (som, [])
    assert {"host", "placement", "on_partition"} < set(FROM_FILE_ALONE)
    tree["hosts"]["mainboard"] = {"cores": 64.0}
    tree["services"]["v"]["period"] = 0.5
    merged, errors = merge_parameters(som, tree)
    assert [str(error) for error in errors] == [
        "shsa/som/hosts: hosts can be changed in the SOM file alone"
    ]
    assert merged.hosts == som.hosts and merged.services["v"].period == 0.5
    assert merge_parameters(som, {"services": tree["services"]}) == (merged, [])


def test_the_services_of_a_host_fail_together() -> None:
    som = som_of(
        {**hosted("host", "mainboard"), "services": {"v": {**SERVICE, "host": "mainboard"}}}
    )
    (service,) = som
    assert service.causes == ("/n", "mainboard")
    assert service.sources[0].names == ("v", "/t", "/n", "mainboard")
    assert service.wrong_with == ("/n",)
    assert service.avoided == (("mainboard",),)
    assert som.known_name("raspberry_pi", "/") == "raspberry_pi"
    assert som.known_name("other", "/") == "/other"


def test_a_host_in_fails_with_is_that_host() -> None:
    tree = hosted("fails_with", ["usb_hub", "raspberry_pi"])
    tree["services"]["v"]["host"] = "mainboard"
    (service,) = som_of(tree)
    assert service.causes == ("/n", "usb_hub", "raspberry_pi", "mainboard")
    assert service.avoided == (
        ("usb_hub", "raspberry_pi", "mainboard"),
        ("usb_hub", "raspberry_pi"),
    )
    tree["services"]["v"]["host"] = "raspberry_pi"
    (service,) = som_of(tree)
    assert service.causes == ("/n", "usb_hub", "raspberry_pi")
    assert service.avoided == (("usb_hub", "raspberry_pi"),)
