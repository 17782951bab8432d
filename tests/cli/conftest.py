import signal
import sys

import pytest

from locomotion.cli import training


@pytest.fixture
def refusal(monkeypatch, capsys):
    """Gives the line with which ``python -m locomotion.train`` refuses its arguments."""

    def refused(*arguments):
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        monkeypatch.setattr(sys, "argv", ["train", *map(str, arguments)])
        try:
            with pytest.raises(SystemExit) as ended:
                training.main()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
        printed = capsys.readouterr()
        assert ended.value.code == 2
        assert printed.out == ""
        assert printed.err.startswith("error: ")
        assert printed.err.count("\n") == 1
        return printed.err.removeprefix("error: ").rstrip()

    return refused


@pytest.fixture(scope="session")
def small():
    """Overrides of a run that takes seconds."""
    return ["env.num_envs=3", "ppo.steps=4", "ppo.minibatch_size=6", "ppo.iterations=2"]


@pytest.fixture
def write(tmp_path):
    """Writes text into a file below the test's folder, and returns its path."""

    def written(name, text):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    return written


@pytest.fixture(scope="session")
def stick():
    """The YAML of a body with one hinge."""
    return "name: stick\nbody: {module: core, children: {left: {module: hinge}}}\n"
