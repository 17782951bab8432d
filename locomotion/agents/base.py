"""The protocol of learners, and the options that all of them have."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

from locomotion.options import Checked, ConfigError, key

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from tensordict.nn import TensorDictModuleBase
    from torchrl.envs import EnvBase, Transform

    from locomotion.agents.architectures import Network
    from locomotion.tasks.options import EnvConfig

#: Maximum of frames of an iteration; with a few hundred bytes each they fill a large machine's memory.
MAX_FRAMES = 2**27


class Learner(Protocol):
    """The training loop's view of a learner."""

    #: The policy that collects experience, and that a run is about.
    policy: TensorDictModuleBase

    def update(self, batch: TensorDictBase) -> Mapping[str, float]:
        """Learns from a batch of shape ``(num_envs, steps)``; returns metrics.

        ``mean_value`` among them has a column of its own in ``metrics.csv``.

        Raises:
            FloatingPointError: if what is learned is no longer a finite number.
        """
        ...

    def state_dict(self) -> dict[str, Any]:
        """All that it knows, apart from the policy."""
        ...

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Resumes from a state."""
        ...


@dataclasses.dataclass
class LearnerConfig(Checked):
    """Base class of learners' options: how much is collected, and for how long."""

    iterations: int = key(
        "rounds of collecting and learning", default=200, least=1, most=1_000_000_000
    )
    steps: int = key(
        "control steps each robot takes in an iteration", default=128, least=1, most=1_000_000
    )

    def check(self, env: EnvConfig, device: str) -> None:
        """Looks whether the options fit the robots of a run and the device that they are on.

        Raises:
            ConfigError: if they do not.
        """
        if env.num_envs * self.steps > MAX_FRAMES:
            raise ConfigError(
                f"env.num_envs={env.num_envs} x {self.PREFIX}steps={self.steps} must be at most"
                f" {MAX_FRAMES} frames in an iteration"
            )

    def check_network(self, network: Network) -> None:
        """Looks whether the options fit an architecture.

        Raises:
            ConfigError: if they do not.
        """

    def make_transforms(self, env: EnvBase, network: Network) -> list[Transform]:
        """Makes the transforms that the environment needs for the policy.

        Args:
            env: the environment, without transforms.
            network: the architecture.
        """
        return network.make_transforms()

    def make(
        self, env: EnvBase, network: Network, in_keys: list[str], critic_keys: list[str]
    ) -> Learner:
        """Makes the learner.

        Args:
            env: the environment, for its specs.
            network: the architecture.
            in_keys: the entries that the policy sees.
            critic_keys: the entries that a critic sees, those of the policy among them.
        """
        raise NotImplementedError
