"""The SOM on the parameter server, at shsa/som: put there once, heeded while it changes."""
import dataclasses
import json
import threading
import time
from contextlib import suppress
from itertools import product
from typing import Any, Callable, Dict, List, Optional, Sequence, Set, Tuple

import rosgraph
import rospy

from shsa_core.errors import ModelError, ShsaError
from shsa_core.files.document import from_parameters
from shsa_core.files import som_file
from shsa_core.files.som_file import PARAMETER, service_parameters
from shsa_core.model.field import parse_field
from shsa_core.model.service import Deadlines, Service, Signal
from shsa_core.model.som import Som
from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, master_api
from shsa_core.ros.workers import guarded

LIVE_PARAMETERS = "numbers of the SOM on the parameter server count, too"
MOST_SAID = 20
"""Errors of one look: anybody can set thousands of parameters."""


def put_som(som: Som) -> bool:
    """Put `som` onto the parameter server; true once it is there. Raises one of FAILURES."""
    master_api().setParam(rospy.resolve_name(PARAMETER), som_file.som_parameters(som))
    return True


def get_som_parameter() -> Optional[object]:
    """Return what lies at shsa/som, {} if nothing does; None: the master does not answer."""
    return _ask(_get)


class SomWatch:
    """Calls `changed(som)` from a thread of its own after a change at shsa/som.

    `live`: numbers at shsa/som count, within a second; else those of the file alone do. What is not
    valid is named once and refused: the old entry stays. Who has `reread`, which reads the SOM file
    again, puts that entry back onto the server, and looks if the file is another one: only the file
    can add, drop or move a service.
    """

    def __init__(
        self,
        som: Som,
        changed: Callable[[Som], None],
        live: bool,
        reread: Optional[Callable[[], Som]] = None,
    ) -> None:
        self._som, self._changed, self._live, self._reread = som, changed, live, reread
        self._file = som  # as read last
        self._seen = ""
        self._said: Set[str] = set()
        self._name = rospy.resolve_name(PARAMETER)
        self._lock = threading.Lock()
        threading.Thread(target=self._watch, name="som", daemon=True).start()

    def replace(self, som: Som) -> None:
        """Go by another SOM from a file; what lies at shsa/som counts on top of it."""
        with self._lock:
            self._som = self._file = som
            self._seen = ""

    def put_back(self, service: Service) -> None:
        """Go on by the numbers that count of a service, on the server as well."""
        with self._lock:
            changed = {**self._som.services, service.name: service}
            self._som = self._som.with_services(changed.values())
            self._show(service)

    def _watch(self) -> None:
        while not rospy.is_shutdown():
            begin = time.monotonic()
            guarded(self._name, self._look)
            took = (time.monotonic() - begin) / settings.LOOKING_SHARE
            rest = max(settings.MASTER_LOOK_S, took)
            rospy.rostime.wallsleep(min(rest, settings.LOOK_S if self._live else settings.ANSWER_S))

    def _look(self) -> None:
        value = get_som_parameter()
        if value is not None:
            with self._lock:
                self._heed(value)

    def _heed(self, value: object) -> None:
        seen = json.dumps(value, default=str)  # as text: NaN equals itself
        if seen == self._seen:
            return
        self._seen = seen
        if not _names(value):
            self._put_back(value)
            return
        som, errors = self._merge(value, self._som)
        try:
            if (errors or _names(value) != set(som.services)) and self._file_is_new():
                som, errors = self._merge(value, self._file)
        except ModelError as refusal:
            errors.append(refusal)
        for service in () if self._reread is None else _otherwise(value, som):
            self._show(service)  # before it is said: who hears that may set anew
        texts = [str(each) for error in errors for each in error.errors]
        new = [text for text in texts if text not in self._said]
        for text in new[:MOST_SAID]:
            rospy.logerr("Refused: %s", text)
        if len(new) > MOST_SAID:
            rospy.logerr("Refused: %d more in %s.", len(new) - MOST_SAID, self._name)
        self._said = set(texts)
        if som != self._som:
            self._som = som
            self._changed(som)

    def _merge(self, value: Any, current: Som) -> Tuple[Som, List[ModelError]]:
        """Return the SOM that counts, and what is refused of a value at shsa/som."""
        if self._live:
            where = self._name, rospy.get_namespace()
            return som_file.merge_parameters(self._file, value, *where, current=current)
        if self._reread is None:
            return self._file, []
        what = "the SOM file alone counts, since live_parameters is false"
        places = (f"{self._name}/services/{each.name}" for each in _otherwise(value, self._file))
        return self._file, [ModelError(place, what) for place in places]

    def _file_is_new(self) -> bool:
        """Read the SOM file again. Raises ModelError."""
        before = self._file
        self._file = before if self._reread is None else self._reread()
        return self._file != before

    def _show(self, service: Service) -> None:
        """Have the server show a service as it counts."""
        name = f"{self._name}/services/{service.name}"
        _ask(lambda: master_api().setParam(name, service_parameters(service)))

    def _put_back(self, value: object) -> None:
        """No service is left at shsa/som: the last ones stay. A master that is new has nothing."""
        if value == {}:
            rospy.loginfo("%s is not there, as on a new master. It is put back.", self._name)
        else:
            _, errors = som_file.merge_parameters(self._som, value, self._name)
            why = str(errors[0]) if errors else f"{self._name}: there is no service in it"
            rospy.logerr("Refused: %s. The previous SOM stays, and is put back.", why)
        if not _ask(lambda: put_som(self._som)):
            self._seen = ""  # it is to be tried again


