"""SOM trees to begin with, and changes of one value in them."""
import copy
import pathlib
from typing import Any, Dict

from shsa_core.files.document import from_parameters
from shsa_core.files.som_file import read_tree
from shsa_core.model.som import Som

GOOD = """\
services:
  current:
    topic: /battery_current
    type: shsa_msgs/Float64Stamped
    node: /amperemeter
    period: 0.02
    needed: true
    standby: warm
    provides:
      battery_current: {field: data, range: [-5.0, 60.0], quality: 0.9}
  odometry:
    topic: /odom
    type: nav_msgs/Odometry
    node: /drivetrain
    period: 1
    provides:
      linear_velocity: {field: twist.twist.linear.x}
      angular_velocity: {field: twist.twist.angular.z}
  imu: {topic: /imu/data, type: sensor_msgs/Imu, node: /imu, period: none,
        provides: {angular_velocity: {field: angular_velocity.z}}}
"""
SERVICE: Dict[str, Any] = {
    "topic": "/t",
    "type": "std_msgs/Float64",
    "node": "/n",
    "period": 0.1,
    "provides": {"v": {"field": "data"}},
}
OF_VALUE = ("field", "range", "quality", "error", "fault_tolerant_error")


def write(tmp_path: pathlib.Path, text: str) -> str:
    file = tmp_path / "s.yaml"
    file.write_text(text)
    return str(file)


def changed(key: str, value: Any, **services: Any) -> Dict[str, Any]:
    """A tree with one service `v` where one value is another; `services` stand beside it."""
    service = copy.deepcopy(SERVICE)
    if key in OF_VALUE:
        service["provides"]["v"][key] = value
    elif key == "value checks":
        service["provides"]["v"]["checks"] = value
    else:
        service[key] = value
    return {"services": {"v": service, **services}}


def place(key: str) -> str:
    """The parameter of a key of the service `v`."""
    inner = f"provides/v/{key.split()[-1]}" if key in (*OF_VALUE, "value checks") else key
    return f"shsa/som/services/v/{inner}"


def som_of(tree: Any) -> Som:
    """The SOM of a tree that is valid; raises the first error."""
    som, errors = read_tree(from_parameters(tree, "shsa/som"))
    for error in errors:
        raise error
    return som
