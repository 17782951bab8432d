"""The wheel that pip builds: it carries ``conf/`` and the policies that ship."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from locomotion.evaluation.shipped import shipped

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


def test_a_wheel_carries_configuration_and_policies(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--no-deps", "-q", "-w", tmp_path, ROOT], check=True
    )
    (wheel,) = tmp_path.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'site')!r});"
        "from locomotion import compose; from locomotion.options import conf_dir;"
        "from locomotion.plots import REPORT, read_csv; from locomotion.runs import read_config;"
        "from locomotion.evaluation.shipped import POLICIES, shipped;"
        "print(conf_dir(), compose('robot=ant').robot.name, len(read_csv(REPORT)));"
        "print(*shipped(), read_config(POLICIES / 'gecko')['robot']['name']);"
        "print(*POLICIES.glob('*/checkpoints/*.ckpt'))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    first, second, third = result.stdout.splitlines()
    assert first == f"{tmp_path / 'site' / 'locomotion' / 'conf'} ant 6"
    assert second.split() == [*shipped(), "gecko"]
    assert third.count(".ckpt") == len(shipped()) >= 19
