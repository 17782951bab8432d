"""A package of somebody else's adds a reading, a reward, an arena, a network and a learner."""

import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
CONTRIBUTING = HERE.parents[1] / "CONTRIBUTING.md"


def test_all_of_its_parts_train_resume_and_walk(command, tmp_path):
    def run(name, *arguments, cwd):
        return command(name, "+plugins=[my_gaits]", *arguments, cwd=cwd, path=HERE)

    config_dir = f"--config-dir={HERE / 'my_gaits' / 'conf'}"
    chosen = ["+obs=mine", "network=linear", "arena=slope", "task=upright"]
    chosen += ["algorithm=random_search", "random_search.iterations=3", "random_search.steps=4"]
    small = ["env.num_envs=3", "checkpoint_interval=2", "hydra.run.dir=run"]
    trained = run("train", config_dir, *chosen, *small, cwd=tmp_path)
    assert trained.returncode == 0, trained.stderr
    header, *rows = (tmp_path / "run" / "metrics.csv").read_text().splitlines()
    assert header.startswith("iteration,frames,mean_reward,mean_value,best_reward,")
    assert len(rows) == 3
    assert all(float(row.split(",")[2]) > 0 for row in rows)  # most is paid for being upright

    more = run("train", "resume=run", "random_search.iterations=5", cwd=tmp_path)
    assert more.returncode == 0, more.stderr
    assert (tmp_path / "run" / "metrics.csv").read_text().splitlines()[:4] == [header, *rows]
    walked = run("evaluate", "run=run", "seconds=1", "json=true", cwd=tmp_path)
    assert walked.returncode == 0, walked.stderr
    exported = run("export", "run=run", "output=gait.pt2", cwd=tmp_path)
    assert exported.returncode == 0, exported.stderr


@pytest.mark.parametrize(
    "snippet", re.findall(r"```python\n(.*?)```", CONTRIBUTING.read_text(), re.DOTALL)
)
def test_what_contributing_shows_is_what_runs(snippet):
    if "from locomotion import" in snippet:
        compile(snippet, "CONTRIBUTING.md", "exec")
    else:
        assert snippet in (HERE / "my_gaits" / "__init__.py").read_text()
