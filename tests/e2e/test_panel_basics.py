"""The panel's shortest whole paths in a headless Chromium: to stop, jog, plan, run, read.

They are tests of tests/support/panel, all of which test_panel.py runs in `make test-thorough`.
"""

from __future__ import annotations

from panel.jogging import (
    test_a_joint_moves_while_its_button_is_held,
    test_a_page_that_falls_silent_is_stopped_by_the_service,
    test_without_a_connection_nothing_is_held_and_the_page_says_why,
)
from panel.looking import test_a_typed_value_is_planned_and_a_second_enter_runs_it
from panel.moving import test_a_motion_is_shown_before_it_is_run
from panel.page import opened, panel
from panel.standing import (
    test_it_shows_the_arm_where_it_is_and_asks_nobody_else,
    test_it_speaks_german_and_chinese,
)
from panel.stopping import test_stop_is_everywhere
from panel.teaching import test_a_program_is_run_step_by_step_paused_and_ended

__all__ = [
    "opened",
    "panel",
    "test_a_joint_moves_while_its_button_is_held",
    "test_a_motion_is_shown_before_it_is_run",
    "test_a_page_that_falls_silent_is_stopped_by_the_service",
    "test_a_program_is_run_step_by_step_paused_and_ended",
    "test_a_typed_value_is_planned_and_a_second_enter_runs_it",
    "test_it_shows_the_arm_where_it_is_and_asks_nobody_else",
    "test_it_speaks_german_and_chinese",
    "test_stop_is_everywhere",
    "test_without_a_connection_nothing_is_held_and_the_page_says_why",
]
