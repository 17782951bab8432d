"""Disturbances of robots, against closed forms and MuJoCo's own stepping."""

import itertools
import math

import mujoco
import numpy as np
import pytest
import torch
from torchrl.envs.utils import check_env_specs

from locomotion.disturbances.options import DEFAULTS
from locomotion.envs import LocomotionEnv
from locomotion.options import ConfigError, readings
from locomotion.robots.geometry import HINGE_TORQUE

#: Each with a range that changes something.
ALL = {
    "mass": [0.7, 1.3],
    "strength": [0.7, 1.3],
    "stiffness": [0.8, 1.2],
    "damping": [0.5, 1.5],
    "battery": [0.8, 1.0],
    "top_speed": [5.0, 7.0],
    "friction": [0.5, 1.5],
    "hinge_friction": [0.0, 0.05],
    "backlash": [0.0, 0.1],
    "stuck": 0.5,
    "latency": [0.0, 0.3],
    "dropped": [0.1, 0.3],
    "push": [0.1, 0.5],
    "push_interval": 2.0,
    "sensor_latency": [0.0, 0.1],
    "hinge_noise": 0.02,
    "hinge_bias": [0.0, 0.02],
    "orientation_noise": 0.02,
    "orientation_bias": [0.0, 0.1],
    "speed_noise": 0.1,
    "gyro_bias": [0.0, 0.1],
    "interval": 1.0,
    "chance": 0.8,
    "always": ["latency"],
}
SENSED = ["hinge_position", "hinge_velocity", "core_orientation", "core_angular_velocity"]


#: Of draws that no backend has a hand in, which many robots and steps are needed to see.
once = pytest.mark.parametrize("stepping", [{"backend": "threaded"}], ids=["once"], indirect=True)


@pytest.fixture
def make(stepping):
    """Makes Geckos under the disturbances that are given."""

    def make(num_envs=3, seed=0, names=SENSED, **disturbances):
        given = {"readings": names, "physics": stepping, "disturbances": disturbances}
        return LocomotionEnv("gecko", num_envs, seed=seed, **given)

    return make


def walk(env, steps, seen=None):
    """The readings of control steps under random targets, and the targets."""
    generator, td = torch.Generator().manual_seed(1), env.reset() if seen is None else seen
    rows = []
    for _ in range(steps):
        drawn = torch.rand(env.action_spec.shape, generator=generator) * 2.4 - 1.2
        td = env.step(td.set("action", drawn.to(env.physics.device)))
        rows.append(td.clone())
        td = td["next"].exclude("reward")
    return torch.stack(rows, 1).to("cpu")


def test_all_of_them_at_once_are_an_environment_as_torchrl_wants_it(make):
    assert set(ALL) == set(DEFAULTS) | {"interval", "push_interval", "chance", "always"}
    check_env_specs(make(names=readings.names(), **ALL))


def test_none_of_them_changes_nothing(make):
    """Values that change nothing are no disturbances, written out or not."""
    spelled = {name: value for name, value in DEFAULTS.items() if name != "top_speed"}
    assert (walk(make(), 4) == walk(make(**spelled, top_speed=None), 4)).all()


@once
def test_the_same_seed_draws_the_same_and_a_state_has_all_that_comes_next(make):
    first, again, other = make(**ALL), make(**ALL), make(seed=1, **ALL)
    walked = walk(first, 7)
    assert (walked == walk(again, 7)).all()
    state = first.state_dict()
    seen = walked[:, -1]["next"].exclude("reward").to(first.physics.device)
    ahead = walk(first, 9, seen.clone())
    other.reset()
    other.load_state_dict(state)
    assert (ahead == walk(other, 9, seen.clone())).all()
    assert not (walked == walk(make(seed=1, **ALL), 7)).all()


