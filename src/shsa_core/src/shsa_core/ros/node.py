"""Runs a node so that it ends when it is told to, and logs nothing but printable text."""
import gc
import resource
import sys
import threading
from typing import Any, Callable, Dict, Mapping, Sequence, Tuple, Type, TypeVar

import genpy
import rospy

from shsa_core.errors import ModelError, ShsaError
from shsa_core.files.parameters import read_settings
from shsa_core.model.log import Level
from shsa_core.ros import settings
from shsa_core.ros.processes.priority import SWITCH_INTERVAL_S
from shsa_core.ros.rospy_patches.inbound import serve_each_by_itself
from shsa_core.ros.rospy_patches.log_queue import LogQueue, ask_once_for_rosout, say_failures_once
from shsa_core.ros.rospy_patches.standing import heed_launch, keep_rospys_threads
from shsa_core.ros.rospy_patches.subscribing import ask_in_time
from shsa_core.ros.trust.owners import speaker

Settings = TypeVar("Settings")
Handle = Callable[[Any], Sequence[Any]]
"""Handles an event of a core; returns its commands."""
LOG: Dict[Level, Callable[..., None]] = {
    Level.INFO: rospy.loginfo,
    Level.WARN: rospy.logwarn,
    Level.ERROR: rospy.logerr,
}


def run(name: str, work: Callable[[], None]) -> None:
    """Initialise the node `name` and run `work`, in a thread of its own.

    Exit status 1 if that fails.

    rospy shuts down inside the signal handler, in the main thread. If that thread published or
    called the master itself, it could wait there for a lock that it holds, for good.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a core would hold the secret
    say_failures_once()
    keep_rospys_threads()
    serve_each_by_itself(speaker)
    ask_in_time()
    heed_launch()
    rospy.init_node(name)
    log = LogQueue()
    ask_once_for_rosout()
    gc.freeze()  # what is loaded stays: to go through it for garbage stops all threads for 40 ms
    done = threading.Event()

    def watched() -> None:
        try:
            work()
            done.set()
        except ShsaError as error:
            for each in error.errors if isinstance(error, ModelError) else (error,):
                rospy.logfatal("%s", each)
        except ConnectionError as error:
            rospy.logfatal("The master does not answer: %s. Start it, then this.", error)
        except rospy.ROSException:
            # At shutdown rospy closes the topics under the feet of whoever publishes.
            if not rospy.core.is_shutdown_requested():
                raise
            done.set()

    thread = threading.Thread(target=watched, name="work", daemon=True)
    thread.start()
    while thread.is_alive() and not rospy.is_shutdown():
        rospy.rostime.wallsleep(settings.TURN_S)
    rospy.signal_shutdown("the work is done")
    with rospy.core._shutdown_lock:
        pass  # whoever shuts down, in whichever thread, has unregistered the node by now
    thread.join(settings.ANSWER_S)
    log.close()
    if not done.is_set():
        sys.exit(1)


def read_parameters(kind: Type[Settings]) -> Settings:
    """Return the settings that the node's parameters ask for; what is wrong is named."""
    found, errors = read_settings(kind, rospy.get_param("~", {}), rospy.get_name())
    for error in errors:
        rospy.logerr("Refused: %s. The default is used.", error)
    return found


def recorded(
    path: str, machine: str, setup: Mapping[str, Any], handle: Handle
) -> Tuple[Handle, Callable[[], None]]:
    """Return what handles an event and records it in the file `path`, and what ends that file.

    Nothing is recorded where the path is empty.
    """
    if not path:
        return handle, lambda: None
    from shsa_core.journal.writer import JournalWriter  # not for those who keep none: it takes long

    journal = JournalWriter(path, machine, setup, rospy.logwarn)
    return journal.recorded(handle), journal.close


def publish(publisher: Any, message: genpy.Message) -> None:
    """Publish from a callback, unless ROS is shutting down and has closed the topic already."""
    try:
        publisher.publish(message)
    except rospy.ROSException:
        if not rospy.core.is_shutdown_requested():
            raise
