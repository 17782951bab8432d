"""Showing a gait: a film, a page for the browser, MuJoCo's viewer.

Nothing is imported here: what MuJoCo draws with must be chosen before MuJoCo is.
"""
