"""PPO put together from TorchRL's parts."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import CudaGraphModule, TensorDictModuleBase
from torch.distributions import Distribution
from torch.nn.utils import clip_grad_norm_
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.data.replay_buffers.samplers import SamplerWithoutReplacement
from torchrl.envs import Transform
from torchrl.modules import ProbabilisticActor
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from locomotion.agents.learners import Optimizer, PPOConfig, Schedule
from locomotion.options import ConfigError

#: The sum of these is minimised.
LOSSES = ("loss_objective", "loss_entropy", "loss_critic")
_OPTIMIZERS = {
    Optimizer.adam: torch.optim.Adam,
    Optimizer.adamw: torch.optim.AdamW,
    Optimizer.rmsprop: torch.optim.RMSprop,
    Optimizer.sgd: torch.optim.SGD,
}


class PPO:
    """Turns a batch of experience into a better actor and critic (Schulman et al. 2017, eq. 9).

    Advantages are estimated with GAE and normalised in each minibatch; the entropy bonus is the
    mean over the hinges, as the report has it, where TorchRL's joint entropy is their sum. A recurrent
    actor learns from whole sequences: its minibatches are robots with all their steps.
    With ``config.cudagraphs`` a gradient step is one captured CUDA graph.

    Args:
        actor: the policy: any TorchRL actor with a distribution whose entropy is known.
        critic: the state value; it shares no parameters with the actor.
        config: hyperparameters.
        num_actions: length of an action.
        frames: frames in a batch.
        recurrent: whether the actor keeps a memory from step to step.
        transform: of each minibatch, such as :class:`~locomotion.transforms.RandomMirror`.

    Attributes:
        policy: the actor.
        critic: as given.
    """

    def __init__(
        self,
        actor: ProbabilisticActor,
        critic: TensorDictModuleBase,
        config: PPOConfig,
        num_actions: int,
        frames: int,
        recurrent: bool = False,
        transform: Transform | None = None,
    ) -> None:
        self.policy = actor
        self.critic = critic
        self._config = config
        self._recurrent = recurrent
        self._device = next(critic.parameters()).device
        # TorchRL gives its constants torch's default dtype, in which all would be computed.
        with _default_dtype(next(critic.parameters()).dtype):
            self.advantage = GAE(
                gamma=config.gamma,
                lmbda=config.gae_lambda,
                value_network=critic,
                average_gae=False,
                device=self._device,
            )
            self.loss = _Loss(
                actor,
                critic,
                clip_epsilon=config.clip_epsilon,
                entropy_coeff=config.entropy_coeff / num_actions,
                critic_coeff=1.0,
                loss_critic_type="l2",
                normalize_advantage=True,
                functional=False,  # nothing here swaps parameters
            )
        self.optimizer = self._make_optimizer()
        self._factor = {
            Schedule.linear: lambda update: max(0.0, 1 - update / config.iterations),
            Schedule.constant: lambda update: 1.0,
        }[config.schedule]
        # Rows are frames, or the sequences of robots.
        rows = frames // config.steps if recurrent else frames
        size = max(1, config.minibatch_size // config.steps) if recurrent else config.minibatch_size
        self.buffer = ReplayBuffer(
            storage=LazyTensorStorage(rows, device=self._device),
            sampler=SamplerWithoutReplacement(),
            batch_size=size,
            transform=transform,
        )
        self._begin_at(0)

    def _make_optimizer(self) -> torch.optim.Optimizer:
        config = self._config
        groups = [
            {"params": list(self.policy.parameters()), "lr": config.actor_lr},
            {"params": list(self.critic.parameters()), "lr": config.critic_lr},
        ]
        options = dict(config.optimizer_options)
        if config.optimizer in (Optimizer.adam, Optimizer.adamw):
            options = {"fused": True, "capturable": config.cudagraphs, **options}
        try:
            return _OPTIMIZERS[config.optimizer](groups, **options)
        except (TypeError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise ConfigError(f"ppo.optimizer_options={options}: {reason}") from error

    def update(self, batch: TensorDictBase) -> dict[str, float]:
        """Learns from one batch.

        Args:
            batch: experience as a collector returns it, batch shape ``(num_envs, steps)``. The
                advantage, the value target and the state value are added to it.

        Returns:
            Losses and diagnostics, each the mean over all gradient steps; the mean state value, and
            the actor's learning rate.

        Raises:
            FloatingPointError: if a loss or a weight is no longer a finite number.
        """
        # Where nothing was reset, a next state is the state of the next step, and one pass of the
        # critic evaluates both.
        self.advantage.shifted = not batch["next", "done"].any()
        with torch.no_grad():
            self.advantage(batch)
        learned_from = batch.select(*self._keys(batch))
        self.buffer.extend(learned_from if self._recurrent else learned_from.reshape(-1))
        learning_rate = self.learning_rate
        epochs = range(self._config.epochs)
        losses = [self._step(minibatch) for _ in epochs for minibatch in self.buffer]
        losses = torch.stack(losses)
        # Looked at when all is done: on a GPU each look would wait for it.
        _require_finite("the loss", *(losses[name] for name in LOSSES))
        self._begin_at(self.updates + 1, capture=False)
        for group in self.optimizer.param_groups:
            _require_finite("a weight", *(parameter.sum() for parameter in group["params"]))
        means = {name: value.mean().item() for name, value in losses.items()}
        return {
            "mean_value": batch["state_value"].mean().item(),
            **means,
            "actor_lr": learning_rate,
        }

    def _keys(self, batch: TensorDictBase) -> list[Any]:
        keys = [*self.policy.in_keys, *self.critic.in_keys]
        keys += ["action", "action_log_prob", "advantage", "value_target"]
        if self._recurrent:
            keys += ["is_init", ("next", "done")]
        there = batch.keys(True, True)
        return [key for key in dict.fromkeys(keys) if key in there]

    @property
    def learning_rate(self) -> float:
        """The actor's learning rate in the next update."""
        return self._config.actor_lr * self._factor(self.updates)

    def _begin_at(self, update: int, capture: bool = True) -> None:
        """Sets the learning rates of an update, and how its gradient steps are taken."""
        self.updates = update
        rates = (self._config.actor_lr, self._config.critic_lr)
        for group, rate in zip(self.optimizer.param_groups, rates, strict=True):
            value = rate * self._factor(update)
            if not self._config.cudagraphs:
                group["lr"] = value
            elif capture:  # a graph reads the number where it was when it was captured
                group["lr"] = torch.tensor(value, dtype=torch.float32, device=self._device)
            else:
                group["lr"].fill_(value)
        if capture:
            graph = self._config.cudagraphs
            self._step = CudaGraphModule(self._learn, in_keys=[]) if graph else self._learn

    def _learn(self, minibatch: TensorDictBase) -> TensorDict:
        losses = self.loss(minibatch)
        total = sum(losses[name] for name in LOSSES)
        self.optimizer.zero_grad()
        total.backward()
        if self._config.max_grad_norm is not None:
            for group in self.optimizer.param_groups:
                clip_grad_norm_(group["params"], self._config.max_grad_norm)
        self.optimizer.step()
        return losses.detach()

    def state_dict(self) -> dict[str, Any]:
        """All that it knows, apart from the actor."""
        return {
            "critic": self.critic.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "sampler": self.buffer.sampler.state_dict(),
            "updates": self.updates,
        }

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Resumes from a state; learning rates are those of this schedule at that point."""
        self.critic.load_state_dict(state_dict["critic"])
        self.optimizer.load_state_dict(state_dict["optimizer"])
        sampler = dict(state_dict["sampler"])
        if sampler["_sample_list"] is not None:  # where it is, the next ones will be made
            sampler["_sample_list"] = sampler["_sample_list"].to(self._device)
        self.buffer.sampler.load_state_dict(sampler)
        self._begin_at(state_dict["updates"])


class _Loss(ClipPPOLoss):
    """TorchRL's loss, which never makes the host wait for a GPU."""

    def _get_entropy(self, dist: Distribution, adv_shape: torch.Size) -> torch.Tensor:
        # TorchRL's looks in every step whether it is finite, to sample it where it is not. If a
        # Gaussian's is not, nor is the loss, at which PPO.update looks when all is done.
        return dist.entropy().unsqueeze(-1)


@contextlib.contextmanager
def _default_dtype(dtype: torch.dtype) -> Iterator[None]:
    before = torch.get_default_dtype()
    torch.set_default_dtype(dtype)
    try:
        yield
    finally:
        torch.set_default_dtype(before)


def _require_finite(name: str, *values: torch.Tensor) -> None:
    if not torch.stack(values).isfinite().all():
        raise FloatingPointError(f"{name} is no longer a finite number")