def _names(value: object) -> Set[str]:
    services = value.get("services") if isinstance(value, dict) else None
    return set(services) if isinstance(services, dict) else set()


def _otherwise(value: Any, som: Som) -> List[Service]:
    """Return the services that lie at shsa/som otherwise than they count, or not at all."""
    return [s for s in som if value["services"].get(s.name) != service_parameters(s)]


def _get() -> Any:
    try:
        return master_api().getParam(rospy.resolve_name(PARAMETER))
    except rosgraph.MasterError:
        return {}  # there is no such parameter


def _ask(question: Callable[[], Any]) -> Optional[Any]:
    try:
        return question()
    except (*FAILURES, rospy.ROSException) as error:
        rospy.logwarn_throttle(10.0, f"The master does not answer: {error}")
        return None


def look_up(paths: Sequence[str]) -> Tuple[Signal, ...]:
    """Return the signals at paths like `/odom/twist/twist/linear/x`, as a person may give them.

    By the SOM on the parameter server, else by the master. Raises ShsaError if neither has one of
    them, or the master does not answer. No type is loaded.
    """
    try:
        known, types = _som_signals(), dict(master_api().getTopicTypes())
    except FAILURES as error:
        raise ShsaError(f"the master does not answer: {error}") from error
    return tuple(known[path] if path in known else _unmapped(path, types) for path in paths)


def _som_signals() -> Dict[str, Signal]:
    """Return every value of the SOM by its path, whichever node sends it."""
    som = Som()
    with suppress(ShsaError):  # there is none; those who watch it name what is not valid
        som, _ = som_file.read_tree(from_parameters(_get(), PARAMETER), rospy.get_namespace())
    both = product(som.sources, (False, True))
    signals = (som.signal(source, Deadlines(), written) for source, written in both)
    return {signal.path: dataclasses.replace(signal, node="") for signal in signals}


def _unmapped(path: str, types: Dict[str, str]) -> Signal:
    topics = [topic for topic in types if path.startswith(topic + "/")]
    if not topics:
        raise ShsaError(f"{path}: neither in the SOM nor on a topic that the master knows")
    topic = max(topics, key=len)
    field = str(parse_field(path[len(topic) + 1 :], "/"))
    return Signal(topic, field, types[topic], "", settings.TURN_S, settings.CALL_S)
