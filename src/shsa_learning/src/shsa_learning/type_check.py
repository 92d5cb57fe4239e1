"""Checks a SOM by its message types: that they have the fields, and that these can be healed."""
import importlib
from types import MappingProxyType
from typing import Any, Iterator, List, Mapping

from shsa_core import message_types
from shsa_core.errors import ShsaError
from shsa_core.files.document import Entry
from shsa_core.model.field import reduces
from shsa_core.model.field_type import WHOLE, field_type
from shsa_core.model.service import Service, Source
from shsa_core.model.som import Som
from shsa_core.text import nearest
from shsa_learning.finding import Finding

_PICTURES = "images, point clouds and maps are not computed from numbers"
_FRAMES = "a tf frame has one parent: a second publisher would contradict the first"
_ACTIONS = "an action is a dialogue with its server, not a value"
NOT_HEALABLE = {
    "sensor_msgs/Image": _PICTURES,
    "sensor_msgs/CompressedImage": _PICTURES,
    "sensor_msgs/PointCloud": _PICTURES,
    "sensor_msgs/PointCloud2": _PICTURES,
    "stereo_msgs/DisparityImage": _PICTURES,
    "nav_msgs/OccupancyGrid": _PICTURES,
    "tf2_msgs/TFMessage": _FRAMES,
    "tf/tfMessage": _FRAMES,
    "actionlib_msgs/GoalID": _ACTIONS,
    "actionlib_msgs/GoalStatusArray": _ACTIONS,
}
"""Message types that no substitute can publish in earnest, and why."""
_ACTION_ENDINGS = ("ActionGoal", "ActionResult", "ActionFeedback")


def available() -> bool:
    """Return whether message types can be looked up here."""
    try:
        importlib.import_module("genpy.message")
    except ImportError:
        return False
    return True


def types_beside(name: str) -> List[str]:
    """Return the messages in the package of the type `name`; none if the package is not here."""
    package = name.split("/")[0]
    if not package.isidentifier() or not message_types.is_built(package, "msg", "__init__"):
        return []
    try:
        module = importlib.import_module(f"{package}.msg")
    except ImportError:
        return []
    return [each for each, value in vars(module).items() if hasattr(value, "_md5sum")]


def is_service(name: str) -> bool:
    """Return whether `name` is not a message type but a ROS service's."""
    found = message_types.NAME.fullmatch(name)
    return found is not None and message_types.is_built(found[1], "srv", f"_{found[2]}")


def check_healable(som: Som) -> Iterator[Finding]:
    """Report the needed services whose type or fields tell that they cannot be healed."""
    for service in (each for each in som.needed() if each.policy.plans):
        action = _ACTIONS if service.type.endswith(_ACTION_ENDINGS) else ""
        why = NOT_HEALABLE.get(service.type, action)
        if why:
            what = (
                f"{service.name} is needed, but no substitute can publish a {service.type}: {why}"
            )
            todo = "Leave 'needed' out, or give it a policy of restart"
            yield Finding("warning", service.where, what, todo)
        for provision in service.provides:
            if reduces(provision.field):
                what = f"{service.name} is needed, but {provision.field} is read-only: "
                todo = "Give a field that can be written, or leave 'needed' out"
                why = "nothing can publish it again"
                yield Finding("error", provision.where, what + why, todo)


def check_types(
    som: Som, types: Any, written: Mapping[str, Entry] = MappingProxyType({})
) -> Iterator[Finding]:
    """Report what is wrong with the types and fields of a SOM.

    `types`: shsa_core.message_types; `written`: the keys of its services, with their lines.
    """
    for service in som:
        try:
            types.layout(service.type)
        except ShsaError:
            said = written.get(service.name, {}).get("type")
            yield _unknown(service, service.where if said is None else said.where)
            continue
        for source in service.sources:
            yield from _check_field(service, source, types)


def _unknown(service: Service, where: str) -> Finding:
    """Report a type that is not here, said at `where`: a wrong name, or a package not built."""
    package, name = service.type.split("/")
    if is_service(service.type):
        what = f"{service.type} is the type of a ROS service: only topics are watched and healed"
        return Finding("error", where, f"{service.name}: {what}", "Remove it")
    beside = types_beside(service.type)
    if beside:
        near = nearest(name, beside) or f"; it has {', '.join(beside)}"
        what = f"{package} has no message type {name}{near}"
        return Finding("error", where, f"{service.name}: {what}", "Correct the type")
    what = f"the package {package} of {service.type} is not built here"
    if service.needed:
        what += f", and {service.name} is needed: it cannot be healed"
        return Finding("error", where, what, "Build the package and source it")
    what += f": the values of {service.name} are neither checked nor used on this computer"
    return Finding("warning", where, what, "Build the package and source it")


def _check_field(service: Service, source: Source, types: Any) -> Iterator[Finding]:
    provision = source.provision
    try:
        found = field_type(service.type, provision.field, types.layout)
    except ShsaError as error:
        yield Finding("error", provision.where, str(error), "Correct the field")
        return
    limits = provision.range
    slack = 0.0 if found.kind in WHOLE else 0.05 * found.high  # nobody writes pi exactly
    if limits is None:
        return
    if limits[0] < found.low - slack or limits[1] > found.high + slack:
        what = f"the range [{limits[0]:g}, {limits[1]:g}] of {source.property} goes beyond what "
        what += f"{provision.field} can hold: {found.kind}, {found.low:g} to {found.high:g}"
        yield Finding("warning", provision.where, what, "Narrow the range")
