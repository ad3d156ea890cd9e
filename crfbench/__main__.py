"""``python -m crfbench`` is the command ``crfbench``."""

from crfbench.cli import main

if __name__ == "__main__":
    main()