def test_all_robots_draw_anew_after_each_interval_and_not_between(make):
    env = make(mass=[0.5, 2.0], interval=1.0)
    seen = env.reset()
    masses = []
    for _ in range(9):
        env.step(seen.set("action", env.action_spec.zero()))
        masses.append(env.physics.parameter("body_mass").clone()[:, 1:])
    changed = [bool((a != b).all()) for a, b in itertools.pairwise(masses)]
    assert changed == [False, False, False, True, False, False, False, True]
    shared = torch.as_tensor(env.model.body_mass[1:], device=env.physics.device)
    factors = torch.stack(masses) / shared
    assert (factors >= 0.499).all() and (factors <= 2.001).all()
    assert factors[0].unique().numel() == factors[0].numel()  # each link has its own


def test_each_acts_on_some_robots_alone(make):
    acting = {"mass": [1.5, 2.0], "strength": 0.5, "top_speed": 6.0, "friction": 0.5}
    env = make(200, **acting, chance=0.3, always=["friction"])
    env.reset()
    physics, model = env.physics, env.model
    heavy = (
        physics.parameter("body_mass").cpu()[:, 1:] > 1.2 * torch.tensor(model.body_mass[1:])
    ).double()
    weak = physics.parameter("actuator_forcerange").cpu()[:, 0, 1] < 0.9 * HINGE_TORQUE
    slowed = physics.parameter("dof_damping").cpu()[:, 6] > 0
    slippery = physics.parameter("pair_friction").cpu()[:, 0, 0] < env.model.pair_friction[0, 0]
    assert slippery.all()
    acting = torch.stack([heavy.mean(1), weak.double(), slowed.double()])
    assert set(acting.unique().tolist()) == {0.0, 1.0}
    assert ((acting.mean(1) - 0.3).abs() < 0.12).all()
    assert torch.corrcoef(acting).triu(1).abs().max() < 0.25  # each by itself


def test_a_critic_is_told_what_is_at_work(make):
    env = make(
        50, names=["disturbances"], mass=[0.5, 1.5], top_speed=[5.0, 10.0], stuck=0.5, push=0.4
    )
    told = env.reset()["disturbances"]
    names = list(DEFAULTS)
    assert told.shape == (50, len(names))
    acting = {"mass", "top_speed", "stuck", "push"}
    assert {name for name, column in zip(names, told.T, strict=True) if column.any()} == acting
    masses = env.physics.parameter("body_mass")[:, 1:].cpu()
    factors = masses / torch.as_tensor(env.model.body_mass[1:])
    mass = told[:, names.index("mass")].cpu()
    torch.testing.assert_close(mass, (2 * (factors - 1)).mean(1).float())
    assert told[:, names.index("push")].unique().tolist() == [1.0]
    assert told[:, names.index("stuck")].unique().tolist() == [0.0, 1.0]
    fast = told[:, names.index("top_speed")]
    assert fast.min() >= 0.5 and fast.max() <= 1
    assert not make(2, names=["disturbances"]).reset()["disturbances"].any()


def test_masses_move_as_mujoco_moves_them(make):
    env = make(names=["core_position"], mass=1.4)
    reference = env.model.__copy__()
    reference.body_mass *= 1.4
    reference.body_inertia *= 1.4
    data = mujoco.MjData(reference)
    mujoco.mj_setConst(reference, data)
    env.reset()
    data.qpos[:], data.qvel[:] = env.physics.qpos[1].cpu(), env.physics.qvel[1].cpu()
    data.ctrl[:] = 0.7
    mujoco.mj_step(reference, data, 25)
    env.step(env.fake_tensordict().set("action", env.action_spec.zero() + 0.7))
    np.testing.assert_allclose(env.physics.qpos[1].cpu(), data.qpos, atol=2e-4)


