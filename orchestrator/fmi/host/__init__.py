"""FMUs for Windows on Linux: a small program under Wine loads their library and calls it for this process.

``host.c`` is that program. ``build.py`` makes ``host.exe`` of it, which comes with the package; compiled for Linux, the
same source loads shared objects, which is how it is tested without Wine.
"""
