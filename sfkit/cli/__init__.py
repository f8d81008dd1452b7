"""The command line: every command is one call into the library.

Results go to standard output (one JSON document with ``--json``), progress and warnings to standard
error. Bad input ends with exit code 2 and one sentence.
"""

from sfkit.cli.app import main
