"""Motion of a skid-steered rover, and the forces that it takes."""
import math
from dataclasses import dataclass
from typing import Callable, Optional, Tuple

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class ChassisParameters:
    """A Pioneer 3-AT with its three batteries and the paper's computers on board.

    Data sheet, as commonly quoted (README.md): 12 kg without batteries, 0.7 m/s, 140 deg/s.
    Body of 0.626 m by 0.505 m: the robot's parameters in its maker's library ARIA (p3at-sh).
    Estimates: batteries of 2.4 kg each; 4.8 kg of payload; the moment of inertia of a homogeneous
    box; track and wheel spacing as in common simulation models of this robot; the friction figures,
    chosen so that a drive with many turns draws 5 to 6 A on average (2 to 4 h with three batteries,
    as quoted, means 5 to 11 A).
    """

    mass: float = 24.0  # kg
    inertia: float = 24.0 * (0.626**2 + 0.505**2) / 12.0  # kg m^2, about the vertical axis
    rotating_mass: float = 5.7  # kg at the wheels' rims: motors seen through their gears (estimate)
    track: float = 0.39  # m, between left and right wheels
    track_factor: float = 1.0  # the effective track of skid steering, as a share of `track`
    slip: float = 0.0  # of the wheels over the ground, by the share of the weight that they push
    wheel_spacing: float = 0.268  # m, between front and rear wheels
    rolling_friction: float = 0.08  # of the weight: soft tyres, belts and gears
    viscous_friction: float = 8.0  # N s/m
    scrub_friction: float = 0.8  # of the weight: tyres dragged sideways on a hard floor
    slip_angle: float = (
        0.15  # rad, at which a rolling tyre's sideways force approaches its full size
    )
    roughness: float = 0.12  # standard deviation of the floor, as a share of the rolling friction
    roughness_time: float = 0.3  # s
    top_speed: float = 0.7  # m/s
    top_turn_rate: float = math.radians(140.0)  # rad/s
    acceleration_limit: float = 0.8  # m/s^2, set in the motor controller
    turn_acceleration_limit: float = 2.5  # rad/s^2, set in the motor controller
    velocity_time: float = 0.25  # s, the motor controller's velocity loop
    acceleration_time: float = 0.06  # s, its torque loop
    watchdog: float = 2.0  # s without a command until it stops (ARCOS default)


@dataclass(frozen=True)
class Effort:
    """The wheels of one side: `force` (N) on the ground at `speed` (m/s), forwards positive."""

    force: float
    speed: float


class Axis:
    """One degree of freedom under the motor controller's command: `velocity` and `acceleration`."""

    def __init__(self, limit: float, velocity_time: float, acceleration_time: float) -> None:
        self.velocity = 0.0
        self.acceleration = 0.0
        self._limit = limit
        self._velocity_time = velocity_time
        self._acceleration_time = acceleration_time

    def follow(self, target: float, dt: float) -> float:
        """Return the acceleration in `dt` s by which it follows `target`.

        A velocity loop around a torque loop, each of first order. The acceleration is limited.
        """
        wanted = (target - self.velocity) / self._velocity_time
        wanted = min(self._limit, max(-self._limit, wanted))
        share = -math.expm1(-dt / self._acceleration_time)
        return self.acceleration + (wanted - self.acceleration) * share

    def move(self, acceleration: float, dt: float) -> None:
        """Moves on by `dt` seconds, at the end of which it has this `acceleration`."""
        self.velocity += 0.5 * (self.acceleration + acceleration) * dt
        self.acceleration = acceleration

    def rest(self) -> None:
        """Stands still if it hardly moves any more."""
        if abs(self.velocity) < 1e-4 and abs(self.acceleration) < 1e-3:
            self.velocity = self.acceleration = 0.0


