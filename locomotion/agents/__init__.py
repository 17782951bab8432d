"""Learning: networks, and learners put together from TorchRL's parts.

:mod:`~locomotion.agents.architectures` and :mod:`~locomotion.agents.learners` say what can be chosen in
``conf/network`` and ``conf/algorithm``, without loading torch.
"""
