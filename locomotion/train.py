"""Learns a gait: ``python -m locomotion.train robot=gecko +obs=history3``.

A plain loop over TorchRL's parts: environment, policy, collector, advantage, loss, optimiser. TorchRL
0.14's ``PPOTrainer`` was tried in its place. It learns alike, but it is marked experimental, estimates
the advantage anew in every epoch, writes no row an iteration and no mean value without hooks of our
own, and takes as many lines to wire up as this loop takes to read.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from multiprocessing import parent_process
from pathlib import Path
from typing import TYPE_CHECKING

from locomotion.command_line.quiet import quiet
from locomotion.command_line.training import launch
from locomotion.config import Config
from locomotion.runs import RunError, RunStopped
from locomotion.runs.interruption import WishToStop

if TYPE_CHECKING:
    from torchrl.collectors import Collector
    from torchrl.envs import TransformedEnv
    from torchrl.modules import ProbabilisticActor

    from locomotion.runs.loggers import RunLogger


def train(config: Config, folder: Path) -> None:
    """Trains a policy and leaves metrics, checkpoints and a learning curve in a folder.

    A run that was interrupted goes on from its last checkpoint, and ends as if it never had been.

    Args:
        config: the run.
        folder: where its output goes; must exist, and hold no run of another configuration.

    Raises:
        RunError: if what is there cannot be gone on from.
        RunStopped: if the run cannot go on.
        KeyboardInterrupt: if it was asked to stop, with the iteration it stopped after; it is saved.
    """
    # Importing these takes seconds, so they wait until the configuration has been checked.
    quiet()
    import torch
    from torchrl.checkpoint import GlobalRNGState
    from tqdm import tqdm

    from locomotion.agents import PPO, make_critic
    from locomotion.assembly import make_env, make_policy, policy_keys
    from locomotion.plots import plot_learning_curves, read_run
    from locomotion.runs.checkpoints import Checkpoints, saved
    from locomotion.runs.loggers import open_logger
    from locomotion.runs.metrics import MetricsWriter, save_divergences

    torch.manual_seed(config.seed)
    env = make_env(config)
    actor = make_policy(config, env)
    critic = make_critic(env.observation_spec, policy_keys(config)).to(config.physics.device)
    frames = config.env.num_envs * config.ppo.steps
    collector = make_collector(config, env, actor)
    ppo = PPO(actor, critic, env.action_spec.shape[-1], frames, config.ppo)
    checkpoints = Checkpoints(
        folder,
        actor=actor,
        critic=critic,
        ppo=ppo,
        robots=env.base_env,
        transforms=env.transform,
        collector=collector,
        random=GlobalRNGState(),
    )
    checkpoints.remove_partial()
    completed = checkpoints.load_latest()
    env.base_env.take_divergences()  # of starts that a checkpoint has replaced
    metrics = MetricsWriter(folder, completed)
    logger = open_logger(folder, config, completed * frames)

    # No bar without a terminal, nor beside other jobs, whose bars would write over one another.
    progress = tqdm(
        total=config.ppo.iterations,
        initial=completed,
        desc=config.robot.name,
        unit="iteration",
        disable=True if parent_process() is not None else None,
    )
    with progress, WishToStop() as wish:
        started = time.perf_counter()
        for batch in collector:
            collected = time.perf_counter()
            learning_rate = ppo.actor_lr
            try:
                losses = ppo.update(batch)
            except FloatingPointError as error:
                last = (saved(folder) or ["none"])[-1]
                raise RunStopped(
                    f"{error} in iteration {completed}; the last good checkpoint is {last}"
                ) from error
            collector.update_policy_weights_()
            finished = time.perf_counter()
            divergences = env.base_env.take_divergences()
            if divergences:
                path = save_divergences(folder, completed, divergences)
                progress.write(f"simulations diverged: {path}")
            mean_reward = batch["next", "reward"].mean().item()
            row = {
                "iteration": completed,
                "frames": (completed + 1) * frames,
                "mean_reward": mean_reward,
                "mean_value": batch["state_value"].mean().item(),
                **{name: value.item() for name, value in losses.items()},
                "actor_lr": learning_rate,
                "diverged": batch["next", "terminated"].sum().item(),
                "collect_seconds": collected - started,
                "update_seconds": finished - collected,
            }
            metrics.write(row)
            if logger is not None:
                logger.log(row)
            fps = frames / (finished - started)
            progress.set_postfix(reward=f"{mean_reward:.4f} m", fps=f"{fps:.0f}", refresh=False)
            progress.update()
            completed += 1
            over = completed == config.ppo.iterations
            if completed % config.checkpoint_interval == 0 or over or wish.came:
                metrics.sync()
                if logger is not None:
                    logger.flush()
                checkpoints.save(completed)
            if wish.came and not over:
                raise KeyboardInterrupt(
                    f"stopped after {completed} iterations; resume={folder} goes on"
                )
            started = time.perf_counter()
    metrics.close()
    collector.shutdown()
    if logger is not None:
        if config.logger.video_seconds:
            _film(config, folder, logger, completed * frames)
        logger.close()
    try:
        plot_learning_curves(folder, folder / "learning_curve.png")
    except RunError as error:
        raise RunStopped(str(error)) from error
    mean_reward = read_run(folder).mean_reward[-10:].mean()
    print(f"{folder}: {mean_reward:.4f} m per action in the last ten iterations", flush=True)


def _film(config: Config, folder: Path, logger: RunLogger, frames: int) -> None:
    """Films the trained policy for a logger; where nothing can be drawn it says so, and the run is whole.

    In a process of its own, as drawing depends on what MuJoCo is told before it is imported.
    """
    film = folder / f"gait{logger.film_ending}"
    options = [f"seconds={config.logger.video_seconds}", "width=480", "height=270", "fps=10"]
    command = [sys.executable, "-m", "locomotion.watch"]
    paths = [f"{key}={json.dumps(str(path))}" for key, path in (("run", folder), ("output", film))]
    watched = subprocess.run([*command, *paths, *options], capture_output=True, text=True)
    if watched.returncode == 0:
        logger.log_film(film, frames)
    else:
        reason = (watched.stderr.splitlines() or ["it ended without a word"])[-1]
        print(f"warning: {folder}: no film of the gait; {reason}", file=sys.stderr)


def make_collector(config: Config, env: TransformedEnv, actor: ProbabilisticActor) -> Collector:
    """Collects ``ppo.steps`` control steps of all robots at a time, until the run is over."""
    from locomotion.agents import RolloutCollector

    return RolloutCollector(env, actor, config.ppo.steps, config.ppo.iterations)


if __name__ == "__main__":
    launch(train)
