"""placeholder until the branch lands."""
import click


@click.command()
def synth() -> None:
    """Write a synthetic drive."""
