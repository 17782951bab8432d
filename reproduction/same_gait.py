"""Speed of a trained gait without what makes the physics step cheap.

``python -m reproduction.same_gait RUN`` walks the policy of a run's last checkpoint under three compiled
models of its robot: the one that training steps, the same with MuJoCo's search for contacts, warm
start and islands back in place, and that with every module a body of its own. What differs between
them is how contacts are found and how stiff they are, so a gait should be as fast under each.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from locomotion.cli.refusal import refusing
from locomotion.config import Config
from locomotion.quiet import quiet
from reproduction.runs import walking_config

NUM_ENVS, STEPS, WARM_UP = 256, 400, 50


def walk(run: Path, config: Config, steps: int, fused: bool | None) -> tuple[float, float]:
    """Mean reward per control step (m) of many robots, and its standard error.

    Args:
        run: the run's folder, whose last checkpoint's policy walks.
        config: the run's configuration.
        steps: control steps, before which there are :data:`WARM_UP` that do not count.
        fused: with every module a body of its own or not, both without what training leaves out;
            ``None`` takes the model that training steps.
    """
    import torch

    from benchmarks.plain import undo_savings
    from locomotion.envs import LocomotionEnv, make_task
    from locomotion.evaluation import load_policy
    from locomotion.training.build import make_env

    torch.manual_seed(0)
    task = make_task(config.robot, config.arena, config.task, config.env, config.physics)
    if fused is not None:
        undo_savings(task, fused)
    readings = dict.fromkeys(term.reading_of(name) for name, term in config.obs.items())
    base = LocomotionEnv(
        task,
        config.env.num_envs,
        readings=list(readings),
        physics=config.physics,
        seed=config.seed,
    )
    env = make_env(config, base)
    policy = load_policy(run, config, env)
    with torch.no_grad():
        reward = env.rollout(WARM_UP + steps, policy, break_when_any_done=False)["next", "reward"]
    env.close()
    speeds = reward[:, WARM_UP:].mean((1, 2))
    return speeds.mean().item(), speeds.std().item() / len(speeds) ** 0.5


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m reproduction.same_gait", description=__doc__)
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a finished run")
    parser.add_argument("--robots", type=int, default=NUM_ENVS, metavar="NUMBER")
    parser.add_argument("--steps", type=int, default=STEPS, help="control steps that they walk")
    arguments = parser.parse_args()
    run, steps = arguments.run, arguments.steps
    with refusing(), quiet():
        config = walking_config(run, arguments.robots)
        trained, deviation = walk(run, config, steps, None)
        print(f"{config.robot.name}: {trained:.4f} ± {deviation:.4f} m a step as trained")
        for fused, name in ((True, "plain contacts"), (False, "plain contacts, nothing fused")):
            speed, deviation = walk(run, config, steps, fused)
            ratio = f"as trained / this {trained / speed:.3f}"
            print(f"{name}: {speed:.4f} ± {deviation:.4f} m, {ratio}")


if __name__ == "__main__":
    main()
