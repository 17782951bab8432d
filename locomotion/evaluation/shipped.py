"""The policies that ship with the project, one for each robot."""

from __future__ import annotations

from pathlib import Path

from locomotion.options import ConfigError

#: Each is the folder of a run that holds nothing but its configuration and a checkpoint of the policy.
POLICIES = Path(__file__).resolve().parents[1] / "data" / "policies"


def shipped() -> list[str]:
    """Robots for which a policy ships."""
    return sorted(folder.name for folder in POLICIES.iterdir() if folder.is_dir())


def policy_folder(robot: str | None = None, run: str | None = None) -> Path:
    """The folder of the policy that ships for a robot, by default the Gecko, or of a run.

    Raises:
        ConfigError: if no policy ships for the robot, or both are given.
    """
    if run is not None and robot is not None:
        raise ConfigError(f"robot={robot} and run={run} name two policies; give one of them")
    if run is not None:
        return Path(run)
    robot = robot or "gecko"
    if robot not in shipped():
        raise ConfigError(
            f"robot={robot} has no policy that ships; choose from {', '.join(shipped())},"
            " or run=FOLDER for one that was trained"
        )
    return POLICIES / robot
