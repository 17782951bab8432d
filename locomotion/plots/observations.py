"""Names for what a policy observes: those of ``conf/obs``, or a description."""

from __future__ import annotations

import functools

from locomotion.config import ObsConfig, conf_dir, load


def observations_name(hinge_steps: int, orientation: str | None) -> str:
    """What ``+obs=NAME`` calls these observations, or a description such as ``5 steps + gravity``."""
    for name, known in _choices().items():
        if known == (hinge_steps, orientation):
            return name
    return _description(hinge_steps, orientation)


def observations_label(name: str) -> str:
    """A name from :func:`observations_name`, with what it means."""
    choice = _choices().get(name)
    return name if choice is None else f"{name}: {_description(*choice)}"


def _description(hinge_steps: int, orientation: str | None) -> str:
    steps = "1 step" if hinge_steps == 1 else f"{hinge_steps} steps"
    if orientation is None:
        return steps
    return f"{steps} + {'orientation' if orientation == 'quaternion' else orientation}"


@functools.cache
def _choices() -> dict[str, tuple[int, str | None]]:
    choices = {}
    for path in sorted((conf_dir() / "obs").glob("*.yaml")):
        choice: ObsConfig = load(f"obs/{path.stem}")
        choices[path.stem] = (choice.hinge_steps, choice.orientation and choice.orientation.value)
    return choices
