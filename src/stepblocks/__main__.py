"""``python -m stepblocks`` is the command line."""

import os
from pathlib import Path

from stepblocks.cli import main
from stepblocks.files.progress import PROGRESS_FILE, append_exit_code

code = main()
steps = os.environ.get(PROGRESS_FILE)
if steps:  # whoever started it may be gone: the next one reads how it ended
    append_exit_code(Path(steps), code)
raise SystemExit(code)