@pytest.mark.parametrize("speed", [-12.0, -3.0, 0.0, 2.0, 5.0, 9.0])
@pytest.mark.parametrize("target", [-1.0, 0.3, 1.0])
def test_a_servo_is_a_motor_whose_torque_falls_with_its_speed(speed, target, make):
    """Of MuJoCo's torque and damping together, before it integrates."""
    scales = {"strength": 1.3, "stiffness": 3.0, "damping": 2.0, "battery": 0.8, "top_speed": 5.0}
    env = make(names=["hinge_torque"], **scales)
    env.reset()
    physics, model, data = env.physics, env.model.__copy__(), mujoco.MjData(env.model)
    for name in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "dof_damping"):
        own = physics.parameter(name)[0].cpu().numpy()
        getattr(model, name)[:] = own.reshape(getattr(model, name).shape)
    data.qvel[6:], data.ctrl[:] = speed, target
    mujoco.mj_forward(model, data)
    stall = 1.3 * 0.8 * HINGE_TORQUE
    free = 0.8 * 5.0
    wanted = 1.3 * (3.0 * 1.0 * target - 2.0 * 0.05 * speed)
    line = stall * np.array([-1.0 - speed / free, 1.0 - speed / free])
    expected = np.clip(wanted, *line)
    np.testing.assert_allclose(data.qfrc_actuator[6:] + data.qfrc_passive[6:], expected, rtol=1e-5)


def test_a_motor_without_load_comes_to_its_top_speed_and_no_further(make):
    """High up, driven by targets that stay out of reach of a stiff servo."""
    tops = []
    for limit in (4.0, None):
        env = make(stiffness=50.0, damping=0.1, top_speed=limit)
        env.reset()
        qpos = torch.as_tensor(env.model.qpos0).repeat(3, 1)
        qpos[:, 2], qpos[:, 7:] = 8.0, -1.0
        env.set_state(qpos.to(env.physics.device), env.physics.qvel * 0)
        speeds = []
        with env.after_substep(lambda physics, s=speeds: s.append(physics.qvel[:, 6:].abs().max())):
            env.step(env.fake_tensordict().set("action", env.action_spec.zero() + 1.0))
        tops.append(max(speeds).item())
    assert 2.0 < tops[0] < 4.2 and tops[1] > 6.0


def test_friction_is_that_of_each_robot(make):
    env = make(friction=[0.4, 0.6])
    env.reset()
    shared = torch.as_tensor(env.model.pair_friction[:, :2], device=env.physics.device)
    factors = env.physics.parameter("pair_friction")[..., :2] / shared
    assert (factors >= 0.399).all() and (factors <= 0.601).all()
    torch.testing.assert_close(factors, factors[:, :1, :1].expand_as(factors))
    assert factors[:, 0, 0].unique().numel() == 3


def test_dry_friction_stops_a_hinge_that_nothing_drives(make):
    rests = []
    for friction in (0.0, 0.2):
        env = make(hinge_friction=friction, stiffness=1e-6, damping=0.0)
        env.reset()
        qpos = torch.as_tensor(env.model.qpos0).repeat(3, 1)
        qpos[:, 2] = 8.0
        qvel = torch.zeros(3, env.model.nv, dtype=torch.float64)
        qvel[:, 6:] = 0.5
        env.set_state(qpos.to(env.physics.device), qvel.to(env.physics.device))
        env.step(env.fake_tensordict().set("action", env.action_spec.zero()))
        rests.append(env.physics.qvel[:, 6:].abs().max().item())
    assert rests[1] < 0.02 and rests[0] > 0.3


def followed(env, asked):
    """Targets that reach the hinges, of those that are asked for."""
    env.reset()
    sent = []
    for target in asked:
        env.step(env.fake_tensordict().set("action", env.action_spec.zero() + target))
        sent.append(env.physics.control[:, 0].clone().cpu())
    return torch.stack(sent, 1).double()


