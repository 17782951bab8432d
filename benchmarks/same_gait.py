"""How fast a trained gait is without what makes the physics step cheap.

``python -m benchmarks.same_gait RUN`` walks the policy of a run's last checkpoint under three compiled
models of its robot: the one that training steps, the same with MuJoCo's search for contacts, warm
start and islands back in place, and that with every module a body of its own. What differs between
them is how contacts are found and how stiff they are, so a gait should be as fast under each.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import torch

from benchmarks.ours import plain_model
from locomotion.assembly import make_env
from locomotion.config import Config, ConfigError, typed
from locomotion.gaits import load_policy
from locomotion.physics import ThreadedPhysics
from locomotion.runs import RunError, read_config

NUM_ENVS, STEPS, WARM_UP = 256, 400, 50


def walk(run: Path, config: Config, fused: bool | None) -> tuple[float, float]:
    """Mean reward per control step (m) of many robots, and its standard error.

    Args:
        run: the run's folder, whose last checkpoint's policy walks.
        config: the run's configuration.
        fused: with every module a body of its own or not, both without what training leaves out;
            ``None`` takes the model that training steps.
    """
    torch.manual_seed(0)
    config.env.num_envs = NUM_ENVS
    env = make_env(config)
    if fused is not None:
        inner = env.base_env
        model = plain_model(inner.task, fused)
        inner._physics = ThreadedPhysics(model, NUM_ENVS, config.physics.threads)
    actor = load_policy(run, config, env)
    with torch.no_grad():
        reward = env.rollout(STEPS, actor)["next", "reward"]
    speeds = reward[:, WARM_UP:].mean((1, 2))
    return speeds.mean().item(), speeds.std().item() / NUM_ENVS**0.5


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.same_gait", description=__doc__)
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a finished run")
    run = parser.parse_args().run
    try:
        config = typed(Config, read_config(run))
        shipped, deviation = walk(run, config, None)
    except (ConfigError, RunError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(f"{config.robot.name}: {shipped:.4f} ± {deviation:.4f} m a step as trained")
    for fused, name in ((True, "plain contacts"), (False, "plain contacts, nothing fused")):
        speed, deviation = walk(run, config, fused)
        print(f"{name}: {speed:.4f} ± {deviation:.4f} m, as trained / this {shipped / speed:.3f}")


if __name__ == "__main__":
    main()
