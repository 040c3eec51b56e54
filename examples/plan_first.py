"""Plan a motion, read the plan, search for a faster plan, and run it.

Start `make run` in another terminal, then:

.venv/bin/python examples/plan_first.py
"""

from __future__ import annotations

import os

from cobot.client import Client

with Client(os.environ.get("COBOT_URL", "http://localhost:8007")) as robot:
    robot.move_named("home", speed=0.5)
    plan = robot.plan("named", name="work", speed=0.5, planner="auto")
    print(f"{plan['duration_s']:.2f} s; {plan['note']}")
    for quantity, use in plan["utilisation"].items():
        print(f"{quantity}: at most {max(use['share']):.0%} of the limit")
    print("nearest to itself:", plan["closest_self"])
    print("nearest to its surroundings:", plan["closest_environment"])
    better = robot.improve(plan["plan_id"], budget_s=0.2)
    print(f"{better['duration_s']:.2f} s after more planning: {better['planning']['quality']}")
    robot.execute(better["plan_id"])
