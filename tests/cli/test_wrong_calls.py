"""Wrong calls: one line that names what is wrong and what is allowed, status 2, nothing written."""

import importlib.util

import pytest

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        # Parts and keys that are not there.
        (["robot=lizard"], "robot=lizard is unknown; choose from ant, babya, "),
        (["+obs=history"], "obs=history is unknown; choose from hinges, hinges_orientation"),
        (["logger=paper"], "logger=paper is unknown; choose from csv, tensorboard, wandb"),
        (["physics=bullet"], "physics=bullet is unknown; choose from threaded"),
        (["arena=moon"], "arena=moon is unknown; choose from ground"),
        (["task=fly"], "task=fly is unknown; choose from turn, walk_along, walk_away"),
        (["network=lstm"], "network=lstm is unknown; choose from gru, mlp"),
        (["algorithm=best"], "algorithm=best is unknown; choose from cpg, ppo"),
        (["+experiment=mine"], "experiment=mine is unknown; choose from ablation"),
        (["ppo.iteration=3"], "ppo.iteration is not a key; did you mean ppo.iterations?"),
        (["pppo.epochs=3"], "pppo is not a key; did you mean ppo?"),
        (["+frames=3"], "frames is not a key"),
        (["++ppo.lr=3"], "ppo.lr is not a key"),
        (["+env.robots=3"], "env.robots is not a key"),
        (["+network.depth=3"], "network.depth is not a key; did you mean network.width?"),
        (["arena.slope=3"], "arena.slope is not a key; allowed are none"),
        (["task.reward.work.weight=3"], "task.reward is not a key; did you mean task.rewards?"),
        (["robot.bodi.module=core"], "robot.bodi is not a key; did you mean robot.body?"),
        (["hydra.nothing=3"], "hydra.nothing is not a key"),
        # Choices by name within a part.
        (
            ["+obs.sight.reading=hinge_velocty"],
            "obs.sight.reading=hinge_velocty is unknown; did you mean hinge_velocity? choose from",
        ),
        (["obs.hinge_velocty.steps=2"], "hinge_velocty is unknown; did you mean hinge_velocity?"),
        (
            ["task.rewards.velocty.weight=2"],
            "task.rewards=velocty is unknown; did you mean velocity? choose from distance, heading",
        ),
        (
            ["+task.rewards.work.price=1"],
            "task.rewards.work.price is not a key; allowed are weight",
        ),
        (
            ["network.name=mpl"],
            "network.name=mpl is unknown; did you mean mlp? choose from gru, mlp",
        ),
        (["arena.name=grond"], "arena.name=grond is unknown; did you mean ground?"),
        (["~network.name"], "network.name is missing; choose from gru, mlp"),
        (["obs.hinge_position.representation=yaw"], "must be null, as hinge_position is not an"),
        (["~task.rewards.distance"], "task.rewards is empty, so nothing could be learned"),
        (["~obs.hinge_position", "~obs.core_orientation"], "obs has no term"),
        (["~robot"], "robot"),
        # What would quietly mean something else.
        (["+obs=[history3,hinges]"], "obs=[history3,hinges] is not a choice"),
        (["--multirun", "obs=[history3],[hinges]"], "is not a choice"),
        (["obs={core_height: {}}"], "obs={core_height: {}} is not a choice"),
        (["robot=3"], "robot=3 is not a choice; give robot the name of one"),
        (["robot.body={module: core}"], "would be merged into another body; name a FILE.yaml"),
        (["+robot.body={module: core}"], "would be merged into another body"),
        (["++robot.body={module: core}"], "would be merged into another body"),
        (["robot={body: {module: core}}"], "is not a choice"),
        (["robot.body.children={left: {module: hinge}}"], "would be merged into another body"),
        (["--multirun", "robot.body={module: core},{module: brick}"], "would be merged"),
        (["--multirun", "robot.body=choice({module: core})"], "would be merged"),
        # Values of the wrong type.
        (["ppo.epochs=many"], "ppo.epochs=many: Value 'many' of type 'str'"),
        (["env.num_envs=1.5"], "env.num_envs=1.5: Value '1.5' of type 'float'"),
        (["env.num_envs=[1,2]"], "env.num_envs"),
        (["seed=null"], "seed=null"),
        (["env=null"], "env=null"),
        (
            ["obs.core_orientation.representation=euler"],
            "expected one of [quaternion, rotation_6d, gravity, yaw]",
        ),
        (["logger.backend=paper"], "expected one of [csv, tensorboard, wandb]"),
        (["physics.timestep=fast"], "physics.timestep=fast"),
        (["robot.body=gecko"], "robot.body=gecko"),
        (["ppo=3"], "ppo=3"),
        (["ppo.epochs"], "ppo.epochs is not KEY=VALUE"),
        (["network.hidden=32"], "network.hidden"),
        (["plugins=my_gaits"], "plugins=my_gaits"),
        # Values out of range, and absurd ones.
        (["ppo.epochs=0"], "ppo.epochs=0 must be at least 1"),
        (["ppo.steps=-1"], "ppo.steps=-1 must be at least 1"),
        (["ppo.steps=100000000"], "ppo.steps=100000000 must be at least 1 and at most 1e+06"),
        (["ppo.iterations=0"], "ppo.iterations=0 must be at least 1"),
        (["ppo.minibatch_size=0"], "ppo.minibatch_size=0 must be at least 1"),
        (["ppo.minibatch_size=9000"], "ppo.minibatch_size=9000 must be at most the 8192 frames"),
        (["ppo.cudagraphs=true"], "ppo.cudagraphs=True needs physics.device=cuda:0, not cpu"),
        (
            ["physics=warp", "ppo.cudagraphs=true", "ppo.minibatch_size=5000"],
            "ppo.minibatch_size=5000 must divide the 8192 frames",
        ),
        (["ppo.actor_lr=0"], "ppo.actor_lr=0.0 must be above 0"),
        (["ppo.gamma=1.5"], "ppo.gamma=1.5 must be at least 0 and at most 1"),
        (["ppo.clip_epsilon=1"], "ppo.clip_epsilon=1.0 must be above 0 and at most 0.99"),
        (["env.num_envs=0"], "env.num_envs=0 must be at least 1"),
        (["env.num_envs=10000000"], "env.num_envs=10000000 must be at least 1 and at most 1e+06"),
        (["env.num_envs=1000000", "ppo.steps=1000"], "must be at most 134217728 frames in an"),
        (["env.target_limit=1.1"], "env.target_limit=1.1 must be above 0 and at most 1.0472"),
        (["env.time_limit=nan"], "env.time_limit=nan must be above 0"),
        (["env.time_limit=0.1"], "env.time_limit=0.1 must be at least 0.25, one action"),
        (["env.settle_time=-1"], "env.settle_time=-1.0 must be at least 0"),
        (["env.control_frequency=inf"], "env.control_frequency=inf must be above 0"),
        (["physics.timestep=0"], "physics.timestep=0.0 must be above 0"),
        (["physics.timestep=0.03"], "physics.timestep=0.03 must divide the control period of 0.25"),
        (["physics.timestep=0.5"], "physics.timestep=0.5 must divide the control period of 0.25"),
        (["physics.timestep=1e-9"], "physics.timestep=1e-09 must be at least a millionth of"),
        (["physics.threads=0"], "physics.threads=0 must be at least 1"),
        (["disturbances.latency=-1"], "disturbances.latency=-1.0 must be at least 0"),
        (["physics.device=cuda:0"], "physics.device=cuda:0 must be cpu with physics=threaded"),
        (["physics.contacts=9"], "physics.contacts=9 must be null with physics=threaded"),
        (["physics=warp", "physics.device=gpu"], "physics.device=gpu must be cpu, cuda:0"),
        (["physics=warp", "physics.threads=2"], "physics.threads=2 must be null with physics=warp"),
        (["physics=warp", "physics.contacts=0"], "physics.contacts=0 must be at least 1"),
        (["physics=warp", "physics.device=cuda:999"], "physics.device=cuda:999 is not there"),
        (["--multirun", "physics=threaded,warp", "physics.device=cuda:999"], "physics.device=cuda"),
        (["physics.stiffness=-2"], "physics.stiffness=-2.0 must be above 0"),
        (["obs.hinge_position.steps=0"], "steps=0 must be at least 1"),
        (["network.hidden=[32,0]"], "network.hidden=[32, 0] must be at least 1"),
        (["+task.rewards.velocity.weight=inf"], "weight=inf must be finite"),
        (["seed=-1"], "seed=-1 must be at least 0"),
        (["checkpoint_interval=0"], "checkpoint_interval=0 must be at least 1"),
        (["robot.name=a/b"], "robot.name='a/b' must be a name of printable characters without '/'"),
        (["logger.video_seconds=5"], "logger.video_seconds=5.0 must be 0 with logger=csv"),
        # Sweeps, folders.
        (["robot=gecko,ant"], "robot=gecko,ant: several values need --multirun"),
        (["seed=choice(3)"], "seed=choice(3): several values need --multirun"),
        (["--multirun", "seed=0,1,-2"], "seed=-2 must be at least 0"),
        (["--multirun", "robot=gecko,lizard"], "robot=lizard is unknown"),
        (["--multirun", "seed=range(0)"], "seed=range(0) holds no value"),
        (["--multirun", "robot=glob(lizard*)"], "robot=glob(lizard*) holds no value"),
        (["--multirun", "ppo.gamma=interval(0.9,1)"], "ppo.gamma=interval(0.9,1) is not a list"),
        (["--multirun", "seed=0,0", "hydra.sweep.subdir=x"], "two jobs would write to multirun/"),
        (["--config-dir=nowhere"], "--config-dir=nowhere is not a folder"),
        (["hydra.run.dir=/dev/null/run"], "/dev/null/run cannot be written: Not a directory"),
        (["hydra.run.dir=/proc/run"], "/proc/run cannot be written"),
        (["--multirun", "seed=0,1", "hydra.sweep.dir=/proc/run"], "/proc/run/0 cannot be written"),
        ([f"hydra.run.dir={'x' * 300}"], "cannot be written: File name too long"),
        # Code in a configuration.
        (["+_target_=os.system"], "_target_ is not a key"),
        (["+robot._target_=os.system"], "robot._target_ is not a key"),
        (["+network._target_=os.system"], "network._target_ is not a key"),
        (
            ["+plugins=[no_such_module]"],
            "plugins=no_such_module cannot be imported: ModuleNotFound",
        ),
        (["resume=x", "+plugins=[no_such_module]"], "plugins=no_such_module cannot be imported"),
        # Flags.
        (["--bogus"], "unrecognized arguments: --bogus"),
        (["--experimental-rerun=job.pickle"], "unrecognized arguments: --experimental-rerun"),
        (["--config-path=x"], "unrecognized arguments: --config-path=x"),
        (["--config-name=x"], "unrecognized arguments: --config-name=x"),
        (["--cfg=bogus"], "argument --cfg/-c: invalid choice: 'bogus'"),
        (["--info", "seed=3"], "argument --info/-i: invalid choice: 'seed=3'"),
        (["--cfg=job", "--multirun"], "--multirun does not go with --cfg"),
        (["--resolve"], "--resolve and --package go with --cfg"),
    ],
)
def test_a_wrong_call_ends_in_one_line(arguments, message, refusal, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert message in refusal(*arguments)
    assert not list(tmp_path.iterdir())


def test_packages_that_are_missing_are_named(refusal, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    line = refusal("physics=warp", "physics.device=cpu")
    assert line == "physics=warp needs packages: pip install 'locomotion[warp]'"
