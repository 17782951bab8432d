"""The training loop: collect, learn, record, save, stop."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from itertools import islice
from pathlib import Path

import torch
from torchrl.envs import EnvBase, Transform

from locomotion.agents.architectures import Network
from locomotion.agents.base import Learner
from locomotion.config import Config
from locomotion.runs.interruption import StopRequest
from locomotion.runs.recorder import Recorder
from locomotion.training.build import make_collector, make_env, make_learner

#: Called after each iteration with its row of metrics.
Callback = Callable[[Mapping[str, float]], object]


def train(
    config: Config,
    folder: Path,
    *,
    env: EnvBase | None = None,
    transforms: Sequence[Transform] = (),
    in_keys: Sequence[str] | None = None,
    network: Network | None = None,
    learner: Callable[[EnvBase], Learner] | None = None,
    callbacks: Sequence[Callback] = (),
) -> None:
    """Trains a policy, and leaves metrics and checkpoints in a folder.

    A run that was interrupted resumes from its last checkpoint, and ends as if it never had been.

    Args:
        config: the run.
        folder: where its output goes; it exists, and holds no run of another configuration.
        env: an environment in place of the one that is described; it is left open. A run with it resumes
            bit for bit if its ``state_dict()`` holds all that its next step depends on.
        transforms: more transforms, after those that write the observations.
        in_keys: the entries that the policy sees, in place of those of ``config.obs``.
        network: an architecture in place of the one that is described.
        learner: makes the learner for an environment, in place of the one that is described.
        callbacks: called after each iteration.

    Raises:
        RunError: if what is there cannot be resumed.
        RunStopped: if the run cannot go on.
        KeyboardInterrupt: if it was asked to stop, with the iteration it stopped after; it is saved.
    """
    torch.manual_seed(config.seed)
    environment = make_env(config, env, transforms, network)
    if learner is None:
        learned = make_learner(config, environment, in_keys, network)
    else:
        learned = learner(environment)
    run = Recorder(config, folder, environment, learned)
    collector = make_collector(environment, learned, config.learner.steps)
    with run, StopRequest() as stop, ExitStack() as after:
        if env is None:  # one that was passed is left open
            after.callback(environment.close)
        after.callback(collector.shutdown, close_env=False)
        for batch in islice(collector, config.learner.iterations - run.completed):
            collected = time.perf_counter()
            try:
                metrics = learned.update(batch)
            except FloatingPointError as error:
                raise run.explain(error) from error
            collector.update_policy_weights_()
            row = run.record(batch, metrics, collected)
            for callback in callbacks:
                callback(row)
            run.save_if_due(stopping=stop.received)
            if stop.received and not run.finished:
                done = f"stopped after {run.completed} iterations; resume={folder} continues"
                raise KeyboardInterrupt(done)
