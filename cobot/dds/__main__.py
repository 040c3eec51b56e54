"""`python -m cobot.dds`: the ROS 2 process, which `cobot run` starts."""

from __future__ import annotations

import atexit
import gc
import signal
import sys

from cobot.launch.process import Niceness, die_with_parent, in_words, set_niceness


def start() -> int:
    from cobot.dds.process import main  # takes a second; the supervisor might end unnoticed meanwhile

    return main()


PARTICIPANT_RECORD = "--participant-record"

if __name__ == "__main__":
    atexit.register(gc.freeze)  # same reason as in `cobot.__main__`
    die_with_parent(signal.SIGTERM)
    set_niceness(Niceness.PROMPT, session=True)
    gc.disable()  # until all permanent objects exist: see `cobot.dds.process`
    if PARTICIPANT_RECORD in sys.argv[:-1]:
        from cobot.dds.rtps import ParticipantRecord

        ParticipantRecord(int(sys.argv[sys.argv.index(PARTICIPANT_RECORD) + 1])).announce_end()
    sys.exit(in_words(start))
