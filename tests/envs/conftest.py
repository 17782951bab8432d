import pytest

from locomotion.envs import LocomotionEnv


@pytest.fixture(scope="session")
def make(stepping):
    """Makes an environment on what can step robots, with the same random starts every time."""

    def make(num_envs, task="gecko", *, physics=None, seed=0, **keywords):
        physics = {**stepping, **(physics or {})}
        return LocomotionEnv(task, num_envs, physics=physics, seed=seed, **keywords)

    return make
