"""``python -m sfkit``: the command line."""

from sfkit.cli import main

if __name__ == "__main__":
    main()
