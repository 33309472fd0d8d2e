"""``python -m fracid``: the same as ``fracid``, but that Python itself looks where one stands first."""

import sys
from pathlib import Path

if not sys.flags.safe_path and Path(sys.path[0]) == Path.cwd():
    del sys.path[0]  # what is imported from here on comes from where packages are installed

from fracid.cli import main

if __name__ == "__main__":
    main()
