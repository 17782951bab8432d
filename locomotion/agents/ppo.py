"""PPO put together from TorchRL's parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import CudaGraphModule, TensorDictModuleBase
from torch.distributions import Distribution
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.data.replay_buffers.samplers import SamplerWithoutReplacement
from torchrl.modules import ProbabilisticActor
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from locomotion.config import PPOConfig

#: What is minimised is the sum of these.
LOSSES = ("loss_objective", "loss_entropy", "loss_critic")


class PPO:
    """Turns a batch of experience into a better actor and critic (Schulman et al. 2017, eq. 9).

    Advantages are estimated with GAE and normalised in each minibatch; the entropy bonus is the
    mean over the hinges, as the report has it, where TorchRL's joint entropy is their sum.
    Both learning rates fall linearly over the iterations, to 0 after the last. With
    ``config.cudagraphs`` a gradient step is one captured CUDA graph.

    Args:
        actor: the policy.
        critic: the state value; it shares no parameters with the actor.
        num_hinges: length of an action.
        frames: frames in a batch.
        config: hyperparameters.
    """

    def __init__(
        self,
        actor: ProbabilisticActor,
        critic: TensorDictModuleBase,
        num_hinges: int,
        frames: int,
        config: PPOConfig,
    ) -> None:
        self.epochs = config.epochs
        self.advantage = GAE(
            gamma=config.gamma,
            lmbda=config.gae_lambda,
            value_network=critic,
            average_gae=False,
        )
        self.loss = _Loss(
            actor,
            critic,
            clip_epsilon=config.clip_epsilon,
            entropy_coeff=config.entropy_coeff / num_hinges,
            critic_coeff=1.0,
            loss_critic_type="l2",
            normalize_advantage=True,
            functional=False,  # nothing here swaps parameters
        )
        self.optimizer = torch.optim.Adam(
            [
                {"params": list(actor.parameters()), "lr": config.actor_lr},
                {"params": list(critic.parameters()), "lr": config.critic_lr},
            ],
            fused=True,
            capturable=config.cudagraphs,
        )
        self.schedule = torch.optim.lr_scheduler.LambdaLR(
            self.optimizer, lambda iteration: max(0.0, 1 - iteration / config.iterations)
        )
        self._learned_from = [
            *actor.in_keys,
            *("action", "action_log_prob", "advantage", "value_target"),
        ]
        self._cudagraphs = config.cudagraphs
        self._device = next(critic.parameters()).device
        self._begin_at(0)
        self.buffer = ReplayBuffer(
            storage=_RowStorage(frames, device=self._device),
            sampler=SamplerWithoutReplacement(),
            batch_size=config.minibatch_size,
        )

    def update(self, batch: TensorDictBase) -> TensorDict:
        """Learns from one batch.

        Args:
            batch: what the collector returned, batch shape ``(num_envs, steps)``. The advantage,
                the value target and the state value are added to it.

        Returns:
            Losses and diagnostics, each the mean over all gradient steps.

        Raises:
            FloatingPointError: if a loss or a weight is no longer a finite number.
        """
        # Where nothing was reset, a next state is the state of the next step, and one pass of the
        # critic evaluates both.
        self.advantage.shifted = not batch["next", "done"].any()
        with torch.no_grad():
            self.advantage(batch)
        self.buffer.extend(batch.select(*self._learned_from).reshape(-1))
        losses = [self._step(minibatch) for _ in range(self.epochs) for minibatch in self.buffer]
        losses = torch.stack(losses)
        # Looked at when all is done: on a GPU each look would wait for it.
        _require_finite("the loss", *(losses[name] for name in LOSSES))
        self.schedule.step()
        for group in self.optimizer.param_groups:
            _require_finite("a weight", *(parameter.sum() for parameter in group["params"]))
        return losses.mean(0)

    def _begin_at(self, update: int) -> None:
        """Sets the learning rates of an update, and what takes gradient steps from there on."""
        self.schedule.last_epoch = update
        schedule = zip(self.schedule.base_lrs, self.schedule.lr_lambdas, strict=True)
        for group, (rate, factor) in zip(self.optimizer.param_groups, schedule, strict=True):
            group["lr"] = rate * factor(update)
            if self._cudagraphs:  # a graph reads the number where it was when it was captured
                group["lr"] = torch.tensor(group["lr"], device=self._device)
        self._graph = CudaGraphModule(self._learn, in_keys=[]) if self._cudagraphs else None

    def _step(self, minibatch: TensorDictBase) -> TensorDict:
        return self._learn(minibatch) if self._graph is None else self._graph(minibatch)

    def _learn(self, minibatch: TensorDictBase) -> TensorDict:
        losses = self.loss(minibatch)
        total = sum(losses[name] for name in LOSSES)
        self.optimizer.zero_grad()
        total.backward()
        self.optimizer.step()
        return losses.detach()

    @property
    def actor_lr(self) -> float:
        """The actor's learning rate in the next update."""
        return self.schedule.base_lrs[0] * self.schedule.lr_lambdas[0](self.schedule.last_epoch)

    def state_dict(self) -> dict[str, Any]:
        """All that it knows beside the networks."""
        return {
            "optimizer": self.optimizer.state_dict(),
            "sampler": self.buffer.sampler.state_dict(),
            "updates": self.schedule.last_epoch,
        }

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Goes on from a state; learning rates are those of this schedule at that point."""
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


class _RowStorage(LazyTensorStorage):
    """Storage that is read by ``index_select``: the same rows, in a fraction of indexing's time."""

    def get(self, index: torch.Tensor) -> TensorDictBase:
        stored = super().get(slice(None))
        return stored.apply(lambda entry: entry.index_select(0, index), batch_size=index.shape)


def _require_finite(name: str, *values: torch.Tensor) -> None:
    if not torch.stack(values).isfinite().all():
        raise FloatingPointError(f"{name} is no longer a finite number")
