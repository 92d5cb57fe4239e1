"""Whether another node takes the place of this one when it is told to end."""
import psutil
import rospy

from shsa_core.ros.processes import kernel

ASKED_BY_API = "external shutdown request"
"""What rospy's reason begins with then."""


class Ending:
    """Hears why this node ends; to be made before the node is initialised.

    Anybody may ask for it by our API, or by taking our name, and as soon as we have registered.
    """

    def __init__(self) -> None:
        self._asked = False
        rospy.core.add_preshutdown_hook(self._told)

    @property
    def followed(self) -> bool:
        """Whether our launch starts another one: then what publishes goes on."""
        return self._asked and kernel.started_by_launch(psutil.Process())

    def _told(self, reason: str) -> None:
        self._asked = reason.startswith(ASKED_BY_API)
