"""Pose and accelerations from the wheels' velocities."""
import math

ACCELERATION_TIME_S = 0.04  # smooths the difference quotient
LONGEST_GAP_S = 0.5  # after which differences mean nothing
SMALLEST_ERROR = 1e-3  # m and rad: one step of the wheels' counters


class Odometry:
    """Integrates the pose (`x`, `y` in m, `heading` in rad) and differentiates the velocities.

    `position_error` (m) and `heading_error` (rad) are standard deviations of the pose, which only
    grow: by the noise of the velocities, and where it drives with a heading that is off.
    """

    def __init__(self) -> None:
        self.x = self.y = self.heading = 0.0
        self.position_error = self.heading_error = SMALLEST_ERROR
        self.velocity = self.turn_rate = 0.0
        self.acceleration = self.turn_acceleration = 0.0
        self._time = math.nan

    def update(
        self,
        time: float,
        velocity: float,
        turn_rate: float,
        velocity_error: float = 0.0,
        turn_rate_error: float = 0.0,
    ) -> None:
        """Takes velocity (m/s) and turn rate (rad/s) at `time` (s), with their errors.

        The first sample, and one after a jump back or a gap, only starts anew from the last pose.
        """
        dt = time - self._time
        if 0.0 < dt <= LONGEST_GAP_S:
            middle = self.heading + 0.25 * dt * (self.turn_rate + turn_rate)
            distance = 0.5 * dt * (self.velocity + velocity)
            self.x += distance * math.cos(middle)
            self.y += distance * math.sin(middle)
            self.heading = math.remainder(
                self.heading + 0.5 * dt * (self.turn_rate + turn_rate), math.tau
            )
            drift = self.position_error + abs(distance) * self.heading_error
            self.position_error = math.hypot(drift, velocity_error * dt)
            self.heading_error = math.hypot(self.heading_error, turn_rate_error * dt)
            share = -math.expm1(-dt / ACCELERATION_TIME_S)
            self.acceleration += share * ((velocity - self.velocity) / dt - self.acceleration)
            self.turn_acceleration += share * (
                (turn_rate - self.turn_rate) / dt - self.turn_acceleration
            )
        elif dt != 0.0:
            self.acceleration = self.turn_acceleration = 0.0
        self._time = time
        self.velocity = velocity
        self.turn_rate = turn_rate
