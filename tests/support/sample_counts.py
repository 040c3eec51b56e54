"""How many random inputs a test takes.

Under the sanitizers, which make all of it ten times as slow, the environment variable COBOT_SHARE_OF_SAMPLES
has each test take a share of them: what memory it touches does not depend on their number.
"""

from __future__ import annotations

import os

SHARE = float(os.environ.get("COBOT_SHARE_OF_SAMPLES", "1"))


def samples(number: int) -> int:
    return max(1, round(number * SHARE))
