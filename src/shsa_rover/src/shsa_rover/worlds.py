"""Worlds that the simulated rover can be in: what it carries, what it drives on, how it is built.

src/shsa_rover/README.md has the sources of the figures.
"""
from dataclasses import dataclass, replace
from random import Random
from typing import Mapping

from shsa_core.errors import ShsaError
from shsa_rover.battery import BatteryParameters
from shsa_rover.chassis import ChassisParameters
from shsa_rover.current_sensor import CurrentSensor
from shsa_rover.motors import PowerParameters
from shsa_rover.sensors import SensorParameters

DRAWN = "drawn"  # the name of the world that the seed draws
GREATEST_PAYLOAD = 30.0  # kg
STEEPEST = 10.0  # deg


@dataclass(frozen=True)
class Floor:
    """Rolling and scrub friction, as shares of those on a hard floor."""

    rolling: float
    scrub: float


FLOORS: Mapping[str, Floor] = {
    "hard": Floor(1.0, 1.0),
    "carpet": Floor(1.5, 1.15),  # estimate: tyres sink in, and grip
    "smooth": Floor(0.9, 0.78),  # estimate: polished stone or lacquer
}


@dataclass(frozen=True)
class World:
    """The rover's surroundings, load and build; without arguments, those of the fitted relations.

    `payload` in kg beyond what the rover always carries, spread over its body; `floor` is one of
    FLOORS; `slope` in deg is the steepest of the hills; `state_of_charge` from 0 to 1 at the start;
    `follows_f1`: the battery is that of the paper's relation, whatever `battery` says.
    Raises ShsaError for values beyond these.
    """

    payload: float = 0.0
    floor: str = "hard"
    slope: float = 0.0
    state_of_charge: float = 0.8
    body: ChassisParameters = ChassisParameters()
    motors: PowerParameters = PowerParameters()
    battery: BatteryParameters = BatteryParameters()
    sensors: SensorParameters = SensorParameters()
    current_sensor: CurrentSensor = CurrentSensor()
    follows_f1: bool = False

    def __post_init__(self) -> None:
        if self.floor not in FLOORS:
            raise ShsaError(f"floor: there is no '{self.floor}', only {', '.join(FLOORS)}")
        for name, most in (
            ("payload", GREATEST_PAYLOAD),
            ("slope", STEEPEST),
            ("state_of_charge", 1.0),
        ):
            value = getattr(self, name)
            if not 0.0 <= value <= most:
                raise ShsaError(f"{name}: must be a number from 0 to {most:g}, not {value!r}")

    @property
    def chassis(self) -> ChassisParameters:
        """The body with its payload, on its floor."""
        floor, body = FLOORS[self.floor], self.body
        mass = body.mass + self.payload
        return replace(
            body,
            mass=mass,
            inertia=body.inertia * mass / body.mass,
            rolling_friction=body.rolling_friction * floor.rolling,
            scrub_friction=body.scrub_friction * floor.scrub,
        )


AS_FITTED = World()
PAPER = "paper"  # the name of the world in which the paper's f1 holds
WORLDS: Mapping[str, World] = {
    "as_fitted": AS_FITTED,
    "payload": World(payload=10.0),
    "slopes": World(slope=5.0),
    "carpet": World(floor="carpet"),
    "smooth": World(floor="smooth"),
}
"""Deviations from the world to which the relations were fitted, one at a time."""
CHANGES: Mapping[str, World] = {
    "payload": WORLDS["payload"],
    "carpet": WORLDS["carpet"],
    "slopes": WORLDS["slopes"],
    "slip": World(body=ChassisParameters(slip=0.12, track_factor=1.3)),
    "battery": World(battery=BatteryParameters(resistance=0.07, polarisation_resistance=0.04)),
}
"""The world in which the relations were fitted may become one of these while nobody measures.

Slip is the greatest of `imperfect`; a battery that is old or cold has twice the resistance.
"""


def named_world(name: str, seed: int = 0) -> World:
    """Return the world of this name; `drawn` is drawn by the seed.

    Raises ShsaError for another name.
    """
    if name == DRAWN:
        return drawn_world(seed)
    if name == PAPER:
        return World(follows_f1=True)
    if name not in WORLDS:
        raise ShsaError(f"world: there is no '{name}', only {', '.join((*WORLDS, PAPER, DRAWN))}")
    return WORLDS[name]


def drawn_world(seed: int) -> World:
    """Draw a world in which nothing is as it was fitted: load, floor, hills, sensors."""
    random = Random(f"{seed}/world")
    world = World(
        payload=random.uniform(0.0, 10.0),
        floor=random.choice(list(FLOORS)),
        slope=random.uniform(0.0, 5.0),
    )
    return imperfect(world, seed)


def imperfect(world: World, seed: int) -> World:
    """Return the world for a rover as it is built: slip, losses, gains, offsets, charge.

    Motors obey their circuit. Gain and zero of the current sensor are those of the ACS712's data
    sheet: total output error +-1.5 % (typical, 25 degC); its zero may be off by +-30 mV (an early
    revision), of which setting it to zero now and then leaves half (estimate). The other spreads
    are estimates of parts as they are sold.
    """
    random = Random(f"{seed}/build")

    def spread(value: float) -> float:
        return random.uniform(-value, value)

    return replace(
        world,
        state_of_charge=random.uniform(0.3, 0.95),
        body=replace(
            world.body,
            slip=random.uniform(0.05, 0.12),
            track_factor=random.uniform(1.0, 1.3),
        ),
        motors=replace(
            world.motors,
            gear_efficiency=random.uniform(0.55, 0.7),
            gears_load_windings=True,
            limited_by_voltage=True,
        ),
        sensors=replace(
            world.sensors,
            voltage_gain=1.0 + spread(0.003),
            voltage_offset=spread(0.02),
            velocity_gain=1.0 + spread(0.02),
            gyroscope_gain=1.0 + spread(0.03),
            gyroscope_offset=spread(0.01),
            accelerometer_gain=1.0 + spread(0.02),
            accelerometer_offset=spread(0.1),
        ),
        current_sensor=replace(
            world.current_sensor,
            sensitivity=world.current_sensor.sensitivity * (1.0 + spread(0.015)),
            zero=world.current_sensor.zero + spread(0.015),
        ),
    )
