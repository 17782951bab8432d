"""A package of somebody else's: a reading, a reward, an arena, a network and a learner of their own.

The snippets of CONTRIBUTING.md are taken from here.
"""

import dataclasses

from locomotion.agents.architectures import Network
from locomotion.agents.base import LearnerConfig
from locomotion.envs.readings import Reading
from locomotion.options import Checked, arenas, key, learners, networks, readings, rewards
from locomotion.tasks.rewards import Reward

# A reading.
readings.register("hinge_power")(
    Reading(
        size=lambda task: len(task.robot.hinges),
        unit="W",
        meaning="power of the servos in the last physics step",
        read=lambda state: state.field("actuator_force") * state.field("qvel")[:, 6:],
    )
)


# A reward.
@rewards.register("upright")
@dataclasses.dataclass
class Upright(Reward):
    """The upward part of the core's z axis, from -1 to 1."""

    def __call__(self, before, after):
        _, x, y, _ = after.orientation.unbind(-1)
        return 1 - 2 * (x * x + y * y)


# An arena.
@arenas.register("slope")
@dataclasses.dataclass
class SlopeConfig(Checked):
    """A plane that is tilted towards the world's x axis."""

    PREFIX = "arena."

    angle: float = key("of the slope (rad)", default=0.1, least=-1, most=1)

    def make(self, friction):
        from locomotion.arenas.ground import Ground

        ground = Ground(friction=friction)
        ground.ground_geoms[0].euler = (0, self.angle, 0)
        return ground


# A network.
@networks.register("linear")
@dataclasses.dataclass
class Linear(Network):
    """One linear layer from all observations, and a critic likewise."""

    def make_network(self, sizes, out_features):
        return linear(sizes, "loc", out_features)

    def make_critic(self, sizes):
        return linear(sizes, "state_value", 1)


def linear(sizes, out_key, out_features):
    import torch
    from tensordict.nn import TensorDictModule, TensorDictSequential

    together = TensorDictModule(lambda *seen: torch.cat(seen, -1), list(sizes), ["together"])
    layer = torch.nn.Linear(sum(sizes.values()), out_features)
    return TensorDictSequential(together, TensorDictModule(layer, ["together"], [out_key]))


# A learner.
@learners.register("random_search")
@dataclasses.dataclass
class RandomSearchConfig(LearnerConfig):
    """Perturbs the weights, and keeps what earned more."""

    PREFIX = "random_search."

    deviation: float = key("of the perturbation of each weight", default=0.1, above=0)

    def make(self, env, network, in_keys, critic_keys):
        sizes = {name: env.observation_spec[name].shape[-1] for name in in_keys}
        return RandomSearch(network.make_actor(sizes, env.action_spec), self.deviation)


class RandomSearch:
    """Keeps the best weights so far, and tries others in each iteration."""

    def __init__(self, policy, deviation):
        import torch

        self.policy = policy
        self._deviation = deviation
        self._best, self._reward = self._weights(torch), -float("inf")

    def update(self, batch):
        import torch

        reward = batch["next", "reward"].mean().item()
        if reward > self._reward:
            self._best, self._reward = self._weights(torch), reward
        noise = self._deviation * torch.randn_like(self._best)
        torch.nn.utils.vector_to_parameters(self._best + noise, self.policy.parameters())
        return {"best_reward": self._reward}

    def _weights(self, torch):
        return torch.nn.utils.parameters_to_vector(self.policy.parameters()).detach().clone()

    def state_dict(self):
        return {"best": self._best, "reward": self._reward}

    def load_state_dict(self, state_dict):
        self._best, self._reward = state_dict["best"], state_dict["reward"]
