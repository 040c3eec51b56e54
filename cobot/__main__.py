"""`python -m cobot` is `cobot`."""

from cobot.cli import main

raise SystemExit(main())
