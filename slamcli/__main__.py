"""``python -m slamcli``."""

import sys

from slamcli.cli.main import main

sys.exit(main())
