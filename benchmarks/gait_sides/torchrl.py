"""TorchRL's parts put together as its own script for MuJoCo does it, on ``ParallelEnv``.

The script is ``sota-implementations/ppo/ppo_mujoco.py`` with one robot; here several share the control steps
of an iteration.
"""

from __future__ import annotations

import dataclasses
import functools

import mujoco
import torch
from tensordict import TensorDictBase
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.data.replay_buffers.samplers import SamplerWithoutReplacement
from torchrl.envs import (
    ClipTransform,
    Compose,
    EnvBase,
    ExplorationType,
    GymWrapper,
    ParallelEnv,
    RewardSum,
    StepCounter,
    TransformedEnv,
    VecNorm,
)
from torchrl.modules import MLP, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from benchmarks.gait_sides import HISTORY, Hyperparameters, Task
from benchmarks.gait_sides.record import Recorder
from benchmarks.gymnasium_env import WalkAwayEnv
from benchmarks.rivals import START_METHOD


@dataclasses.dataclass(frozen=True)
class Settings(Hyperparameters):
    """All that decides how it learns.

    Attributes:
        critic_coeff: weight of the critic's loss.
        adam_epsilon: Adam's.
        normalise: whether observations are scaled by their running deviation and clipped.
    """

    critic_coeff: float = 1.0
    adam_epsilon: float = 1e-8
    normalise: bool = False


DEFAULTS = Settings(
    num_envs=8,
    steps=256,
    iterations=1_000_000 // 2048,
    epochs=10,
    minibatch_size=64,
    learning_rate=3e-4,
    gamma=0.99,
    gae_lambda=0.95,
    clip_epsilon=0.2,
    entropy_coeff=0.0,
    hidden=(64, 64),
    critic_coeff=0.25,
    adam_epsilon=1e-5,
    normalise=True,
)


def make_env(task: Task, settings: Settings) -> EnvBase:
    """The robots, a process each, with the script's transforms."""
    model = mujoco.MjModel.from_binary_path(task.model)
    make = functools.partial(_make_robot, model)
    env = ParallelEnv(settings.num_envs, make, mp_start_method=START_METHOD)
    env.set_seed(task.seed)
    normalising = (
        VecNorm(in_keys=["observation"], decay=0.99999, eps=1e-2),
        ClipTransform(in_keys=["observation"], low=-10, high=10),
    )
    chosen = normalising if settings.normalise else ()
    return TransformedEnv(env, Compose(*chosen, RewardSum(), StepCounter()))


def _make_robot(model: mujoco.MjModel) -> EnvBase:
    return GymWrapper(WalkAwayEnv(model, HISTORY))


def make_models(env: EnvBase, hidden: tuple[int, ...]) -> tuple[ProbabilisticActor, ValueOperator]:
    """Actor and critic, initialised as in the script."""
    size = env.observation_spec["observation"].shape[-1]
    spec = env.action_spec_unbatched
    actions = spec.shape[-1]
    mean = _network(size, actions, hidden, gain=1.0)
    network = nn.Sequential(mean, AddStateIndependentNormalScale(actions, scale_lb=1e-8))
    actor = ProbabilisticActor(
        TensorDictModule(network, ["observation"], ["loc", "scale"]),
        in_keys=["loc", "scale"],
        spec=env.full_action_spec_unbatched,
        distribution_class=TanhNormal,
        distribution_kwargs={"low": spec.space.low, "high": spec.space.high, "tanh_loc": False},
        return_log_prob=True,
        default_interaction_type=ExplorationType.RANDOM,
    )
    return actor, ValueOperator(_network(size, 1, hidden, gain=0.01), in_keys=["observation"])


def _network(size: int, out: int, hidden: tuple[int, ...], gain: float) -> MLP:
    network = MLP(
        in_features=size, out_features=out, num_cells=list(hidden), activation_class=nn.Tanh
    )
    for layer in network.modules():
        if isinstance(layer, nn.Linear):
            nn.init.orthogonal_(layer.weight, gain)
            nn.init.zeros_(layer.bias)
    return network


def learn(task: Task, recorder: Recorder) -> None:
    ours = task.hyperparameters
    settings = DEFAULTS if ours is None else Settings(**dataclasses.asdict(ours.in_processes()))
    torch.manual_seed(task.seed)
    env = make_env(task, settings)
    actor, critic = make_models(env, settings.hidden)
    update = Update(actor, critic, settings)
    frames = settings.num_envs * settings.steps
    collector = Collector(
        env,
        actor,
        frames_per_batch=frames,
        total_frames=frames * settings.iterations,
        max_frames_per_traj=-1,
    )
    for batch in collector:
        for rewards in batch["next", "reward"].squeeze(-1).unbind(-1):
            recorder.add(rewards)
        update(batch)
        collector.update_policy_weights_()
        recorder.end_iteration()
    collector.shutdown()


class Update:
    """Learns from a batch as the script does: epochs of advantages anew and gradient steps.

    Args:
        actor: the policy.
        critic: the state value.
        settings: of the learner.
    """

    def __init__(
        self, actor: ProbabilisticActor, critic: ValueOperator, settings: Settings
    ) -> None:
        self._settings = settings
        frames = settings.num_envs * settings.steps
        self._buffer = TensorDictReplayBuffer(
            storage=LazyTensorStorage(frames),
            sampler=SamplerWithoutReplacement(),
            batch_size=settings.minibatch_size,
        )
        self._advantage = GAE(
            gamma=settings.gamma,
            lmbda=settings.gae_lambda,
            value_network=critic,
            average_gae=False,
        )
        self._loss = ClipPPOLoss(
            actor_network=actor,
            critic_network=critic,
            clip_epsilon=settings.clip_epsilon,
            loss_critic_type="l2",
            entropy_coeff=settings.entropy_coeff,
            critic_coeff=settings.critic_coeff,
            normalize_advantage=True,
        )
        self._optimizer = torch.optim.Adam(
            [*actor.parameters(), *critic.parameters()],
            lr=settings.learning_rate,
            eps=settings.adam_epsilon,
        )
        self._steps = 0
        per_epoch = frames // settings.minibatch_size
        self._total = settings.iterations * settings.epochs * per_epoch

    def __call__(self, batch: TensorDictBase) -> None:
        for _ in range(self._settings.epochs):
            with torch.no_grad():
                batch = self._advantage(batch)
            self._buffer.extend(batch.reshape(-1))
            for minibatch in self._buffer:
                self._learn(minibatch)

    def _learn(self, minibatch: TensorDictBase) -> None:
        rate = self._settings.learning_rate * (1 - self._steps / self._total)
        for group in self._optimizer.param_groups:
            group["lr"] = rate
        losses = self._loss(minibatch)
        (losses["loss_objective"] + losses["loss_entropy"] + losses["loss_critic"]).backward()
        self._optimizer.step()
        self._optimizer.zero_grad()
        self._steps += 1
