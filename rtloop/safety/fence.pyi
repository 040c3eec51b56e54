"""The fence of a motion, watched in every cycle of it."""

from collections.abc import Sequence

from cobot.motions.fence import Fence
from cobot.reasons import Reason
from cobot.robot.chain import Chain
from cobot.types import Array

class Watch:
    """Whether the TCP is where the motion's fence permits it to be.

    Attributes:
        fence: of the motion; None for none.
    """

    fence: Fence | None

    def __init__(self, chain: Chain) -> None: ...
    def set(self, values: Array | None) -> None:
        """Watch over another one: as `Fence.values` found in shared memory; None or nothing but NaN: none.

        Raises:
            ValueError: some of them are NaN.
        """

    def said(self, row: Sequence[float]) -> Reason: ...
