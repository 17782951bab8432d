"""The work of hinges."""

from __future__ import annotations

from collections.abc import Callable

import torch


def hinge_work(
    parameter: Callable[[str], torch.Tensor],
    timestep: float,
    force: torch.Tensor,
    before: torch.Tensor,
    after: torch.Tensor,
) -> torch.Tensor:
    """Work of all hinges of each robot in one physics step (J), without regard to sign.

    MuJoCo's ``implicitfast`` integrator takes a servo's damping from the speed at the end of the step,
    unless its torque is at the limit. That torque times the mean speed is what goes into the body. Work
    hardly depends on the timestep: at 0.01 s it is 5% less than at 0.0001 s, as movements differ.

    Args:
        parameter: reads a field of ``MjModel``, a row for each robot or one for all; the first joint of
            the model is a free one.
        timestep: length of the physics step (s).
        force: ``actuator_force`` of the step (N·m), shape ``(robots, hinges)``.
        before: ``qvel`` before the step, shape ``(robots, nv)``.
        after: ``qvel`` after it.

    Returns:
        Shape ``(robots,)``.
    """
    start, end = before[:, 6:], after[:, 6:]
    damping = parameter("actuator_biasprm")[..., 2].to(force)
    # A torque at the limit may be less by a rounding, as on physics that computes in float32.
    limit = parameter("actuator_forcerange")[..., 1].to(force) * (1 - 1e-6)
    torque = force + (force.abs() < limit) * damping * (end - start)
    return 0.5 * timestep * (torque * (start + end)).abs().sum(-1)
