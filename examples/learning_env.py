"""An arm as a Gymnasium environment: one episode with random directions. Nothing has to run:

    .venv/bin/python examples/learning_env.py

It needs `pip install 'cobot[learning]'`.
"""

from __future__ import annotations

import gymnasium
import numpy as np

with gymnasium.make("cobot.learning:cobot/Reach-v0", max_episode_steps=150) as env:
    observation, info = env.reset(seed=7)
    away = [np.linalg.norm(observation["tcp_pose"][:3] - observation["goal"])]
    action, over = env.action_space.sample(), False
    env.action_space.seed(7)
    while not over:
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        away.append(np.linalg.norm(observation["tcp_pose"][:3] - observation["goal"]))
        if away[-1] >= away[-2]:  # no nearer to the goal: try another direction
            action = env.action_space.sample()
    print(f"{away[0]:.3f} m away at first, {min(away):.3f} m at best, after {info['time_s']:.1f} s")
