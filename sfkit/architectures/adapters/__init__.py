"""Networks of other code bases, built from the user's own checkout: nothing of it is part of sfkit.

What these adapters have in common is :class:`~sfkit.architectures.calling.Calling`. A checkout's Python files
belong to the version of what is built from it: change them, and no old score is met.
"""

from sfkit.architectures.adapters import installed, openstereo, standalone
