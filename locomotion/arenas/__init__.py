"""Arenas: the ground that robots walk on, as dm-control arenas.

An arena is any ``composer.Arena`` with ``ground_geoms``. ``conf/arena/*.yaml`` choose one by its name in
:data:`locomotion.options.registry.arenas`, with options of its own.
"""
