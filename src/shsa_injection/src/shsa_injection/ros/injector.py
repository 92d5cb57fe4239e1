"""Makes faults on a running system, of the topics that a SOM names and of no others."""
from contextlib import suppress
from typing import List, Optional

from shsa_core.errors import ModelError, ShsaError, listed
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_injection import channel
from shsa_injection.errors import Refused
from shsa_injection.ros import targets
from shsa_injection.ros.injections import (
    INJECTIONS,
    HealerInjection,
    Injection,
    MasterInjection,
    checked,
    connection_to,
    request_for,
)
from shsa_injection.ros.targets import Target
from shsa_injection.vocabulary import FAULTS, TOPIC_FAULTS, Place


class Injector:
    """Makes faults of the topics that a SOM names, and of no others.

        with Injector(som).inject("/odom", "stuck", seconds=5.0, seed=3) as injection:
            injection.wait()

    It needs no ROS node of its own, and asks the master alone. Everything that it makes ends with
    it, also if it is killed.
    """

    def __init__(self, som: Som) -> None:
        self._som = som

    def service(self, topic: str, node: str = "") -> Service:
        """Return the service of a topic (and node, where several share it). Raises ModelError."""
        found = [s for s in self._som.of_topic(topic) if node in ("", s.node)]
        if not found:
            known = listed(self._som.topics())
            raise ModelError(topic, f"no service in the SOM has this topic; known are {known}")
        if len(found) > 1:
            names = ", ".join(service.node for service in found)
            raise ModelError(topic, f"several nodes publish it: name one of {names}")
        return found[0]

    def inject(
        self,
        topic: str,
        fault: str,
        seconds: Optional[float] = None,
        seed: int = 0,
        node: str = "",
    ) -> Injection:
        """Inject a fault while the context is entered, for `seconds` at most.

        `off` and `crash`: the node is started again after `seconds`; without, it stays dead.
        Raises ModelError if the SOM does not name the topic, ShsaError if there is no such fault,
        Refused where it cannot be made, at once or when it is entered.
        """
        service = self.service(topic, node)
        word = FAULTS.get(fault)
        if word is None or word.place is Place.MASTER:
            known = ", ".join(TOPIC_FAULTS)
            raise ShsaError(f"{fault}: no such fault of a topic; known are {known}")
        return INJECTIONS[word.place](service, fault, seconds, seed)

    @staticmethod
    def restart_master(seconds: float) -> Injection:
        """Kill the master; start it again after `seconds`."""
        return MasterInjection("master_restart", "", seconds, 0)

    @classmethod
    def possible(cls, service: Service) -> List[str]:
        """Return the faults that can be made of a service now. Raises Refused if there are none."""
        target = targets.find(service)
        outside = (Place.PROCESS, Place.GRAPH)
        words = [word for word, each in FAULTS.items() if each.place in outside]
        for word, each in FAULTS.items():
            if each.place in (Place.MESSAGES, Place.LINE):
                with suppress(Refused):
                    cls._ask(service, target, word)
                    words.append(word)
        return [word for word in FAULTS if word in words]

    @staticmethod
    def _ask(service: Service, target: Target, word: str) -> None:
        """Ask whether a fault could be made. Raises Refused if not."""
        with connection_to(target) as connection:
            request = request_for(service, word, None, 0)
            channel.send(connection, {**request, "only_asks": True})
            checked(channel.receive(connection))

    @staticmethod
    def harm_healer(name: str, fault: str, seconds: float) -> Injection:
        """`crash` or `hang` of the `monitor` or the `reconfigurator`."""
        return HealerInjection(name, fault, seconds)
