"""`python -m re3`: the same as the `re3` script."""

from re3.apps.cli import main

main()
