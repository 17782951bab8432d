"""Latency of targets and sensors: MuJoCo's delays, a value for each robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from locomotion.options import ConfigError
from locomotion.tasks.options import delay_for

if TYPE_CHECKING:
    from locomotion.physics.base import Physics


def set_delay(physics: Physics, of: str, latency: torch.Tensor | float, key: str) -> None:
    """Sets the delays of all actuators, or of all sensors that remember.

    Args:
        physics: whose they are.
        of: ``"actuator"`` or ``"sensor"``.
        latency: in seconds, shape ``(num_envs,)`` or one for all.
        key: what makes room for a longer one, for messages.

    Raises:
        ConfigError: if a latency is longer than the one that the model was compiled with.
    """
    model = physics.model
    latency = torch.as_tensor(latency, dtype=torch.float64, device=physics.device)
    least, most = latency.min().item(), latency.max().item()
    timestep, samples = model.opt.timestep, getattr(model, f"{of}_history")[:, 0]
    late = samples > 0  # contact sensors are not
    room = (samples[late].min() - 1) * timestep if late.any() else 0.0
    if not least >= 0:
        raise ConfigError(f"a latency of {least:g} s is not possible; it must be at least 0")
    if not most <= room + 1e-3 * timestep:
        raise ConfigError(
            f"a latency of {most:g} s is beyond the {room:g} s that the model has room for;"
            f" {key} makes room"
        )
    if late.any():
        delay = physics.expand(f"{of}_delay")
        delay.copy_(
            delay_for(latency, timestep).reshape(-1, 1) * torch.as_tensor(late, device=delay.device)
        )
