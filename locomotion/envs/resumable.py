"""An environment with transforms that can be saved, and goes on where it was."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tensordict import TensorDict, TensorDictBase
from torchrl.envs import TransformedEnv


class ResumableEnv(TransformedEnv):
    """A :class:`~torchrl.envs.TransformedEnv` whose state holds all that its next step depends on.

    That is the base environment's state, those of the transforms, and the entries that the last step or
    reset wrote. After :meth:`load_state_dict` the first ``reset()`` begins no episode: it returns the
    entries that were saved, so a collector that is made then goes on as if nothing had happened.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.__dict__["_current"] = None
        self.__dict__["_resumed"] = False
        super().__init__(*args, **kwargs)

    def step_and_maybe_reset(
        self, tensordict: TensorDictBase
    ) -> tuple[TensorDictBase, TensorDictBase]:
        stepped, following = super().step_and_maybe_reset(tensordict)
        self.__dict__["_current"] = following
        return stepped, following

    def reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        if self._resumed and tensordict is None:
            self.__dict__["_resumed"] = False
            return self._current.clone()
        self.__dict__["_current"] = super().reset(tensordict, **kwargs)
        return self._current

    def state_dict(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """The whole state, as plain tensors; taken between two steps, after the first reset."""
        entries = self._current.select(*self.observation_keys, *self.done_keys, *self.state_keys)
        return {
            "base": self.base_env.state_dict(),
            "transforms": self.transform.state_dict(),
            "entries": entries.clone().flatten_keys(".").to_dict(),
        }

    def load_state_dict(self, state_dict: Mapping[str, Any], **kwargs: Any) -> None:
        """Goes on from a state of :meth:`state_dict`."""
        self.base_env.load_state_dict(state_dict["base"])
        self.transform.load_state_dict(state_dict["transforms"])
        entries = TensorDict(dict(state_dict["entries"]), self.batch_size, device=self.device)
        self.__dict__["_current"] = entries.unflatten_keys(".")
        self.__dict__["_resumed"] = True
