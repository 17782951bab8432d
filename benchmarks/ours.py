"""Our side: the parts that training is made of, and how long each takes."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable

import mujoco
import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.envs import EnvBase, ExplorationType, set_exploration_type

from benchmarks.bare import BareBatch
from locomotion import compose
from locomotion.quiet import quiet
from locomotion.training.build import make_collector, make_env, make_learner

#: Of a control step, each around the one before.
PARTS = ("physics", "environment", "transforms", "policy", "collector")


class Training:
    """Environment, learner and collector of ``python -m locomotion.train +obs=history3``.

    Args:
        num_envs: robots.
        steps: control steps of each robot in a batch.
        overrides: further keys of the configuration.
    """

    def __init__(self, num_envs: int, steps: int, *overrides: str) -> None:
        frames = num_envs * steps
        config = compose(
            "+obs=history3",
            f"env.num_envs={num_envs}",
            f"ppo.steps={steps}",
            f"ppo.minibatch_size={min(2048, frames)}",
            "ppo.iterations=1000",  # more batches than any measurement takes
            *overrides,
        )
        torch.manual_seed(config.seed)
        self.frames = frames
        self.steps = steps
        self.env = make_env(config)
        self.model: mujoco.MjModel = self.env.base_env.model
        self.substeps = round(1 / config.env.control_frequency / config.physics.timestep)
        self._learner = make_learner(config, self.env)
        self._collector = make_collector(self.env, self._learner, steps)
        self._batches = iter(self._collector)

    def collect(self) -> tuple[TensorDictBase, float]:
        """The next batch, and how long it took to collect it (s)."""
        started = time.perf_counter()
        batch = next(self._batches)
        return batch, time.perf_counter() - started

    def update(self, batch: TensorDictBase) -> float:
        """The time to learn from a batch (s)."""
        started = time.perf_counter()
        self._learner.update(batch)
        elapsed = time.perf_counter() - started
        self._collector.update_policy_weights_()  # as training does, on its own account
        return elapsed

    def states(self) -> np.ndarray:
        """Times, positions and velocities now, a copy of shape ``(num_envs, 1 + nq + nv)``."""
        return self.env.base_env.physics.motion.numpy().copy()

    def parts(self, bare: BareBatch) -> dict[str, float]:
        """The time of the parts of a control step (s), on average over the next batch.

        The batch is collected, then stepped again by ever more of what collects it, each time from the
        same states under the same actions; a part is the difference between two of these.

        Raises:
            RuntimeError: if the robots did not end where they had ended before.
        """
        saved, start, random = self.env.state_dict(), self.states(), torch.get_rng_state()
        batch, collecting = self.collect()
        end = self.states()
        found, stepping = bare.replay(start, controls(batch))
        ends, taken = [found], [0.0, stepping]
        base = self.env.base_env
        for env, act in (
            (base, _replayed(batch)),
            (self.env, _replayed(batch)),
            (self.env, self._learner.policy),
        ):
            self.env.load_state_dict(saved)
            first = TensorDict(batch_size=env.batch_size) if env is base else self.env.reset()
            torch.set_rng_state(random)
            taken.append(self._drive(env, act, first))
            ends.append(self.states())
        taken.append(collecting)
        if not all(np.array_equal(other, end) for other in ends):
            raise RuntimeError("a part of training moved the robots in another way")
        parts = np.diff(taken) / self.steps
        return dict(zip(PARTS, parts.tolist(), strict=True))

    @torch.no_grad()
    def _drive(
        self,
        env: EnvBase,
        act: Callable[[TensorDictBase], TensorDictBase],
        current: TensorDictBase,
    ) -> float:
        """The time of the steps of a batch (s)."""
        with set_exploration_type(ExplorationType.RANDOM):
            started = time.perf_counter()
            for _ in range(self.steps):
                _, current = env.step_and_maybe_reset(act(current))
            return time.perf_counter() - started

    def close(self) -> None:
        self._collector.shutdown()


def controls(batch: TensorDictBase) -> np.ndarray:
    """A batch's actions as MuJoCo clips them, shape ``(steps, num_envs, nu)``."""
    return batch["action"].transpose(0, 1).to(torch.float64).contiguous().numpy()


def _replayed(batch: TensorDictBase) -> Callable[[TensorDictBase], TensorDictBase]:
    actions = iter(batch["action"].unbind(1))
    return lambda current: current.set("action", next(actions))


class CollectorSide:
    """Our side of a comparison in a process of its own: a batch a step, with the policy.

    Args:
        num_envs: robots.
        steps: control steps of each robot in a batch.
        learn: whether the learner learns from each batch.
        overrides: further keys of the configuration.
    """

    def __init__(self, num_envs: int, steps: int, learn: bool, *overrides: str) -> None:
        self._quiet = contextlib.ExitStack()
        self._quiet.enter_context(quiet())
        self._training = Training(num_envs, steps, *overrides)
        self._learn = learn

    def step(self) -> int:
        # As in training's loop, the last batch is still there while the next is collected.
        self._batch, _ = self._training.collect()
        if self._learn:
            self._training.update(self._batch)
        return self._training.frames

    def close(self) -> None:
        self._training.close()
        self._quiet.close()