def test_play_is_the_play_operator(make):
    asked = [0.5, 0.5, 0.46, 0.30, 0.34, 0.45, 0.9, -0.9]
    sent = followed(make(backlash=0.1), asked)
    expected = [0.45, 0.45, 0.45, 0.35, 0.35, 0.40, 0.85, -0.85]
    # Where it comes from is wherever the start left it.
    for robot in range(3):
        torch.testing.assert_close(
            sent[robot, 3:], torch.tensor(expected).double()[3:], atol=1e-6, rtol=0
        )


@once
def test_targets_that_are_lost_leave_those_before(make):
    env = make(64, dropped=0.25)
    sent = followed(env, [0.01 * step for step in range(1, 41)])
    steps = torch.round(100 * sent)
    lost = steps != torch.arange(1, 41)
    assert 0.2 < lost[:, 1:].double().mean() < 0.3
    kept = torch.where(lost, 0, steps).cummax(1).values
    assert torch.equal(steps[:, 8:], kept[:, 8:])
    never = make(dropped=1.0)
    first = followed(never, [0.5, -0.5])
    assert torch.equal(first[:, 0], first[:, 1])


def test_a_policy_sees_what_it_asked_for_whatever_became_of_it(make):
    env = make(names=["hinge_target"], dropped=0.5, backlash=0.3, stuck=1.0, latency=0.2)
    walked = walk(env, 5)
    asked = walked["action"].clamp(-1.0, 1.0)
    torch.testing.assert_close(walked["next", "hinge_target"], asked)


def test_a_hinge_that_is_stuck_stays_and_the_others_move(make):
    env = make(8, stuck=1.0, interval=100.0)
    env.reset()
    start = env.physics.qpos[:, 7:].clone()
    most = torch.zeros_like(start)
    for step in range(8):
        env.step(env.fake_tensordict().set("action", env.action_spec.zero() + (-1.0) ** step))
        most = torch.maximum(most, (env.physics.qpos[:, 7:] - start).abs())
    stuck = most < 0.1
    assert stuck.sum(1).tolist() == [1] * 8
    assert (most[~stuck] > 0.3).all()
    none = make(8, stuck=[0.0, 0.0])
    none.reset()
    assert not none.physics.parameter("dof_frictionloss").any()


@once
def test_pushes_come_as_often_as_they_should_and_are_as_strong(make):
    env = make(64, push=[0.3, 0.5], push_interval=1.0, interval=1000.0)
    seen, changes = env.reset(), []
    for _ in range(20):
        before, starts = env.physics.qvel.clone(), []
        with env.after_substep(lambda physics, s=starts: s.append(physics.previous.clone())):
            env.step(seen.set("action", env.action_spec.zero()))
        changes.append((starts[0][:, 1 + env.model.nq :] - before).cpu())
    changes = torch.stack(changes)
    speeds = changes[..., :2].norm(dim=-1)
    pushed = speeds > 0
    assert not changes[..., 2:].any()
    assert 0.2 < pushed.double().mean() < 0.3  # a quarter of a second in a second
    assert 0.299 < speeds[pushed].min() and speeds[pushed].max() < 0.501
    turns = torch.atan2(changes[..., 1], changes[..., 0])[pushed]
    assert (turns.cos().mean().abs() < 0.15) and (turns.sin().mean().abs() < 0.15)


@pytest.mark.parametrize("latency", [0.01, 0.05, 0.2])
def test_sensors_tell_what_was(latency, make):
    """Readings of a robot without the disturbance, as many physics steps ago."""
    late, plain = make(sensor_latency=latency), make()
    late.reset(), plain.reset()
    past = []

    def note(_):
        past.append({name: value.clone() for name, value in plain.observe().items()})

    for step in range(3):
        action = plain.action_spec.zero() + 0.8 * (-1.0) ** step
        with plain.after_substep(note):
            plain.step(plain.fake_tensordict().set("action", action))
        seen = late.step(late.fake_tensordict().set("action", action))["next"]
        for name in SENSED:
            expected = past[-1 - round(latency / 0.01)][name]
            torch.testing.assert_close(seen[name], expected, atol=2e-4, rtol=1e-3)


