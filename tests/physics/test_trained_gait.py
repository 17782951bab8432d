"""A policy that was trained walks as fast on whatever steps the robots."""

import pytest

from locomotion.config import typed_config
from locomotion.evaluation import make_runner, measure, walk
from locomotion.evaluation.shipped import POLICIES
from locomotion.runs import read_config

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def speed():
    """Mean speed (m/s) of 64 geckos with the bundled policy, after they have got going."""

    def speed(**physics):
        content = read_config(POLICIES / "gecko")
        content["env"] |= {"num_envs": 64, "time_limit": None}
        content["disturbances"] = {}
        content["physics"].update(physics)
        runner = make_runner(POLICIES / "gecko", typed_config(content, learning=False))
        return measure(walk(runner, 15.0))["speed"].mean().item()

    return speed


def test_it_is_as_fast(speed, stepping):
    if stepping["backend"] == "threaded":
        pytest.skip("it is what the others are compared with")
    expected = speed(threads=1)
    assert expected > 0.15  # a standard error is 0.5%
    assert speed(**stepping) == pytest.approx(expected, rel=0.03)
