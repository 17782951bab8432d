"""Shows all bodies that were trained: a page with film, speed, work and the weakest row of the reality check.

``python -m reproduction.gallery SWEEP`` walks the policy of each run with its mean action and writes
``docs/gallery``: a film of each, ``gallery.csv`` and ``README.md``, which is the page. A CSV file in place of a sweep
writes the page again. The sweep comes first::

    python -m locomotion.train --multirun 'robot=glob(*,exclude=random)' +experiment=robust seed=0 \\
        physics.self_collision=true physics.threads=1 hydra/launcher=parallel hydra.sweep.dir=sweeps/gallery
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from tqdm import tqdm

from locomotion.cli.refusal import refusing
from locomotion.disturbances.options import DEFAULTS
from locomotion.options import ConfigError
from locomotion.quiet import quiet
from locomotion.writing import atomic_write
from reproduction.claims import table
from reproduction.rows import gather
from reproduction.runs import load_config, walking_config

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
NUM_ENVS, SECONDS, FILM_SECONDS = 32, 10.0, 6.0
WIDTH, HEIGHT, FPS = 256, 160, 8
#: Films in a row of the page.
_COLUMNS = 3
_INTRODUCTION = (
    f"One seed each, `physics.self_collision=true`. Speed is over the first {SECONDS:g} s, of {NUM_ENVS} robots with the"
    " policy's mean action; work is that of all hinges, either way."
)


@dataclasses.dataclass(frozen=True)
class Row:
    """A body and its gait.

    Attributes:
        robot: its name.
        hinges: how many it has.
        speed: over the first 10 s from the pose that training starts in (m/s).
        work: per metre (J/m).
        weakest: the change that takes most of its speed, as an override; empty if it was not checked.
        share: of its speed that it keeps then; nan likewise.
        film: file name of the film; empty where none could be drawn.
        disturbed: 1 if it was trained under disturbances, else 0.
    """

    robot: str
    hinges: int
    speed: float
    work: float
    weakest: str
    share: float
    film: str
    disturbed: int


def evaluate(run: Path, folder: Path, check: bool, progress: Callable[[], object]) -> Row:
    """Walks with a run's policy, under each change too if it is to be checked, and films it."""
    from locomotion.evaluation import check_robustness, make_runner, measure, walk

    config = walking_config(run, NUM_ENVS)
    runner = make_runner(run, config)
    values = measure(walk(runner, SECONDS, effort=True, progress=progress))
    hinges = len(runner.base_env.hinge_names)
    runner.env.close()
    checked = (
        list(check_robustness(run, config, SECONDS, values["speed"], progress)) if check else []
    )
    weakest = min(checked, key=lambda row: row.share.mean, default=None)
    return Row(
        robot=config.robot.name,
        hinges=hinges,
        speed=values["speed"].nan_to_num(0.0).mean().item(),
        work=values["work_per_metre"].nanmean().item(),
        weakest=weakest.override if weakest else "",
        share=weakest.share.mean if weakest else math.nan,
        disturbed=int(any(map(load_config(run).disturbances.active, DEFAULTS))),
        film=_film(run, folder / f"{config.robot.name}.webp"),
    )


def _film(run: Path, path: Path) -> str:
    from locomotion.evaluation import make_runner
    from locomotion.rendering import record_motion, write_film

    runner = make_runner(run, walking_config(run, 1))
    motion = record_motion(runner, FILM_SECONDS, FPS)
    runner.env.close()
    try:
        write_film(motion, path, WIDTH, HEIGHT)
    except ConfigError as error:  # the rest of the page needs nothing to draw with
        tqdm.write(f"no film of {path.stem}: {error}")
        return ""
    return path.name


def page(rows: Sequence[Row]) -> str:
    """The page, in Markdown."""
    ordered = sorted(rows, key=lambda row: row.robot)
    lines = [
        "# Gallery",
        "",
        _INTRODUCTION,
        "",
        "<table>",
    ]
    for start in range(0, len(ordered), _COLUMNS):
        lines.append("<tr>")
        for row in ordered[start : start + _COLUMNS]:
            film = (
                f'<img src="{row.film}" width="{WIDTH}" alt="{row.robot}"><br>' if row.film else ""
            )
            lines.append(f"<td>{film}<b>{row.robot}</b>, {row.speed:.2f} m/s</td>")
        lines.append("</tr>")
    lines += ["</table>", ""]
    # Weakest is the row of the reality check that takes most of the speed.
    checked = any(row.weakest for row in rows)
    head = ["robot", "hinges", "trained under disturbances", "speed (m/s)", "work (J/m)"]
    head += ["weakest under", "keeps"] if checked else []
    body = [
        [
            *(row.robot, str(row.hinges), "yes" if row.disturbed else ""),
            *(f"{row.speed:.2f}", f"{row.work:.1f}"),
            *((f"`{row.weakest}`", f"{row.share:.0%}") if checked else ()),
        ]
        for row in ordered
    ]
    lines += [*table(head, body), ""]
    speeds = [row.speed for row in rows]
    lines.append(f"Mean {sum(speeds) / len(speeds):.2f} m/s, slowest {min(speeds):.2f} m/s.")
    return "\n".join([*lines, ""])


def _measured(runs: Sequence[Path], folder: Path, check: bool) -> Iterator[Row]:
    with tqdm(desc="control steps", unit="step", disable=None) as bar:
        for run in runs:
            yield evaluate(run, folder, check, bar.update)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m reproduction.gallery",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("sources", nargs="+", type=Path, metavar="SWEEP")
    parser.add_argument(
        "--no-check", action="store_false", dest="check", help="without the reality check"
    )
    parser.add_argument("--output", type=Path, default=GALLERY, metavar="FOLDER")
    arguments = parser.parse_args()
    folder = arguments.output
    with refusing(), quiet():
        folder.mkdir(parents=True, exist_ok=True)
        rows = gather(
            Row,
            arguments.sources,
            lambda runs: _measured(runs, folder, arguments.check),
            folder / "gallery.csv",
        )
        with atomic_write(folder / "README.md") as partial:
            partial.write_text(page(rows), encoding="utf-8")
    print(folder / "README.md")


if __name__ == "__main__":
    main()
