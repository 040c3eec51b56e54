from cobot.robot.clearance import Clearance
from cobot.types import Array

def shorten(clearance: Clearance, corners: Array, seed: int) -> Array: ...
