"""Experience, at the speed of the physics."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

import torch
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.envs import TransformedEnv
from torchrl.modules import ProbabilisticActor


class RolloutCollector(Collector):
    """TorchRL's collector with a loop of its own, for :class:`~locomotion.envs.LocomotionEnv`.

    Between two physics steps the caches are cold and each call costs many times what it costs by
    itself, so the loop makes as few as it can. Observations, actions and rewards are written into the
    batch's own memory, time first, and never copied again; what can be computed for a batch as a whole
    (noise, log-probabilities) is. The batch is the one that
    :class:`~torchrl.collectors.Collector` would return, without the entries that nobody reads.

    Batches have shape ``(num_envs, steps)``; the next one begins where the last one ended. A batch
    stays as it is when the next one is collected.

    Args:
        env: a locomotion environment, with transforms that have a ``write``, each making one
            observation out of one reading.
        actor: made by :func:`~locomotion.agents.make_actor`; it samples.
        steps: control steps that each robot takes in a batch.
        batches: how many batches to collect.
    """

    def __init__(
        self, env: TransformedEnv, actor: ProbabilisticActor, steps: int, batches: int
    ) -> None:
        frames = env.batch_size[0] * steps
        super().__init__(
            env,
            actor,
            frames_per_batch=frames,
            total_frames=frames * batches,
            trust_policy=True,
            use_buffers=False,
            return_same_td=True,  # each batch has memory of its own; no copy is needed
            no_cuda_sync=True,  # all is done on one stream, that of whoever asks for a batch
            track_traj_ids=False,
            auto_register_policy_transforms=False,
        )
        self._steps = steps
        self._parameters = actor.module[0]
        self._writers = [
            (transform.in_keys[0], transform.out_keys[0], transform.write)
            for transform in env.transform
        ]
        self._keys = actor.in_keys
        self._sizes = [env.observation_spec[key].shape[-1] for key in actor.in_keys]

    @torch.no_grad()
    def rollout(self) -> TensorDict:
        """Collects a batch."""
        robots = self.env.base_env
        shape = (self._steps, *robots.action_spec.shape)
        log_scale = self._parameters.log_scale
        device = log_scale.device
        noise = torch.randn(shape, device=device)
        deviation = noise * log_scale.exp()
        action, reward = torch.empty_like(noise), noise.new_empty(shape[:2])
        places = noise.new_empty(*shape[:2], 2, dtype=torch.float64)
        # All that the policy sees lies side by side; a row more than steps holds what comes last.
        seen = noise.new_empty(self._steps + 1, robots.num_envs, sum(self._sizes))
        entries = dict(zip(self._keys, seen.split(self._sizes, -1)))
        for key, entry in entries.items():
            entry[0] = self._carrier[key]
        rows = [dict(zip(entries, row)) for row in zip(*(e.unbind() for e in entries.values()))]
        terminated, truncated = torch.zeros(2, *shape[:2], 1, dtype=torch.bool, device=device)
        last_seen: list[tuple[int, torch.Tensor, torch.Tensor]] = []

        # Memory from outside stays ordinary; what is made inside costs less.
        with torch.inference_mode():
            policy = self._parameters.net.side_by_side()
            rewarded = 0
            loop = zip(seen[:-1], deviation, action, places)
            for step, (observation, offset, act, place) in enumerate(loop):
                torch.add(policy(observation), offset, out=act)
                ends = robots.advance(act, place)
                readings = robots.observe()
                for in_key, key, write in self._writers:
                    write(readings[in_key], rows[step][key], rows[step + 1][key])
                if ends is not None:
                    reward[rewarded : step + 1] = robots.gains(places[rewarded : step + 1])
                    rewarded = step + 1
                    terminated[step, :, 0], truncated[step, :, 0] = ends
                    ended = ends[0] | ends[1]
                    last_seen.append((step, ended, seen[step + 1, ended]))
                    where = TensorDict({"_reset": ended}, [robots.num_envs], device=robots.device)
                    fresh = self.env.reset(where)
                    for key in self._keys:
                        rows[step + 1][key][ended] = fresh[key][ended]
        if rewarded < self._steps:
            reward[rewarded:] = robots.gains(places[rewarded:])

        for key in self._keys:
            self._carrier[key] = rows[-1][key].clone()
        reward.masked_fill_(terminated.squeeze(-1), 0.0)
        following = seen[1:]
        if last_seen:  # a step that ends an episode is not followed by the state of the next
            following = following.clone()
            for step, ended, observation in last_seen:
                following[step, ended] = observation
        batch = TensorDict(
            {
                **dict(zip(self._keys, seen[:-1].split(self._sizes, -1))),
                "action": action,
                "action_log_prob": self._log_prob(noise),
                "next": {
                    **dict(zip(self._keys, following.split(self._sizes, -1))),
                    "reward": reward.unsqueeze(-1),
                    "done": terminated | truncated,
                    "terminated": terminated,
                    "truncated": truncated,
                },
            },
            batch_size=shape[:2],
            names=["time", None],
            device=robots.device,
        )
        return batch.transpose(0, 1)

    def _log_prob(self, noise: torch.Tensor) -> torch.Tensor:
        """Of actions that are so many standard deviations away from the mean."""
        log_normaliser = 0.5 * math.log(2 * math.pi) + self._parameters.log_scale
        return -(0.5 * noise.square() + log_normaliser).sum(-1)

    def state_dict(self) -> OrderedDict[str, Any]:
        """Where it stands; the environment and the policy have states of their own."""
        return OrderedDict(
            frames=self._frames,
            iter=self._iter,
            seen={key: self._carrier[key] for key in self._keys},
        )

    def load_state_dict(self, state_dict: Mapping[str, Any], **kwargs: Any) -> None:
        self._frames = state_dict["frames"]
        self._iter = state_dict["iter"]
        self._carrier.update(state_dict["seen"])
