"""Options that check themselves: ranges, types, and one line about what is wrong."""

import dataclasses
import enum
import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from locomotion.options import Checked, ConfigError, described, flat, key, summary, typed


class Colour(enum.Enum):
    red = "red"
    green = "green"


@dataclasses.dataclass
class Inner(Checked):
    PREFIX = "inner."
    size: int = key("how many", default=2, least=1, most=5)


@dataclasses.dataclass
class Options(Checked):
    PREFIX = "toy."
    weight: float = key("how heavy (kg)", above=0, most=10)
    colour: Colour = key("its colour", default=Colour.red)
    sizes: list[int] = key("of its parts", default=[1], least=1)
    label: str | None = key("in words", default=None, free=True)
    hollow: bool = key("whether there is room in it", default=False)
    inner: Inner = dataclasses.field(default_factory=Inner)


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(st.floats(), st.one_of(st.none(), finite), st.one_of(st.none(), finite), st.booleans())
def test_a_number_is_taken_exactly_within_its_limits(value, low, most, includes):
    limits = {"least" if includes else "above": low, "most": most}

    @dataclasses.dataclass
    class Number(Checked):
        value: float = key("any", default=0.0, **limits)

    allowed = math.isfinite(value)
    if low is not None:
        allowed = allowed and (value >= low if includes else value > low)
    if most is not None:
        allowed = allowed and value <= most
    if allowed:
        assert Number(value).value == value
    else:
        with pytest.raises(ConfigError, match=r"^value=\S+ must be "):
            Number(value)


@given(st.lists(st.integers(-3, 3), min_size=1))
def test_every_number_of_a_list_is_checked(sizes):
    assume(sizes)
    if min(sizes) >= 1:
        assert Options(1.0, sizes=sizes).sizes == sizes
    else:
        with pytest.raises(ConfigError, match=r"^toy.sizes=\[.*\] must be at least 1$"):
            Options(1.0, sizes=sizes)


def test_the_later_layer_wins_and_types_are_those_of_the_schema():
    made = typed(Options, {"weight": 1, "colour": "green"}, {"weight": "2", "inner": {"size": 3}})
    assert made == Options(2.0, Colour.green, inner=Inner(3))
    assert isinstance(made.weight, float)
    content = OmegaConf.create({"weight": 3, "label": "${colour}", "colour": "red"})
    assert typed(Options, content).label == "red"


def test_defaults_are_not_shared():
    first, second = Options(1.0), Options(1.0)
    first.sizes.append(2)
    assert second.sizes == Options(1.0).sizes == [1]


@pytest.mark.parametrize(
    ("layer", "message"),
    [
        ({}, "toy.weight is missing"),
        ({"weight": 0}, "toy.weight=0.0 must be above 0 and at most 10"),
        ({"weight": math.nan}, "toy.weight=nan must be above 0 and at most 10"),
        ({"weight": "much"}, "toy.weight: Value 'much' of type 'str' could not be converted"),
        ({"weight": None}, "toy.weight"),
        (
            {"weight": 1, "wait": 2},
            "toy.wait is not a key; did you mean toy.weight? allowed are we",
        ),
        ({"weight": 1, "zzz": 2}, "toy.zzz is not a key; allowed are weight, colour, sizes"),
        ({"weight": 1, "_target_": "os.system"}, "toy._target_ is not a key"),
        (
            {"weight": 1, "inner": {"sise": 2}},
            "toy.inner.sise is not a key; did you mean toy.inner.s",
        ),
        ({"weight": 1, "inner": {"size": 9}}, "inner.size=9 must be at least 1 and at most 5"),
        (
            {"weight": 1, "colour": "blue"},
            "toy.colour: Invalid value 'blue', expected one of [red, gr",
        ),
        ({"weight": 1, "sizes": 3}, "toy.sizes"),
        ({3: 4}, "toy.3"),
        ([1], "toy=[1] must be keys and values"),
        (3, "toy=3 must be keys and values"),
        ("weight", "toy=weight must be keys and values"),
        (None, "toy=None must be keys and values"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_key(layer, message):
    with pytest.raises(ConfigError) as refusal:
        typed(Options, layer)
    assert str(refusal.value).startswith(message)
    assert "\n" not in str(refusal.value)


def test_keys_are_named_where_they_stand():
    with pytest.raises(ConfigError, match="^box.toys.weight=0.0 must be above 0"):
        typed(
            dataclasses.make_dataclass(
                "Toy", [("weight", float, key("", above=0))], bases=(Checked,)
            ),
            {"weight": 0},
            prefix="box.toys.",
        )
    with pytest.raises(ConfigError, match="^box.wait is not a key; did you mean box.weight"):
        typed(Options, {"wait": 0}, prefix="box.")
    with pytest.raises(ConfigError, match="^box.weight is missing$"):
        typed(Options, {}, prefix="box.")


def test_what_is_nested_without_end_is_refused():
    content: dict = {}
    content["again"] = content
    with pytest.raises(ConfigError, match="^toy is nested too deeply$"):
        typed(Options, {"weight": 1, "label": content})


def test_help_says_meaning_range_and_default():
    told = {name: summary(field) for name, field in described(Options, "toy.")}
    assert told == {
        "toy.weight": "how heavy (kg); above 0, at most 10",
        "toy.colour": "its colour [red]",
        "toy.sizes": "of its parts; at least 1 [[1]]",
        "toy.label": "in words [null]",
        "toy.hollow": "whether there is room in it [false]",
        "toy.inner.size": "how many; at least 1, at most 5 [2]",
    }


@given(
    st.recursive(
        st.integers() | st.lists(st.integers()),
        lambda part: st.dictionaries(st.text("ab", min_size=1), part),
    )
)
def test_flat_keys_lead_to_their_values(content):
    content = {"whole": content}
    for name, value in flat(content):
        found = content
        for part in name.split("."):
            found = found[part]
        assert found == value
        assert not (isinstance(value, dict) and value)
