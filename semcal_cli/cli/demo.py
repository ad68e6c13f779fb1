"""placeholder until the branch lands."""
import click


@click.command()
def demo() -> None:
    """Write a synthetic drive."""
