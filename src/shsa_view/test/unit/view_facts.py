"""A small robot, and what the view hears of it."""
from pathlib import Path
from typing import Any, List

from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.healing.incident import Incident, State
from shsa_core.model.error import Error
from shsa_core.model.kinds import Kind
from shsa_view import facts
from shsa_view.state import State as View

DATA = Path(__file__).resolve().parents[1] / "data"
ONTOLOGY, SOM = read_ontology(str(DATA / "robot.yaml")), read_som(str(DATA / "robot_som.yaml"))
NODES = {"ammeter": "/current", "voltmeter": "/voltage", "wattmeter": "/power"}
SUBSTITUTE = "/substitute_current_1"


def health(name: str, state: str = "healthy", detail: str = "") -> facts.Publisher:
    """Return the row of a service's own node."""
    return facts.Publisher(NODES[name], f"/{name}", state, detail=detail)


def substitute(publishing: bool, node: str = SUBSTITUTE) -> facts.Substitute:
    """Return the substitute of the ammeter."""
    return facts.Substitute(
        node=node,
        service="ammeter",
        publishing=publishing,
        inputs=("/power/data", "/voltage/data"),
        outputs=("/current/data",),
        relations=("law",),
        quality=0.9,
        error_rms=(0.25,),
        error_p95=(None,),
    )


def incident(state: State, **values: Any) -> Incident:
    """Return an incident of the ammeter."""
    told: Any = {
        "id": 1,
        "detected": 100.0,
        "kind": Kind.NODE_GONE,
        "detail": "it is gone",
        **values,
    }
    return Incident(
        service="ammeter",
        topic="/current",
        properties=("current",),
        faulty_node="/ammeter",
        state=state,
        errors=(Error(0.25), None),
        **told,
    )


def running(name: str, needed: bool) -> facts.Running:
    """Return the row of a service in the running SOM."""
    return facts.Running(name, NODES[name], f"/{name}", 0.02, needed, True)


def alive() -> List[facts.Fact]:
    """Wait for all healers."""
    return [facts.Healer(name, "alive") for name in ("monitor", "reconfigurator", "master")]


def well() -> View:
    """Return the robot when all is well."""
    view = View()
    for fact in [
        facts.ModelsRead(ONTOLOGY, SOM),
        *alive(),
        facts.TrustTold("checked"),
        facts.HealthTold("", tuple(map(health, NODES))),
        facts.ServicesTold(tuple(running(name, name != "wattmeter") for name in NODES)),
        facts.SubstitutesTold((substitute(publishing=False),)),
    ]:
        view.handle(fact)
    return view


def gone(view: View) -> None:
    """Let the ammeter die, and its substitute publish."""
    view.handle(facts.HealthTold("", (health("ammeter", "failed", "it is gone"),), whole=False))
    view.handle(facts.IncidentTold(incident(State.HEALING)))
    view.handle(facts.SubstitutesTold((substitute(publishing=True),), whole=False))
    view.handle(facts.IncidentTold(incident(State.HEALED, first_message=100.1)))
