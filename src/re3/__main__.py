"""`python -m re3`: the same as the `re3` script."""

from re3.apps.cli import main

# Worker processes import the module they were started from; they must not run the command again.
if __name__ == "__main__":
    main()
