"""Plugins of Hydra that run sweeps. Hydra finds them in the namespace ``hydra_plugins``.

They import nothing of ``locomotion``, as Hydra imports them in every application of an environment.
"""
