"""Disturbances at work on many robots."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch

from locomotion.disturbances.bodies import Bodies
from locomotion.disturbances.commands import Commands
from locomotion.disturbances.draws import Draws
from locomotion.disturbances.options import DisturbancesConfig
from locomotion.disturbances.senses import Senses
from locomotion.physics import Physics
from locomotion.tasks import WalkAway

#: What changes targets, what changes readings.
_COMMANDS = ("dropped", "backlash", "stuck")
_SENSES = (
    *("sensor_latency", "hinge_noise", "hinge_bias", "orientation_noise", "orientation_bias"),
    *("speed_noise", "gyro_bias"),
)


class Disturbances:
    """Draws what disturbs robots, and disturbs them.

    All robots draw anew after each ``interval``. The random numbers are those of a generator of its own,
    on the robots' device.

    Args:
        config: the list.
        task: the task.
        physics: whose robots they are.
    """

    def __init__(self, config: DisturbancesConfig, task: WalkAway, physics: Physics) -> None:
        self._config = config
        self._physics = physics
        self._period = task.control_timestep
        self._interval = max(1, round(config.interval / self._period))
        self._steps = 0
        self._generator = torch.Generator(physics.device)
        model, at = physics.model, physics.device
        self._draws = Draws(config, model, physics.num_envs, at)
        self._bodies = Bodies(self._draws, physics)
        shape = (physics.num_envs, model.nu)
        commanded = any(map(config.active, _COMMANDS))
        self._commands = Commands(self._draws, task.target_limit, shape, at) if commanded else None
        self._senses = Senses(self._draws, physics) if any(map(config.active, _SENSES)) else None

    def seed(self, seed: int) -> None:
        """Seeds all that is drawn from now on."""
        self._generator.manual_seed(seed)

    def draw(self) -> None:
        """Has all robots draw anew."""
        self._draws.draw(self._generator)
        self._bodies.write()
        if self._commands is not None:
            self._commands.hold(self._physics.qpos[:, 7:])
        self._steps = 0

    @property
    def drawn(self) -> torch.Tensor | None:
        """The strength of each disturbance at work, in the order of the list, from -1 to 1.

        Shape ``(num_envs, disturbances)``, the mean over links or hinges; ``None`` without disturbances.
        """
        return self._draws.shares

    def begin(self, targets: torch.Tensor, rows: torch.Tensor | slice) -> torch.Tensor:
        """Begins the episodes of rows.

        Args:
            targets: of the hinges at the start (rad), shape ``(num_envs, hinges)``.
            rows: whose episodes.

        Returns:
            What the hinges get.
        """
        return targets if self._commands is None else self._commands.begin(targets, rows)

    def before_step(self, targets: torch.Tensor) -> torch.Tensor:
        """Disturbs robots at the start of a control step.

        Args:
            targets: what the policy asks for (rad), shape ``(num_envs, hinges)``.

        Returns:
            What the hinges get.
        """
        if self._steps >= self._interval:
            self.draw()
        self._steps += 1
        if "push" in self._draws:
            self._push()
        if self._commands is None:
            return targets
        self._physics.require_control(targets)
        return self._commands.send(targets, self._generator)

    def _push(self) -> None:
        velocity, strength = self._physics.qvel, self._draws["push"][:, 0]
        how = {"generator": self._generator, "dtype": velocity.dtype, "device": velocity.device}
        chance, turn = torch.rand(2, len(velocity), **how)
        strength = strength * (chance < self._period / self._config.push_interval)
        velocity[:, 0] += strength * (2 * torch.pi * turn).cos()
        velocity[:, 1] += strength * (2 * torch.pi * turn).sin()

    def sensed(self) -> Callable[[str], torch.Tensor]:
        """Reads fields of MuJoCo's ``MjData`` by name, as sensors tell them now."""
        fields: dict[str, torch.Tensor] = {}
        if self._senses is not None:
            fields["qpos"], fields["qvel"] = self._senses(self._generator)
        if self._commands is not None:
            fields["ctrl"] = self._commands.asked

        def field(name: str) -> torch.Tensor:
            if name in fields:
                return fields[name]
            value = self._physics.field(name)
            return self._bodies.torque(value) if name == "actuator_force" else value

        return field

    def state_dict(self) -> dict[str, Any]:
        """All that decides what comes next, but for physics."""
        return {
            "draws": self._draws.state_dict(),
            "commands": {} if self._commands is None else self._commands.state_dict(),
            "steps": self._steps,
            "generator": self._generator.get_state(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continues from a state."""
        self._draws.load_state_dict(state["draws"])
        if self._commands is not None:
            self._commands.load_state_dict(state["commands"])
        self._steps = state["steps"]
        self._generator.set_state(state["generator"])
