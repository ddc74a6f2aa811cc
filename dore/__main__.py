"""`python -m dore COMMAND ...`."""

from dore.app.cli import dore

if __name__ == "__main__":
    dore()
