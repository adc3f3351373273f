"""Entry point of the command line (``python -m printctl``)."""

from printctl.cli.main import main

if __name__ == "__main__":
    main()
