"""The SOM on the parameter server, at /shsa/som: put there once, heeded while it changes."""
import http.client
import threading
import xmlrpc.client
from typing import Callable, Optional

import rospy

from shsa_core.model.som import Som, merge_parameters

SOM_PARAMETER = "/shsa/som"
POLL = 0.4


def put_som(som: Som) -> None:
    """Put `som` onto the parameter server."""
    rospy.set_param(SOM_PARAMETER, som.parameters())


def get_som_parameter() -> Optional[object]:
    """What lies at /shsa/som now; None if nothing does, or the master does not answer."""
    try:
        return rospy.get_param(SOM_PARAMETER, None)
    except (OSError, http.client.HTTPException, xmlrpc.client.Error, rospy.ROSException) as error:
        rospy.logwarn_throttle(10.0, f"The master does not answer: {error}")
        return None


class SomWatch:
    """Calls `changed(som)` from a thread of its own within a second of a change at /shsa/som.

    What is not valid is named once and refused: the old entry stays.
    """

    def __init__(self, som: Som, changed: Callable[[Som], None]) -> None:
        self._som = som
        self._seen = ""
        self._changed = changed
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while not rospy.is_shutdown():
            value = get_som_parameter()
            seen = repr(value)  # as text: NaN equals itself
            if value is not None and seen != self._seen:
                self._seen = seen
                self._take(value)
            rospy.rostime.wallsleep(POLL)

    def _take(self, value: object) -> None:
        som, errors = merge_parameters(self._som, value)
        for error in errors:
            rospy.logerr("Refused: %s", error)
        if som.services != self._som.services:
            self._som = som
            self._changed(som)
