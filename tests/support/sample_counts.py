"""How many random inputs a test takes: a share of the number that it names.

The environment variable COBOT_SHARE_OF_SAMPLES sets the share. By default it is a quarter, which `make test` has
time for; 1 is for who has changed what the test is about. Under the sanitizers, which make all of it ten times
as slow, it is a hundredth: what memory a test touches does not depend on the number.
"""

from __future__ import annotations

import os

DEFAULT_SHARE = 0.25
SHARE = float(os.environ.get("COBOT_SHARE_OF_SAMPLES", DEFAULT_SHARE))
ENOUGH = SHARE >= DEFAULT_SHARE
"""Whether all that a test must meet by chance is met."""


def samples(number: int) -> int:
    return max(1, round(number * SHARE))
