"""Record a motion, read the file, and repeat the motion.

Start `make run` in another terminal, then:

.venv/bin/python examples/record_and_replay.py
"""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

from mcap.reader import make_reader

from cobot.client import Client
from cobot.recording.reader import read_recording
from cobot.recording.replay import csv_of, points_of

FILE, POINTS = Path("recorded.mcap"), Path("recorded.csv")

with Client(os.environ.get("COBOT_URL", "http://localhost:8007")) as robot:
    robot.move_named("home", speed=0.5)
    robot.record("start")
    robot.move_named("work", speed=0.5)
    (name,) = robot.record("stop")
    robot.fetch_recording(name, FILE)
    with FILE.open("rb") as file:  # any reader of MCAP files works
        counts = Counter(channel.topic for _, channel, _ in make_reader(file).iter_messages())
    print(", ".join(f"{count} of {topic}" for topic, count in sorted(counts.items())))
    times_s, positions = points_of(read_recording(FILE), 0.02)  # without the time at rest
    POINTS.write_text(csv_of(times_s, positions), encoding="utf-8")
    sent = robot.send_csv(POINTS, move_to_start=True, retime=True)  # returns when the motion has begun
    job = robot.job(robot.jobs(1)[0]["id"])
    job.wait()
    print(f"motion {sent['motion_id']}: {sent['points']} points again, {sent['duration_s']:.2f} s")
