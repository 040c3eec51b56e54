"""`python -m cobot` is `cobot`."""

from cobot.launch.cli import main

raise SystemExit(main())
