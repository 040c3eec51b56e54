"""Robot learning: a Gymnasium environment, policies that a server computes, cameras, episodes.

    gymnasium.make("cobot.learning:cobot/Reach-v0")

Each module imports only the packages that it needs. docs/learning.md names the extras that install them.
"""

from __future__ import annotations

import contextlib

with contextlib.suppress(ImportError):
    import gymnasium

    if "cobot/Reach-v0" not in gymnasium.registry:
        gymnasium.register(
            "cobot/Reach-v0", entry_point="cobot.learning.environment:ArmEnv", max_episode_steps=300
        )
