"""Another Hydra application's choices are not this one's, nor the other way round."""

import copy

from hydra.core.config_store import ConfigStore

from locomotion import compose
from locomotion.config import as_dict


def test_the_store_of_another_application_is_neither_read_nor_changed(tmp_path, recwarn):
    alone = as_dict(compose("network=mlp", "obs=history3"))
    store = ConfigStore.instance()
    before = store.repo
    store.repo = copy.deepcopy(before)
    try:
        for group, name in (
            *(("network", "mlp"), ("network", "theirs"), ("robot", "gecko"), ("obs", "history3")),
            *((None, "config"), (None, "locomotion"), ("hydra/launcher", "theirs")),
        ):
            store.store(name=name, group=group, node={"theirs": 3, "width": 1})
        theirs = copy.deepcopy(store.repo)
        (tmp_path / "mine.yaml").write_text(
            "body: {module: core, children: {left: {module: hinge}}}\n"
        )
        assert as_dict(compose("network=mlp", "obs=history3")) == alone
        assert compose(f"robot={tmp_path / 'mine.yaml'}").robot.name == "mine"
        assert store.repo == theirs
    finally:
        store.repo = before
    assert not [str(warning.message) for warning in recwarn if "schema" in str(warning.message)]
