"""Actions with the token: release, substitute now, and inject a fault. Each is logged."""
import importlib.util
import re
import subprocess
import threading
from typing import Any, Callable, Dict, Mapping, Optional

import actionlib
import rospy
from shsa_msgs import msg, srv

from shsa_core.errors import ShsaError
from shsa_core.model.som import Som
from shsa_core.ros.wire import names
from shsa_core.text import shown
from shsa_view.errors import Refused

TIMEOUT_S = 5.0
INJECTION_S = 5.0
LONGEST_INJECTION_S = 60.0
FAULT = re.compile("[a-z_]+")

Document = Dict[str, Any]


class Actions:
    """Does what is asked, by services of healing and by `shsa inject`. `som`: the SOM's file."""

    def __init__(self, som: str) -> None:
        self._som = som
        self._release = rospy.ServiceProxy(names.RELEASE, srv.Release)
        self._client: Optional[actionlib.SimpleActionClient] = None
        self._lock = threading.Lock()  # of the client, which has one goal at a time
        self._do: Mapping[str, Callable[[str, Mapping[str, Any]], Document]] = {
            "release": self._released,
            "substitute": self._substituted,
            "inject": self._injected,
        }

    def act(self, action: str, body: Mapping[str, Any], who: str, som: Som) -> Document:
        """Do it; `who` is the address that asks. Raises ShsaError."""
        topic = body.get("topic")
        if not isinstance(topic, str) or topic not in som.topics():
            known = ", ".join(som.topics())
            raise Refused(f"name a topic of the SOM; these are: {known}")
        rospy.logwarn("%s asked for %s of %s.", shown(who), action, topic)
        done = self._do[action](topic, body)
        rospy.logwarn("%s of %s for %s: %s.", action, topic, shown(who), done["detail"])
        return done

    def _released(self, topic: str, _: Mapping[str, Any]) -> Document:
        try:
            answer = self._release(topic)
        except (rospy.ServiceException, rospy.ROSException) as error:
            raise ShsaError(f"the reconfigurator does not answer: {error}") from error
        return {"success": bool(answer.success), "detail": shown(answer.detail)}

    def _substituted(self, topic: str, _: Mapping[str, Any]) -> Document:
        with self._lock:
            return self._substitute(topic)

    def _substitute(self, topic: str) -> Document:
        if self._client is None:  # made once, and for who may act alone
            kind = msg.SubstituteAction
            self._client = actionlib.SimpleActionClient(names.SUBSTITUTE_ACTION, kind)
        client = self._client
        if not client.wait_for_server(rospy.Duration(TIMEOUT_S)):
            raise ShsaError(f"the reconfigurator does not answer within {TIMEOUT_S:g} s")
        client.send_goal(msg.SubstituteGoal(topic=topic))
        if not client.wait_for_result(rospy.Duration(TIMEOUT_S)):
            return {"success": True, "detail": "asked for; it is not settled yet"}
        result = client.get_result()
        success = bool(result is not None and result.success)
        return {"success": success, "detail": shown(client.get_goal_status_text())}

    def _injected(self, topic: str, body: Mapping[str, Any]) -> Document:
        if importlib.util.find_spec("shsa_injection") is None:
            raise Refused("needs the package shsa_injection, which is not installed", 501)
        fault, seconds = body.get("fault", "hang"), body.get("seconds", INJECTION_S)
        if not isinstance(fault, str) or not FAULT.fullmatch(fault):
            raise Refused("fault must be a word of `shsa inject`, as hang or crash")
        if isinstance(seconds, bool) or not isinstance(seconds, (int, float)):
            raise Refused("seconds must be a number")
        if not 0.0 < seconds <= LONGEST_INJECTION_S:
            raise Refused(f"seconds must be above 0 and at most {LONGEST_INJECTION_S:g}")
        command = ["rosrun", "shsa_core", "shsa", "inject", topic, fault, "--for", f"{seconds:g}s"]
        injection = subprocess.Popen(
            [*command, "--som", self._som, "--namespace", rospy.get_namespace()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            universal_newlines=True,
        )
        try:
            _, why = injection.communicate(timeout=min(TIMEOUT_S, float(seconds)) / 2.0)
        except subprocess.TimeoutExpired:
            threading.Thread(target=injection.communicate, name="injection", daemon=True).start()
            return {"success": True, "detail": f"{fault} for {seconds:g} s, and then taken back"}
        if injection.returncode:
            reason = why.strip().split("\n")[-1]
            raise Refused(reason or "`shsa inject` has refused it", 409)
        return {"success": True, "detail": f"{fault} of {seconds:g} s is over"}
