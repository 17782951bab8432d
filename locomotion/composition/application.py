"""Hydra with the project's configuration, next to whatever else uses it in the process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import hydra
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.plugins import Plugins
from hydra.core.utils import JobRuntime
from hydra.plugins.search_path_plugin import SearchPathPlugin
from hydra.version import VersionBase
from omegaconf import OmegaConf

from locomotion.options import conf_dir


class OwnFolder(SearchPathPlugin):
    """A folder of one's own, which Hydra searches after the project's."""

    path: Path | str | None = None

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Adds it, if there is one."""
        if self.path is not None:
            search_path.append("command-line", f"file://{Path(self.path).resolve()}")


@contextmanager
def own_store() -> Iterator[None]:
    """Hydra's store without what another application keeps there, and afterwards as it was."""
    store = ConfigStore.instance()
    before = store.repo
    store.repo = {name: part for name, part in before.items() if name == "hydra"}
    try:
        yield
    finally:
        store.repo = before


@contextmanager
def application(config_dir: Path | str | None) -> Iterator[None]:
    """Hydra with the project's configuration, and afterwards as it was."""
    base, details, job = VersionBase.instance(), HydraConfig.instance(), JobRuntime.instance()
    others = GlobalHydra.instance()
    before = base.version_base, details.cfg, job.conf, others.hydra, OwnFolder.path
    Plugins.instance().register(OwnFolder)
    OwnFolder.path = config_dir
    others.clear()
    job.conf = OmegaConf.create()
    try:
        with hydra.initialize_config_dir(str(conf_dir()), job_name="train", version_base="1.3"):
            yield
    finally:
        others = GlobalHydra.instance()
        base.version_base, details.cfg, job.conf, others.hydra, OwnFolder.path = before
