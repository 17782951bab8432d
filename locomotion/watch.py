"""Shows how a policy walks: ``python -m locomotion.watch robot=gecko`` or ``run=FOLDER``."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import TYPE_CHECKING

from locomotion.cli.policies import Command
from locomotion.config import Config
from locomotion.options import ConfigError
from locomotion.rendering.graphics import has_screen, open_context
from locomotion.rendering.options import WatchConfig

if TYPE_CHECKING:
    from locomotion.rendering.motion import Motion

_EXAMPLES = """\
  python -m locomotion.watch                          the gecko that ships: gecko.mp4, gecko.webp
  python -m locomotion.watch robot=ant web=true       a page for the browser: ant.html
  python -m locomotion.watch run=outputs/DATE/TIME seconds=30 output=gait.mp4
  python -m locomotion.watch live=true physics.self_collision=true disturbances.push=0.5"""


def watch(run: Path, config: Config, options: WatchConfig) -> None:
    """Shows one robot that walks with a run's policy, and prints the files it wrote.

    Args:
        run: folder of the run whose policy walks.
        config: the task it walks in.
        options: what to show, and where.

    Raises:
        RunError: if the run holds no checkpoint that can be read.
    """
    from tqdm import tqdm

    from locomotion.evaluation import make_runner
    from locomotion.rendering.motion import record_motion

    runner = make_runner(run, config)
    if options.live:
        from locomotion.rendering.live import show_live

        show_live(runner, options.seconds, options.sampled)
        runner.env.close()
        return
    motion = record_motion(runner, options.seconds, options.fps, options.sampled)
    runner.env.close()
    ending = ".html" if options.web else ".mp4"
    target = Path(options.output or f"{config.robot.name}{ending}")
    # No bar without a terminal.
    with tqdm(total=len(motion.qpos), desc=str(target), unit="picture", disable=None) as bar:
        if options.web:
            from locomotion.rendering.page import write_page

            write_page(motion, target, bar.update)
            files = [target]
        else:
            from locomotion.rendering.film import write_film

            files = write_film(motion, target, options.width, options.height, bar.update)
    print(f"{config.robot.name} {_outcome(motion)}: {', '.join(map(str, files))}")


def _outcome(motion: Motion) -> str:
    if math.isnan(motion.distance):
        return "diverged"
    how_far = f"{motion.distance:.2f} m from its start in {motion.seconds:g} s"
    return f"walks {how_far}, {motion.speed:.2f} m/s"


def require(options: WatchConfig) -> None:
    """Raises a :class:`ConfigError` if this machine cannot show what is asked for."""
    if options.live and not has_screen():
        raise ConfigError("live=true needs a screen; a film or web=true does not")
    if options.web and importlib.util.find_spec("viser") is None:
        raise ConfigError("web=true needs a package: pip install 'viser>=1.1'")
    if not options.web and not options.live:
        open_context(options.width, options.height).free()


COMMAND = Command(
    WatchConfig, watch, "Shows how a policy walks.", _EXAMPLES, num_envs=1, check=require
)

if __name__ == "__main__":
    COMMAND.main()
