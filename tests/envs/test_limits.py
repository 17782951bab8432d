"""Motion that is not believed of a robot ends its episode."""

from contextlib import nullcontext

import pytest
import torch

from locomotion.envs import LocomotionEnv
from locomotion.options import ConfigError


@pytest.mark.parametrize(
    ("limits", "height", "speed", "lost"),
    [
        ({}, 3.0, 5.0, False),
        ({"height_limit": 1.0}, 3.0, 0.0, True),
        ({"height_limit": 5.0}, 3.0, 0.0, False),
        ({"speed_limit": 2.0}, 1.0, 2.5, True),
        ({"speed_limit": 2.0}, 1.0, 1.5, False),
    ],
)
def test_a_robot_beyond_a_limit_is_lost_and_put_back(limits, height, speed, lost):
    env = LocomotionEnv("gecko", 2, physics=limits, seed=0)
    begun = env.reset()
    qpos, qvel = env.physics.qpos.clone(), torch.zeros_like(env.physics.qvel)
    qpos[1, 2], qvel[1, 1] = height, speed
    env.set_state(qpos, qvel)
    step = env.step(begun.set("action", torch.zeros(2, env.model.nu)))["next"]
    assert step["terminated"].flatten().tolist() == [False, lost]
    assert (step["reward"][1] == 0) == lost
    assert len(env.take_divergences()) == lost
    env.close()


def test_limits_are_above_nothing():
    with pytest.raises(ConfigError, match=r"physics.speed_limit=0.* must be above 0"):
        LocomotionEnv("gecko", 1, physics={"speed_limit": 0.0})


def test_who_is_lost_does_not_hang_on_whether_somebody_watches(stepping):
    """A core is faster within a control step than on average."""

    def walked(watched):
        env = LocomotionEnv("gecko", 16, physics={**stepping, "speed_limit": 0.6}, seed=0)
        torch.manual_seed(1)
        fastest, seen = [], env.reset()
        for _ in range(4):
            drawn = torch.rand(env.action_spec.shape) * 2 - 1
            seen = seen.set("action", drawn.to(env.physics.device))
            with (
                env.after_substep(
                    lambda physics: fastest.append(physics.qvel[:, :2].norm(dim=1).cpu())
                )
                if watched
                else nullcontext()
            ):
                seen = env.step(seen)["next"]
        return env.physics.qpos.cpu().clone(), env.take_divergences(), fastest

    places, lost, _ = walked(watched=False)
    watched_places, watched_lost, fastest = walked(watched=True)
    assert (torch.stack(fastest).amax(0) > 0.6).sum() > len(lost)
    assert [one.robot for one in lost] == [one.robot for one in watched_lost]
    torch.testing.assert_close(places, watched_places, atol=1e-5, rtol=0)
