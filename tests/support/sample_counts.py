"""How many random inputs a test takes: a share of the number that it names.

The environment variable COBOT_SHARE_OF_SAMPLES sets the share. The default is a quarter, for which
`make test` has time. Use 1 after a change of the tested code. The sanitizers, which make a test ten times as
slow, use a hundredth: the memory that a test touches does not depend on the number.
"""

from __future__ import annotations

import os

DEFAULT_SHARE = 0.25
SHARE = float(os.environ.get("COBOT_SHARE_OF_SAMPLES", DEFAULT_SHARE))
ENOUGH = SHARE >= DEFAULT_SHARE
"""Whether the share is large enough to meet all that a test has to meet by chance."""


def samples(number: int) -> int:
    return max(1, round(number * SHARE))
