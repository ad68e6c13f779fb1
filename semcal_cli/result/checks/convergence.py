"""Checks of the search: whether each stage came to its end."""

from semcal_cli.config import PolishConfig, PyramidConfig
from semcal_cli.result.checks.check import Check, Limit

REFINEMENT_NOT_SETTLED = Check(
    topic="refinement-not-settled",
    title="The refinement had not settled",
    measures="movement of the points over the last quarters of the finest level",
    settings={"": Limit(at_most=PyramidConfig.max_final_drift, unit="blocks", source="a setting")},
    advice="add frames, or start nearer with --init",
    examples=(
        "the refinement had not settled, the pose still moved points by 0.8 pixels over the last "
        "quarters of the finest level, needed at most 0.5",
    ),
    means="The ascent was still moving when it ended.",
    why="Few points or frames, or a start that is too far off.",
    to_do="Add frames. With `--init`, start nearer; without, do not narrow the search.",
)
POLISH_NOT_SETTLED = Check(
    topic="polish-not-settled",
    title="The polish had not settled",
    measures="movement of the points in the last round of the polish",
    settings={"": Limit(at_most=PolishConfig.settled_px, unit="pixels", source="a setting")},
    advice="add frames, or start nearer with --init",
    examples=(
        "the polish had not settled, its last round still moved points by 0.21 pixels, needed at most 0.1",
    ),
    means="Newton's method on all points jumped between poses that are about as good.",
    why="Few frames, or ragged borders of labels.",
    to_do="Add frames; for ragged borders, `--edge-band 2` or more.",
)
POLISH_REJECTED = Check(
    topic="polish-rejected",
    title="The polish was rejected",
    measures="information that held-out data lose by the polish",
    settings={
        "": Limit(at_most=PolishConfig.max_loss, unit="standard errors", source="a setting"),
        "several starts": Limit(
            at_most=PolishConfig.max_loss_of_tops, unit="standard errors", source="a setting"
        ),
    },
    advice="check with `semcal inspect` that sweeps, pictures and labels belong together, or add frames",
    examples=(
        "the polish was rejected, held-out data agree less after it by 4.2 standard errors, needed at most 3",
    ),
    means=(
        "What improved the agreement of some data made that of held-out data worse. The pose before it "
        "is kept, without an interval."
    ),
    why="Frames contradict one another, or there are too few to generalise from.",
    to_do="Run `semcal inspect DRIVE`, then add frames.",
)
POLISH_NOT_TESTED = Check(
    topic="polish-not-tested",
    title="The polish could not be tested",
    advice="add frames, or label more of the pictures",
    examples=("the polish was rejected, too few pixels were held out to test it",),
    means="There is too little data to keep some back.",
    why="A single small picture, or one of which little is labelled.",
    to_do="Add frames, or label more of the pictures.",
)
FUSION_NOT_SETTLED = Check(
    topic="fusion-not-settled",
    title="Labels and what is known had not settled",
    advice="add frames, or start nearer with --init",
    examples=("the pose that labels and what is known determine together had not settled in 20 rounds",),
    means="The average of labels and priors was still moving.",
    why="A prior that lies far from where the labels lead.",
    to_do="Check the prior, then add frames or start nearer.",
)
SEEDS = Check(
    topic="seeds",
    title="Seeds lead to different places",
    advice="add frames from other places",
    examples=(
        "1 of 5 seeds lead beyond the 95 % interval, up to 3.1 cm and 0.22 degrees away",
        "1 of 5 seeds gave no answer",
    ),
    means="With `--repeat`, another seed of the random choices ended elsewhere, or nowhere.",
    why="The data determine the pose less well than the interval says.",
    to_do="Add frames from other places.",
)
SOIC = Check(
    topic="soic",
    title="SOIC had not settled",
    advice="start nearer with --init",
    examples=("SOIC had not settled after 20 restarts",),
    means="With `--method soic`, its minimisation was still gaining.",
    why="SOIC has many local optima; from nothing it is right on some drives only.",
    to_do="Give a start with `--init`, or use semcal's own method.",
)
