"""Development tools of blur2view: rendering, training, export, evaluation.

They import :mod:`blur2view`; the package never imports them.
"""
