"""A function for examples/studies/fall.yaml. It computes results and changes nothing else."""

from __future__ import annotations

G = 9.81


def drop(height_m: float, drag: float, mass_kg: float) -> dict[str, float | bool]:
    """Compute the speed of a falling part at the floor, and whether the part survives."""
    speed, position, step_s = 0.0, height_m, 1e-3
    while position > 0.0:
        speed += (G - drag * speed * speed / mass_kg) * step_s
        position -= speed * step_s
    return {"speed": speed, "survives": 0.5 * mass_kg * speed * speed < 2.0}
