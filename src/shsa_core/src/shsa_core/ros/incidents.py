"""The incidents as they are shown: every step on a topic, the whole story as one line of a log."""
import json
import os
import threading
from typing import Callable, Dict, Optional

import rospkg
import rospy
from shsa_msgs import msg

from shsa_core.files.regular import open_to_append
from shsa_core.healing.incident import Incident, State
from shsa_core.model.names import file_name
from shsa_core.ros.trust.signing import SignedPublisher, Signing
from shsa_core.ros.wire import healing as wire, names

SETTLED = (State.HEALED, State.UNHEALED, State.SAFE, State.KEPT, State.ENDED)


def log_path(log_file: str) -> str:
    """Return the path of the incident log; a relative one is in ROS's log folder.

    Empty: `shsa_incidents.jsonl` there, behind the namespace, as roslaunch names its logs:
    `robot1-shsa_incidents.jsonl`.
    """
    name = log_file or file_name("shsa_incidents.jsonl", rospy.get_namespace())
    return os.path.join(rospkg.get_log_dir(), name)


class Incidents(rospy.SubscribeListener):
    """Publishes incidents, logs those that have ended, and lets threads wait for one.

    A late subscriber is told of those that are open. `log_file`: see log_path.
    """

    def __init__(self, log_file: str, signing: Signing) -> None:
        super().__init__()
        self._log_file = log_path(log_file)
        self._fails = False
        self._open: Dict[str, Incident] = {}
        self._changed = threading.Condition()
        with self._changed:  # whoever connects meanwhile is told by it
            self._publisher = SignedPublisher(signing, names.INCIDENTS, msg.Incident, 100, self)

    def show(self, incident: Incident) -> None:
        """Publish a step of an incident; one that has ended is logged before."""
        if incident.state is State.ENDED:
            self._log(incident)
        with self._changed:  # whoever subscribes now hears the newest step last
            self._open[incident.service] = incident
            if incident.state is State.ENDED:
                del self._open[incident.service]
            self._changed.notify_all()
            self._publisher.publish(wire.incident(incident))

    def peer_subscribe(self, _: str, publish: object, tell: Callable[[msg.Incident], None]) -> None:
        """Called by rospy, in a thread of its own, once a subscriber has connected."""
        with self._changed:
            for incident in self._open.values():
                tell(self._publisher.signed(wire.incident(incident)))

    def open(self) -> Dict[str, Incident]:
        """Return the incidents that have not ended, by service."""
        with self._changed:
            return dict(self._open)

    def close(self) -> None:
        """Log the incidents that are open at the end."""
        for incident in self.open().values():
            self._log(incident)

    def await_settled(
        self, service: str, changed: Callable[[Incident], None], cancelled: Callable[[], bool]
    ) -> Optional[Incident]:
        """Return the incident of a service once it is healed or cannot be; None: cancelled before.

        `changed` is called at each step.
        """
        last: Optional[Incident] = None
        while not rospy.is_shutdown() and not cancelled():
            with self._changed:
                self._changed.wait(0.1)
                incident = self._open.get(service)
            if incident is not None and incident is not last:
                last = incident
                changed(incident)
            if last is not None and (incident is None or incident.state in SETTLED):
                return last
        return None

    def _log(self, incident: Incident) -> None:
        try:
            with open(open_to_append(self._log_file), "a", encoding="utf-8") as log:
                log.write(json.dumps(wire.incident_record(incident)) + "\n")
            self._fails = False
        except OSError as error:
            if not self._fails:
                rospy.logerr("The incident log %s cannot be written: %s", self._log_file, error)
            self._fails = True  # said once, until it is well again
