"""Numbers of numpy, and whole numbers with a point, where numbers of Python are meant."""

import dataclasses
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from locomotion.envs import LocomotionEnv
from locomotion.options import Checked, ConfigError, key, typed
from locomotion.tasks.options import substeps


@dataclasses.dataclass
class Part(Checked):
    PREFIX = "part."
    count: int = key("how many", default=1, least=1)


@dataclasses.dataclass
class Options(Checked):
    PREFIX = "toy."
    count: int = key("how many", default=1, least=0, most=9)
    limit: int | None = key("at most", default=None)
    length: float = key("how long", default=1.0)
    sizes: list[int] = key("of its parts", default=[1])
    on: bool = key("whether it is on", default=False)
    free: dict[str, Any] = key("anything", default={})
    part: Part = dataclasses.field(default_factory=Part)


kinds = st.sampled_from([int, float, np.int64, np.uint8, np.float32, np.float64])


@given(st.integers(0, 9), kinds)
def test_a_whole_number_of_any_kind_is_an_integer(number, kind):
    made = typed(
        Options,
        {
            "count": kind(number),
            "limit": kind(number),
            "length": kind(number),
            "sizes": [kind(number)],
            "part": {"count": kind(number + 1)},
            "free": {"in": [{"it": kind(number)}]},
        },
    )
    assert made == Options(
        number,
        number,
        float(number),
        [number],
        free={"in": [{"it": number}]},
        part=Part(number + 1),
    )
    for value in (made.count, made.limit, *made.sizes, made.part.count):
        assert type(value) is int
    assert type(made.length) is float
    assert type(made.free["in"][0]["it"]) in (int, float)


@pytest.mark.parametrize("kind", [float, np.float32, np.float64])
@pytest.mark.parametrize("name", ["count", "limit"])
def test_a_number_that_is_not_whole_is_refused(name, kind):
    with pytest.raises(ConfigError, match=f"^toy.{name}: Value '2.5' of type 'float'"):
        typed(Options, {name: kind(2.5)})


def test_ranges_hold_for_numbers_of_numpy():
    with pytest.raises(ConfigError, match="^toy.count=10 must be at least 0 and at most 9"):
        typed(Options, {"count": np.int64(10)})
    with pytest.raises(ConfigError, match="^toy.count=10 must be at least 0 and at most 9"):
        Options(count=np.int64(10))
    assert typed(Options, {"on": np.bool_(True)}).on is True


@pytest.mark.parametrize("number", [np.int64(3), np.float32(3), 3.0])
def test_an_environment_takes_numbers_of_numpy(number):
    env = LocomotionEnv("gecko", num_envs=number)
    assert env.batch_size == (3,)
    env.close()


@given(st.floats(0.01, 1000), st.floats(1e-4, 0.1))
def test_the_timestep_that_is_named_fits(frequency, timestep):
    try:
        substeps(frequency, timestep)
    except ConfigError as error:
        told = re.fullmatch(r"physics.timestep=.* must divide .*; (\S+) does", str(error))
        assert told, error
        substeps(frequency, float(told[1]))
