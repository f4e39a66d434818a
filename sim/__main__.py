"""The `odm` command from its first line on: Ctrl-C is heard before anything heavy."""

from sim.terminal import interrupt


def main() -> None:
    """Run the command line, see `sim.cli.main.main`."""
    interrupt.listen()
    from sim.cli.main import main as run

    run()


if __name__ == "__main__":
    main()
