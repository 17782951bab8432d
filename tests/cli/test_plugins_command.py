"""Choices of somebody else's, from modules named on the command line and from installed packages."""

import json
import textwrap

import pytest

pytestmark = pytest.mark.slow

PLUGIN = textwrap.dedent(
    '''
    """Adds a choice of every kind; leaves a file where it is imported."""

    import dataclasses
    from pathlib import Path

    from locomotion.agents.architectures import MLP
    from locomotion.agents.learners import PPOConfig
    from locomotion.arenas.choices import GroundConfig
    from locomotion.envs.readings import Reading
    from locomotion.options import arenas, key, learners, networks, readings, rewards
    from locomotion.tasks.rewards import Reward

    Path("imported").touch()

    speed = Reading(
        lambda task: 1, "m/s", "speed of the core", lambda s: s.field("qvel")[:, :3].norm(dim=-1, keepdim=True)
    )


    @dataclasses.dataclass
    class Constant(Reward):
        """The same in every step."""

        pay: float = key("how much", default=1.0)

        def __call__(self, before, after):
            return after.xy[:, 0] * 0 + self.pay


    @dataclasses.dataclass
    class Ice(GroundConfig):
        """An endless plane that is slippery."""

        grip: float = key("factor on friction", default=0.1, least=0)

        def make(self, friction):
            return super().make(friction * self.grip)


    @dataclasses.dataclass
    class Narrow(MLP):
        """A small network."""

        width: int = key("width of each observation's own layer", default=3, least=1)


    @dataclasses.dataclass
    class Lazy(PPOConfig):
        """PPO that looks once at what was collected."""

        PREFIX = "lazy."
        epochs: int = key("passes over the data", default=1, least=1)
    '''
)
REGISTRATION = textwrap.dedent(
    """
    readings.register("core_speed")(speed)
    rewards.register("constant")(Constant)
    arenas.register("ice")(Ice)
    networks.register("narrow")(Narrow)
    learners.register("lazy")(Lazy)
    """
)
ENTRY_POINTS = textwrap.dedent(
    """
    [locomotion.readings]
    core_speed = my_gaits:speed
    [locomotion.rewards]
    constant = my_gaits:Constant
    [locomotion.arenas]
    ice = my_gaits:Ice
    [locomotion.networks]
    narrow = my_gaits:Narrow
    [locomotion.learners]
    lazy = my_gaits:Lazy
    """
)
CHOICES = ["obs.core_speed.steps=2", "task.rewards.constant.pay=0.25", "~task.rewards.distance"]
CHOICES += ["arena.name=ice", "arena.grip=0.5", "network.name=narrow", "network.hidden=[4]"]
CHOICES += ["algorithm=lazy", "lazy.steps=4", "lazy.minibatch_size=6", "lazy.iterations=2"]
CHOICES += ["env.num_envs=3", "--config-dir=mine", "hydra.run.dir=run"]


@pytest.fixture
def gaits(write, stick):
    """Writes the package, as an installed one or as one that a user names; returns the overrides."""

    def made(how):
        if how == "installed":
            write("site/my_gaits.py", PLUGIN)
            write("site/my_gaits-1.dist-info/entry_points.txt", ENTRY_POINTS)
            write(
                "site/my_gaits-1.dist-info/METADATA",
                "Metadata-Version: 2.1\nName: my_gaits\nVersion: 1\n",
            )
        else:
            write("site/my_gaits.py", PLUGIN + REGISTRATION)
        write("mine/algorithm/lazy.yaml", "# @package _global_\nalgorithm: lazy\n")
        write("mine/robot/stick.yaml", stick)
        return [] if how == "installed" else ["+plugins=[my_gaits]"]

    return made


@pytest.mark.parametrize("how", ["named", "installed"])
def test_they_train_resume_and_walk(how, gaits, command, tmp_path):
    plugins = gaits(how)

    def run(name, *arguments):
        result = command(name, *plugins, *arguments, cwd=tmp_path, path=tmp_path / "site")
        assert result.returncode == 0, result.stderr
        return result.stdout

    run("train", "robot=stick", *CHOICES)
    lines = (tmp_path / "run" / "metrics.csv").read_text().splitlines()
    assert len(lines) == 3
    assert [float(line.split(",")[2]) for line in lines[1:]] == [0.25, 0.25]
    run("train", "resume=run", "lazy.iterations=3")
    assert (tmp_path / "run" / "metrics.csv").read_text().splitlines()[:3] == lines
    found = json.loads(run("evaluate", "run=run", "seconds=1", "json=true"))
    assert found["robots"] == 64
    shown = run("train", "--help")
    for words in (
        "core_speed ",
        "speed of the core (m/s)",
        "lazy.epochs",
        "constant ",
        "arena.grip",
    ):
        assert words in shown


def test_they_can_be_swept_side_by_side(gaits, command, tmp_path):
    arguments = [*gaits("named"), "--multirun", "robot=stick", *CHOICES, "seed=0,1"]
    arguments += ["hydra/launcher=parallel", "physics.threads=1", "hydra.sweep.dir=sweep"]
    result = command("train", *arguments, cwd=tmp_path, path=tmp_path / "site")
    assert result.returncode == 0, result.stderr
    assert sorted(path.parent.name for path in tmp_path.glob("sweep/*/metrics.csv")) == ["0", "1"]


def test_a_run_folder_never_has_them_imported(gaits, command, tmp_path):
    plugins = gaits("named")
    trained = command(
        "train", *plugins, "robot=stick", *CHOICES, cwd=tmp_path, path=tmp_path / "site"
    )
    assert trained.returncode == 0, trained.stderr
    assert "my_gaits" in (tmp_path / "run" / ".hydra" / "config.yaml").read_text()
    (tmp_path / "imported").unlink()
    for name, argument in {
        "train": "resume=run",
        "evaluate": "run=run",
        "export": "run=run",
    }.items():
        result = command(name, argument, cwd=tmp_path, path=tmp_path / "site")
        assert result.returncode == 2
        assert result.stderr.startswith("error: algorithm=lazy is unknown; choose from cpg, ppo")
        assert result.stderr.count("\n") == 1
    plotted = command("plot", "run", cwd=tmp_path, path=tmp_path / "site")
    assert plotted.returncode == 0, plotted.stderr
    assert not (tmp_path / "imported").exists()


def test_one_that_is_broken_is_named(gaits, refusal, command, write, tmp_path):
    gaits("installed")
    write("site/my_gaits.py", "import no_such_module")
    result = command("train", cwd=tmp_path, path=tmp_path / "site")
    assert result.returncode == 2
    assert result.stderr == (
        "error: the learner lazy of my_gaits:Lazy cannot be loaded:"
        " ModuleNotFoundError: No module named 'no_such_module'\n"
    )
