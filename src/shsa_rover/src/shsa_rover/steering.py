"""Keys that steer the rover."""

HELP = """Drive the rover:
  w or up: faster          s or down: slower, then backwards
  a or left: turn left     d or right: turn right
  space: stop              q: quit"""

VELOCITY_STEP = 0.1  # m/s a key
TURN_STEP = 0.2  # rad/s a key
TOP_VELOCITY = 0.7  # m/s
TOP_TURN_RATE = 1.6  # rad/s

ARROWS = {"\x1b[A": "w", "\x1b[B": "s", "\x1b[C": "d", "\x1b[D": "a"}


class Steering:
    """Holds `velocity` (m/s) and `turn_rate` (rad/s); each key changes them a little."""

    def __init__(self) -> None:
        self.velocity = 0.0
        self.turn_rate = 0.0

    def press(self, keys: str) -> bool:
        """Takes keys as a terminal sends them, arrows included; false once one of them is q."""
        for arrow, key in ARROWS.items():
            keys = keys.replace(arrow, key)
        for key in keys.lower():
            if key == "q":
                return False
            if key == " ":
                self.velocity = self.turn_rate = 0.0
            self.velocity += VELOCITY_STEP * ((key == "w") - (key == "s"))
            self.turn_rate += TURN_STEP * ((key == "a") - (key == "d"))
            self.velocity = round(min(TOP_VELOCITY, max(-TOP_VELOCITY, self.velocity)), 3)
            self.turn_rate = round(min(TOP_TURN_RATE, max(-TOP_TURN_RATE, self.turn_rate)), 3)
        return True
