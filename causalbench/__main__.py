"""`python -m causalbench`."""

from causalbench.cli import main

if __name__ == "__main__":
    main()