class Chassis:
    """The rover's motion over the ground; SI units throughout.

    The motor controller regulates the wheels, which skid and slip: the rover moves by less.
    """

    def __init__(self, parameters: ChassisParameters = ChassisParameters()) -> None:
        p = self.parameters = parameters
        self.forward = Axis(p.acceleration_limit, p.velocity_time, p.acceleration_time)
        self.turn = Axis(p.turn_acceleration_limit, p.velocity_time, p.acceleration_time)
        self.floor = 1.0
        self.slope = 0.0
        self._slip = 0.0
        self._target = (0.0, 0.0)
        self._silence = 0.0

    def command(self, velocity: float, turn_rate: float) -> None:
        """Sets the wanted velocity (m/s) and turn rate (rad/s), within the robot's limits."""
        p = self.parameters
        self._target = (
            min(p.top_speed, max(-p.top_speed, velocity)),
            min(p.top_turn_rate, max(-p.top_turn_rate, turn_rate)),
        )
        self._silence = 0.0

    def step(
        self,
        dt: float,
        disturbance: float = 0.0,
        slope: float = 0.0,
        greatest: Optional[Callable[[float], float]] = None,
    ) -> None:
        """Moves on by `dt` seconds.

        `disturbance` is a standard normal number that makes the floor uneven, `slope` (rad) is
        positive uphill, `greatest` tells the force (N) by which one side's wheels can drive on at a
        speed (m/s); without it there is no limit.
        """
        p = self.parameters
        self.slope = slope
        self._silence += dt
        velocity, turn_rate = self._target if self._silence <= p.watchdog else (0.0, 0.0)
        forward = self.forward.follow(velocity / (1.0 + self._slip), dt)
        turn = self.turn.follow(turn_rate / p.track_factor, dt)
        if greatest is not None:
            forward, turn = self._attainable(forward, turn, greatest)
        self.forward.move(forward, dt)
        self.turn.move(turn, dt)
        if velocity == 0.0:
            self.forward.rest()
        if turn_rate == 0.0:
            self.turn.rest()
        keep = math.exp(-dt / p.roughness_time)
        spread = p.roughness * math.sqrt(1.0 - keep * keep)
        self.floor = 1.0 + (self.floor - 1.0) * keep + spread * disturbance
        if p.slip:
            pushed = sum(effort.force for effort in self.efforts()) / (p.mass * GRAVITY)
            self._slip = p.slip * math.copysign(pushed, pushed * self.forward.velocity)

    def friction(self, speed: float) -> float:
        """Return the force (N) that one side's wheels need at a constant `speed` (m/s)."""
        p = self.parameters
        rolling = 0.5 * p.rolling_friction * p.mass * GRAVITY * self.floor
        return rolling * math.tanh(speed / 0.01) + 0.5 * p.viscous_friction * speed

    def scrub(self, velocity: float, turn_rate: float) -> float:
        """Return the torque (N m) of four tyres sideways, by velocity (m/s), turn rate (rad/s).

        In a wide bend the tyres mostly roll: their slip angle, and with it the drag, grows as the
        bend narrows.
        """
        p = self.parameters
        drag = p.scrub_friction * p.mass * GRAVITY * 0.5 * p.wheel_spacing
        sideways = 0.5 * p.wheel_spacing * turn_rate
        return drag * math.tanh(sideways / (p.slip_angle * abs(velocity) + 0.007))

    def kinetic_energy(self) -> float:
        """J, of the body and of everything that turns with the wheels."""
        p = self.parameters
        v, w = self.forward.velocity, self.turn.velocity
        return 0.5 * (p.mass + p.rotating_mass) * v * v + 0.5 * self._inertia() * w * w

    def efforts(self) -> Tuple[Effort, Effort]:
        """Return the wheels of both sides now, by Newton's law for force and torque."""
        return self._efforts(self.forward.acceleration, self.turn.acceleration)

    def wheel_speeds(self) -> Tuple[float, float]:
        """m/s of the left and the right rims: what skids and slips is not the rover's motion."""
        p = self.parameters
        middle = self.forward.velocity * (1.0 + self._slip)
        side = 0.5 * p.track * p.track_factor * self.turn.velocity
        return middle - side, middle + side

    def _efforts(self, acceleration: float, turn_acceleration: float) -> Tuple[Effort, Effort]:
        p = self.parameters
        left, right = self.wheel_speeds()
        push = 0.5 * (p.mass + p.rotating_mass) * acceleration
        twist = self._inertia() * turn_acceleration
        twist += self.scrub(self.forward.velocity, self.turn.velocity)
        return (
            Effort(push - twist / p.track + self._resistance(left), left),
            Effort(push + twist / p.track + self._resistance(right), right),
        )

    def _inertia(self) -> float:
        """kg m^2 against turning, with what turns with the wheels."""
        p = self.parameters
        return p.inertia + p.rotating_mass * (0.5 * p.track) ** 2

    def _resistance(self, speed: float) -> float:
        """Return the force (N) of one side's wheels against friction and gravity.

        At rest friction holds the rover on the slope as far as it can.
        """
        p = self.parameters
        gravity = 0.5 * p.mass * GRAVITY * math.sin(self.slope)
        if self.forward.velocity == 0.0 and self.turn.velocity == 0.0:
            held = 0.5 * p.rolling_friction * p.mass * GRAVITY
            return math.copysign(max(0.0, abs(gravity) - held), gravity)
        return gravity + self.friction(speed)

    def _attainable(
        self, acceleration: float, turn_acceleration: float, greatest: Callable[[float], float]
    ) -> Tuple[float, float]:
        """Limit the accelerations to what each side can push."""
        p = self.parameters
        left, right = (
            _excess(effort, greatest(effort.speed))
            for effort in self._efforts(acceleration, turn_acceleration)
        )
        acceleration -= (left + right) / (p.mass + p.rotating_mass)
        turn_acceleration -= 0.5 * p.track * (right - left) / self._inertia()
        return acceleration, turn_acceleration


def _excess(effort: Effort, greatest: float) -> float:
    """Return the drive (N) that a side lacks; braking is not limited."""
    if effort.force * effort.speed < 0.0 or abs(effort.force) <= greatest:
        return 0.0
    return effort.force - math.copysign(greatest, effort.force)
