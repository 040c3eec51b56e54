"""Groups the waypoints in lists of steps, and checks the lists."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from cobot.errors import InputError
from cobot.motions.bodies import MAX_MOTIONS
from cobot.motions.signals import require_conditions
from cobot.runner.steps import Step
from cobot.runner.targets import Target

Numbered = tuple[int, Target | Step]


def groups(steps: Sequence[Target | Step], first: int = 1) -> list[list[Numbered]]:
    """Divide the steps into groups, with the steps' numbers. Waypoints without a stop between them form one
    group, together with the waypoint at which the arm stops.
    """
    found: list[list[Numbered]] = [[]]
    for number, step in enumerate(steps, start=first):
        found[-1].append((number, step))
        if not isinstance(step, Target) or step.radius == 0.0:
            found.append([])
    return [group for group in found if group]


def require_stops(
    steps: Sequence[Target | Step], place: str, word: str, before: Target | None = None
) -> None:
    """Check the radii of one list, and the conditions of motions between which the arm does not stop.

    Args:
        place: place of the list, such as `steps[2].do`.
        word: name of an entry: step or waypoint.
        before: the motion to home, if there is one before these steps.

    Raises:
        ValueError: a waypoint has a radius although the arm stops there, too many waypoints follow each other
            without a stop, or a waypoint has a condition that is not allowed for it.
    """
    for index, step in enumerate(steps):
        if isinstance(step, Target) and step.radius > 0.0:
            following = steps[index + 1] if index + 1 < len(steps) else None
            why = f"the last {word} has a radius" if following is None else "the next step is not a waypoint"
            if not isinstance(following, Target):
                raise ValueError(f"{place}[{index}].radius: {why}, but the arm stops there; leave it out")
    for group in groups(steps) if before is None else groups([before, *steps], first=0):
        if len(group) > MAX_MOTIONS:
            first, end = group[0][0], group[-1][0]
            raise ValueError(
                f"{place}[{max(first - 1, 0)}] to [{end - 1}] are {len(group)} targets without a stop, "
                f"allowed: {MAX_MOTIONS}; remove the radius of one between them"
            )
        prefixes = [f"{place}[{number - 1}]." if number else "home." for number, _ in group]
        motions = [step for _, step in group if isinstance(step, Target)]
        try:
            require_conditions(motions, prefixes[: len(motions)])
        except InputError as exc:
            raise ValueError(f"{exc}; remove the radius before or after it") from exc


def walk(
    steps: Sequence[Target | Step], place: str, depth: int = 1
) -> Iterator[tuple[str, int, Target | Step]]:
    """All steps, including steps inside other steps. For each step: its place, its depth (1 for the outermost
    list), and the step.
    """
    for index, step in enumerate(steps):
        here = f"{place}[{index}]"
        yield here, depth, step
        if isinstance(step, Step):
            for key, block in step.blocks().items():
                yield from walk(block, f"{here}.{key}", depth + 1)
