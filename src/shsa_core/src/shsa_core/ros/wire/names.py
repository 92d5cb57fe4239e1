"""The ROS names of healing, relative to the namespace in which it runs."""
from typing import Tuple

FAILURES = "shsa/failures"
HEALTH = "shsa/health"
CALIBRATIONS = "shsa/calibrations"
INCIDENTS = "shsa/incidents"
SUBSTITUTIONS = "shsa/substitutions"
SOM_STATE = "shsa/som_state"
FIND_SUBSTITUTE = "shsa/find_substitute"
RELEASE = "shsa/release"
RELOAD = "shsa/reload"
MAINTENANCE = "shsa/maintenance"
SUBSTITUTE_ACTION = "shsa/substitute"
HOSTS = "shsa/hosts"


def host_commands(host: str) -> str:
    """Return the topic on which the agent of a computer is told what to do."""
    return f"{HOSTS}/{host}/commands"


def host_events(host: str) -> str:
    """Return the topic on which the agent of a computer tells what has happened."""
    return f"{HOSTS}/{host}/events"


def monitor_of(host: str) -> str:
    """Return the name of the monitor of a computer; no host: that of all others."""
    return f"monitor_{host}" if host else "monitor"


def told_by_monitor(host: str) -> Tuple[str, str]:
    """Return where the monitor of a computer publishes health and calibrations, as above."""
    end = f"/{host}" if host else ""
    return f"{HEALTH}{end}", f"{CALIBRATIONS}{end}"
