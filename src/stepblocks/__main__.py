"""``python -m stepblocks`` is the command line."""

from stepblocks.cli import main

raise SystemExit(main())