def angle_between(one, other):
    """Angles (rad) between orientations, unit quaternions in the last dimension."""
    return 2 * (one * other).sum(-1).abs().clamp(max=1).double().acos()


@once
def test_noise_and_offsets_are_as_large_as_they_should_be(make):
    scales = {"hinge_noise": 0.05, "speed_noise": 0.3, "orientation_noise": 0.02}
    exact, noisy = walk(make(64), 10)["next"], walk(make(64, **scales), 10)["next"]
    for name, deviation in (("hinge_position", 0.05), ("hinge_velocity", 0.3)):
        assert (noisy[name] - exact[name]).std().item() == pytest.approx(deviation, rel=0.1)
    turned = angle_between(noisy["core_orientation"], exact["core_orientation"])
    # The length of a vector of three normal numbers.
    assert turned.mean().item() == pytest.approx(0.02 * math.sqrt(8 / math.pi), rel=0.1)

    off = walk(make(64, hinge_bias=0.05, orientation_bias=0.1, gyro_bias=0.2), 3)["next"]
    difference = (off["hinge_position"] - exact["hinge_position"][:, :3]).double()
    torch.testing.assert_close(
        difference.abs(), torch.full_like(difference, 0.05), atol=1e-5, rtol=0
    )
    assert 0.3 < (difference > 0).double().mean() < 0.7
    turned = angle_between(off["core_orientation"], exact["core_orientation"][:, :3])
    torch.testing.assert_close(turned, torch.full_like(turned, 0.1), atol=3e-3, rtol=0)
    rate = off["core_angular_velocity"] - exact["core_angular_velocity"][:, :3]
    torch.testing.assert_close(
        rate.norm(dim=-1), torch.full(rate.shape[:-1], 0.2), atol=1e-4, rtol=0
    )


def test_what_is_sensed_is_not_what_happens(make):
    scales = {"hinge_noise": 0.5, "orientation_noise": 0.5, "speed_noise": 5.0}
    exact, noisy = make(names=["core_position"]), make(names=["core_position"], **scales)
    places = [walk(env, 4)["next"] for env in (exact, noisy)]
    assert torch.equal(places[0]["core_position"], places[1]["core_position"])
    assert torch.equal(places[0]["reward"], places[1]["reward"])


@pytest.mark.parametrize(
    ("disturbances", "message"),
    [
        ({"mass": [1.2, 0.8]}, "disturbances.mass=[1.2, 0.8] must be a range with the lower end"),
        ({"mass": 0}, "disturbances.mass=0.0 must be above 0"),
        ({"mass": [0, 1]}, "disturbances.mass=[0.0, 1.0] must be above 0"),
        ({"mass": "heavy"}, "disturbances.mass=heavy must be a number, or a range [low, high]"),
        ({"mass": [1, 2, 3]}, "must be a number, or a range [low, high]"),
        ({"mass": []}, "must be a number, or a range [low, high]"),
        ({"mass": None}, "disturbances.mass=None must be a number"),
        ({"push": True}, "disturbances.push=True must be a number"),
        ({"dropped": 1.5}, "disturbances.dropped=1.5 must be at least 0 and at most 1"),
        ({"latency": 11}, "disturbances.latency=11.0 must be at least 0 and at most 10"),
        ({"top_speed": math.nan}, "disturbances.top_speed=nan must be above 0"),
        ({"always": ["mas"]}, "disturbances.always=mas must be names of mass, strength"),
        ({"mas": 1}, "disturbances.mas is not a key; did you mean disturbances.mass?"),
    ],
)
def test_what_cannot_disturb_is_refused(disturbances, message):
    with pytest.raises(ConfigError) as caught:
        LocomotionEnv("gecko", 1, disturbances=disturbances)
    assert message in str(caught.value) and "\n" not in str(caught.value)
