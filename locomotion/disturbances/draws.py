"""Drawing: the values that robots, links and hinges have for a while."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import torch

from locomotion.disturbances.options import DEFAULTS, DisturbancesConfig

#: Those of which each link, and each hinge, has a value of its own; of the others each robot has one.
_BY_LINK = ("mass",)
_BY_HINGE = ("strength", "stiffness", "damping", "hinge_friction", "backlash", "hinge_bias")
#: Those that are drawn to either side, or about an axis of any direction.
_SIGNED, _DIRECTED = ("hinge_bias",), ("orientation_bias", "gyro_bias")


class Draws:
    """Values that each robot has drawn of each active disturbance, by name.

    Values are uniform in their range. Each has shape ``(num_envs, 1)``, ``(num_envs, links)``,
    ``(num_envs, hinges)``, or ``(num_envs, 3)`` if it has a direction; ``stuck`` is a mask of hinges.

    Args:
        config: the ranges.
        model: the compiled model, whose first joint is a free one.
        num_envs: number of robots.
        device: where they are.
    """

    def __init__(
        self,
        config: DisturbancesConfig,
        model: mujoco.MjModel,
        num_envs: int,
        device: torch.device,
    ) -> None:
        sizes = dict.fromkeys(DEFAULTS, 1) | dict.fromkeys(_BY_LINK, model.nbody - 1)
        sizes |= dict.fromkeys((*_BY_HINGE, "stuck"), model.nu) | dict.fromkeys(_DIRECTED, 3)
        self._ends = {name: config.ends(name) for name in DEFAULTS if config.active(name)}
        #: See :attr:`Disturbances.drawn`.
        self.shares: torch.Tensor | None = None
        if self._ends:
            where = {"dtype": torch.float32, "device": device}
            self.shares = torch.zeros(num_envs, len(DEFAULTS), **where)
        self._chances = {
            name: 1.0 if name in config.always else config.chance for name in self._ends
        }
        self._values = {
            name: torch.zeros(num_envs, sizes[name], dtype=torch.float64, device=device)
            for name in self._ends
        }

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> torch.Tensor:
        return self._values[name]

    def get(self, name: str) -> torch.Tensor | float:
        """A disturbance's values, or the one that changes nothing."""
        return self._values.get(name, self.nominal(name))

    @staticmethod
    def nominal(name: str) -> float:
        """The value of a disturbance that changes nothing."""
        nominal = DEFAULTS[name]
        return torch.inf if nominal is None else nominal

    def draw(self, generator: torch.Generator) -> None:
        """Draws all anew.

        Args:
            generator: on the robots' device.
        """
        for name, values in self._values.items():
            drawn = self._drawn(name, values, generator)
            if self._chances[name] < 1:
                how = {"generator": generator, "dtype": values.dtype, "device": values.device}
                acts = torch.rand(len(values), 1, **how) < self._chances[name]
                drawn = torch.where(acts, drawn, self.nominal(name))
            values.copy_(drawn)
        self._share()

    def _share(self) -> None:
        if self.shares is None:
            return
        for column, name in enumerate(DEFAULTS):
            if name in self._values:
                self.shares[:, column] = self._scaled(name, self._values[name]).to(self.shares)

    def _scaled(self, name: str, values: torch.Tensor) -> torch.Tensor:
        """Values from -1 to 1, 0 where nothing changes, shape ``(num_envs,)``."""
        if name == "top_speed":
            return (self._ends[name][0] / values).mean(1)  # whose nominal value is infinite
        if name in _DIRECTED:
            values = values.norm(dim=1, keepdim=True)
        if name == "stuck":
            return values.amax(1)
        nominal = self.nominal(name)
        return (values - nominal).mean(1) / max(abs(end - nominal) for end in self._ends[name])

    def _drawn(self, name: str, values: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        low, high = self._ends[name]
        how = {"generator": generator, "dtype": values.dtype, "device": values.device}
        robots, size = values.shape
        if name == "stuck":
            # The hinge that may be stuck, and whether it is.
            hinge = torch.rand(robots, size, **how).argmax(1)
            chance = low + (high - low) * torch.rand(robots, **how)
            stuck = torch.rand(robots, **how) < chance
            return torch.nn.functional.one_hot(hinge, size) * stuck[:, None]
        size = 1 if name in _DIRECTED else size
        drawn = low + (high - low) * torch.rand(robots, size, **how)
        if name in _SIGNED:
            drawn = drawn * (2.0 * (torch.rand(robots, size, **how) < 0.5) - 1.0)
        if name in _DIRECTED:
            axis = torch.randn(robots, 3, **how)
            drawn = drawn * axis / axis.norm(dim=1, keepdim=True)
        return drawn

    def state_dict(self) -> dict[str, torch.Tensor]:
        """All that was drawn."""
        return {name: values.clone() for name, values in self._values.items()}

    def load_state_dict(self, state: Mapping[str, torch.Tensor]) -> None:
        """Puts back what was drawn."""
        for name, values in self._values.items():
            values.copy_(state[name])
        self._share()
