"""A stand-in for a GPU, for machines without one.

Its tensors compute on the CPU, but say that they are elsewhere, and refuse to be mixed with tensors that
are on the CPU as a GPU's would. Where the host asks for a value or the number of elements, or data moves
between the two, it is counted.
"""

import importlib
from collections import Counter

import pytest
import torch
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode, return_and_correct_aliasing
from torch.utils._pytree import tree_leaves, tree_map

from locomotion.physics.options import PhysicsConfig

#: Where the tensors say they are: a device that torch knows and has no kernels for.
DEVICE = torch.device("lazy:0")

_aten = torch.ops.aten
_COPIES = {_aten.copy_.default, _aten._to_copy.default}
#: May be given indices that are on the CPU.
_INDEXING = {
    _aten.index.Tensor,
    _aten.index_put.default,
    _aten.index_put_.default,
    _aten._index_put_impl_.default,
}
#: How many elements come out depends on values, for which the host has to wait.
_OPEN_ENDED = {_aten.nonzero.default, _aten.masked_select.default}


class _Elsewhere(torch.Tensor):
    """A tensor on the stand-in; ``inside`` is the one that computes."""

    @staticmethod
    def __new__(cls, inside):
        tensor = torch.Tensor._make_wrapper_subclass(
            cls,
            inside.shape,
            strides=inside.stride(),
            storage_offset=inside.storage_offset(),
            dtype=inside.dtype,
            device=DEVICE,
        )
        tensor.inside = inside
        return tensor

    @classmethod
    def __torch_dispatch__(cls, func, types, args=(), kwargs=None):
        raise RuntimeError(f"{func} on {DEVICE} outside of the stand-in")

    def tolist(self):
        return self.cpu().tolist()

    def numpy(self, *, force=False):
        if not force:
            raise TypeError(f"can't convert a tensor on {DEVICE} to numpy")
        return self.detach().cpu().numpy()

    def __reduce_ex__(self, protocol):
        return self.inside.detach().__reduce_ex__(protocol)  # as read with map_location="cpu"


class _Operations(TorchDispatchMode):
    """Runs every operation where its tensors are, and counts crossings."""

    def __init__(self, crossings):
        super().__init__()
        self._crossings = crossings

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        tensors = [x for x in tree_leaves((args, kwargs)) if isinstance(x, torch.Tensor)]
        there = [x for x in tensors if isinstance(x, _Elsewhere)]
        here = [x for x in tensors if not isinstance(x, _Elsewhere) and x.dim()]
        wanted = kwargs.get("device")
        wanted = None if wanted is None else torch.device(wanted).type
        goes_there = bool(there) if wanted is None else wanted == DEVICE.type
        if there and here and func not in _COPIES | _INDEXING:
            raise RuntimeError(f"{func} has tensors here and on {DEVICE}")
        if self._crosses(func, args, tensors, there, goes_there):
            self._crossings[str(func)] += 1
        inner_args, inner_kwargs = tree_map(_inside, (args, kwargs))
        if wanted is not None and goes_there:
            inner_kwargs["device"] = torch.device("cpu")
        result = func(*inner_args, **inner_kwargs)
        if func is _aten.copy_.default:
            return args[0]
        if not goes_there:
            return result
        result = tree_map(lambda x: _Elsewhere(x) if isinstance(x, torch.Tensor) else x, result)
        return return_and_correct_aliasing(func, args, kwargs, result) if there else result

    @staticmethod
    def _crosses(func, args, tensors, there, goes_there):
        if func is _aten.copy_.default:
            return bool(there) and not all(isinstance(x, _Elsewhere) for x in args[:2])
        if func is _aten._to_copy.default:
            return bool(there) != goes_there
        if not there:
            return False
        masks = func in _INDEXING and any(x.dtype == torch.bool for x in tensors[1:])
        return func is _aten._local_scalar_dense.default or func in _OPEN_ENDED or masks


class _Constructors(TorchFunctionMode):
    """Tensors made from lists, which no dispatcher sees."""

    def __torch_function__(self, func, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        wanted = kwargs.get("device")
        if func in (torch.tensor, torch.as_tensor) and torch.device(wanted or "cpu") == DEVICE:
            (data,), dtype = args, kwargs.get("dtype")
            if isinstance(data, torch.Tensor):
                return data.detach().to(DEVICE, dtype)
            return func(data, dtype=dtype).to(DEVICE)
        return func(*args, **kwargs)


def _inside(value):
    return value.inside if isinstance(value, _Elsewhere) else value


@pytest.fixture
def elsewhere(monkeypatch):
    """Makes :data:`DEVICE` one that Warp and torch know, with Warp's memory seen as if it were there.

    The device, and a counter of how often each operation made the host wait, or moved data between the
    two.
    """
    warp = pytest.importorskip("warp", reason="needs packages: pip install -e '.[warp]'")
    to_torch, from_torch, get_device = warp.to_torch, warp.from_torch, warp.get_device

    def seen(array):
        with torch.device("cpu"):  # Warp's memory, without a copy
            return _Elsewhere(to_torch(array))

    monkeypatch.setattr(warp, "to_torch", seen)
    monkeypatch.setattr(warp, "from_torch", lambda tensor: from_torch(_inside(tensor)))
    monkeypatch.setattr(warp, "get_device", lambda *_: get_device("cpu"))
    # Tensors that are seen through another one cannot be made in inference mode.
    monkeypatch.setattr(torch, "inference_mode", torch.no_grad)
    adam = importlib.import_module("torch.optim.adam")  # as an attribute it is hidden
    monkeypatch.setattr(adam, "_device_dtype_check_for_fused", lambda *_, **__: None)
    generator = torch.Generator
    monkeypatch.setattr(torch, "Generator", lambda *_: generator("cpu"))
    monkeypatch.setattr(PhysicsConfig, "require", lambda self: None)
    # Where there is a GPU, graphs would want to be captured on it.
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    crossings = Counter()
    with _Constructors(), _Operations(crossings):
        yield DEVICE, crossings
