"""Environment, learner and collector of a run, as its configuration describes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from torchrl.collectors import Collector
from torchrl.envs import Compose, EnvBase, Transform, TransformedEnv

from locomotion.agents.architectures import Network
from locomotion.agents.base import Learner
from locomotion.config import Config
from locomotion.envs import LocomotionEnv, ResumableEnv, make_task
from locomotion.envs.observations import ObsTerm, make_transforms
from locomotion.envs.resumable import forked_generators
from locomotion.options import ConfigError


def make_env(
    config: Config,
    base_env: EnvBase | None = None,
    transforms: Sequence[Transform] = (),
    network: Network | None = None,
) -> ResumableEnv:
    """The environment of a run, with the entries that its policy sees.

    Args:
        config: the run.
        base_env: an environment in place of the one that is described. Terms whose readings it does not
            write are left out.
        transforms: more transforms, after those that write the observations.
        network: an architecture in place of the one that is described.
    """
    if base_env is None:
        parts = (config.robot, config.arena, config.task, config.env, config.physics)
        task = make_task(*parts, config.disturbances)
        base_env = LocomotionEnv(
            task,
            config.env.num_envs,
            readings=_readings(config),
            physics=config.physics,
            disturbances=config.disturbances,
            time_limit=config.env.time_limit,
            stagger=config.env.stagger,
            seed=config.seed,
        )
    observing, _, _ = _observing(config, base_env)
    needed = config.learner.make_transforms(base_env, network or config.architecture)
    return ResumableEnv(base_env, Compose(*observing, *transforms, *needed))


def _readings(config: Config) -> list[str]:
    terms = [*config.obs.items(), *config.critic.items()]
    return list(dict.fromkeys(term.reading_of(name) for name, term in terms))


def _observing(config: Config, env: EnvBase) -> tuple[list[Transform], list[str], list[str]]:
    """The transforms that write the terms; the entries of the policy, and those of the critic's own terms."""
    there = env.observation_spec.keys(True, True)

    def written(terms: Mapping[str, ObsTerm]) -> dict[str, ObsTerm]:
        return {name: term for name, term in terms.items() if term.reading_of(name) in there}

    transforms, keys = make_transforms(written(config.obs))
    more, alone = make_transforms(written(config.critic), prefix="critic_")
    return [*transforms, *more], keys, alone


def policy_keys(config: Config) -> list[str]:
    """The entries that the policy sees; each gets an encoder of its own."""
    return make_transforms(config.obs)[1]


def make_learner(
    config: Config,
    env: TransformedEnv,
    in_keys: Sequence[str] | None = None,
    network: Network | None = None,
) -> Learner:
    """The untrained learner of a run, where its robots are.

    Args:
        config: the run.
        env: its environment.
        in_keys: the entries that the policy sees, in place of those of ``config.obs``.
        network: an architecture in place of the one that is described.

    Raises:
        ConfigError: if the environment does not write an entry that the policy is to see, or writes a
            number there.
    """
    in_keys = list(policy_keys(config) if in_keys is None else in_keys)
    critic_keys = list(dict.fromkeys([*in_keys, *_observing(config, env)[2]]))
    there = env.observation_spec.keys(True, True)
    for key in in_keys:
        if key not in there:
            known = ", ".join(sorted(map(str, there)))
            raise ConfigError(f"the policy is to see {key!r}, but the environment writes {known}")
        if env.observation_spec[key].ndim <= len(env.batch_size):
            raise ConfigError(
                f"the policy is to see {key!r}, which is a number, not a vector;"
                " UnsqueezeTransform(-1) makes it one"
            )
    return config.learner.make(env, network or config.architecture, in_keys, critic_keys)


def make_collector(env: TransformedEnv, learner: Learner, steps: int) -> Collector:
    """Collects ``steps`` control steps of all robots at a time, without an end.

    Batches have shape ``(num_envs, steps)``; the next one begins where the last one ended. Making a
    collector draws no random numbers from torch.
    """
    with forked_generators(env):
        return Collector(
            env,
            learner.policy,
            frames_per_batch=env.batch_size.numel() * steps,
            total_frames=-1,  # at the end it would close the environment, which is still to be saved
            trust_policy=True,
            use_buffers=False,
            return_same_td=True,  # each batch has memory of its own; no copy is needed
            no_cuda_sync=True,  # all is done on one stream, that of whoever asks for a batch
            track_traj_ids=False,
            auto_register_policy_transforms=False,
        )
