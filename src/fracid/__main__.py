"""``python -m fracid``: the same as ``fracid``."""

from fracid.cli import main

if __name__ == "__main__":
    main()
