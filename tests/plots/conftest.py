import matplotlib.colors
import numpy as np
import pytest

from locomotion import compose
from locomotion.config import as_dict
from locomotion.plots import Curve
from locomotion.runs import record


@pytest.fixture(scope="session")
def curve():
    """Makes a curve of some rewards."""

    def made(robot="gecko", observations="hinges", seed=0, rewards=(0.0, 0.1), values=None):
        rewards = np.array(rewards)
        values = 80 * rewards if values is None else np.array(values)
        return Curve(robot, observations, seed, np.arange(len(rewards)), rewards, values)

    return made


@pytest.fixture(scope="session")
def make_run():
    """Leaves a run's configuration and metrics in a folder."""

    def made(folder, *overrides, rewards=(0.0, 0.1)):
        record(folder, config=as_dict(compose(*overrides)))
        rows = [f"{i},{(i + 1) * 64},{reward},{80 * reward}\n" for i, reward in enumerate(rewards)]
        (folder / "metrics.csv").write_text(
            "".join(["iteration,frames,mean_reward,mean_value\n", *rows])
        )

    return made


@pytest.fixture(scope="session")
def lines():
    """Finds the curves of a colour in a panel, thick ones only unless a width is given."""

    def found(axes, colour, style="-", width=None):
        return [
            line.get_ydata()
            for line in axes.lines
            if matplotlib.colors.same_color(line.get_color(), colour)
            and line.get_linestyle() == style
            and (line.get_linewidth() > 1 if width is None else line.get_linewidth() == width)
        ]

    return found
